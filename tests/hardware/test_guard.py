import dataclasses as dc

import numpy as np
import pytest
from scripted_link import ScriptedLink

from mirte_drake.hardware.governor import Governor
from mirte_drake.hardware.governor_config import GovernorConfig
from mirte_drake.hardware.guard import REPEAT, Guard
from mirte_drake.hardware.link import Role
from mirte_drake.hardware.messages import (
    DriveCommand,
    GuardStatus,
    Odometry,
    OperatorRequest,
    Request,
    WheelCommand,
)

FORWARD = np.array([30.0, 30.0, 30.0, 30.0])


def odometry(time, x=0.0):
    return Odometry(round(1e9 * time), np.array([x, 0, 0]), np.zeros(3))


def ask(sequence, command=FORWARD, stamp=100.0, **change):
    reference = np.zeros(3)
    command = DriveCommand(5, sequence, np.array(command), reference, round(1e9 * stamp), False)
    return dc.replace(command, **change)


class Watch:
    """A guard on a scripted wire, run to a time."""

    def __init__(self):
        self.link = ScriptedLink(Role.GUARD)
        self.lines = []
        governor = Governor(GovernorConfig(), np.zeros(3))
        self.guard = Guard(self.link, governor, clock=self.link.clock, log=self.lines.append)

    def drive(self, until, every=0.1):
        """Sound odometry and commands from 0.1 s on."""
        for k in range(1, int(until / every + 1e-6)):
            time = 100.0 + every * k
            self.link.at(time, odometry(time, 1e-3 * k))
            self.link.at(time + 0.002, ask(k, stamp=time))

    def to(self, time):
        while self.link.now < 100.0 + time - 1e-9:
            self.guard.step()

    def sent(self, kind):
        return [(time - 100.0, m) for time, m in self.link.sent if isinstance(m, kind)]

    def wheels(self, since=0.0):
        return [(time, m.command) for time, m in self.sent(WheelCommand) if time >= since - 1e-9]


def test_zeros_are_repeated_before_anybody_drives():
    watch = Watch()
    watch.to(1.0)
    times = np.array([time for time, command in watch.wheels()])
    assert all(not np.any(command) for _, command in watch.wheels())
    assert times[0] <= 0.01 + 1e-9 and np.max(np.diff(times)) <= REPEAT + 0.011
    assert len(times) < 25  # But not at every look.


def test_a_command_is_passed_on_at_once_and_once():
    watch = Watch()
    watch.drive(1.0)
    watch.to(0.95)
    moving = [(time, command) for time, command in watch.wheels() if np.any(command)]
    np.testing.assert_allclose([time for time, _ in moving], 0.102 + 0.1 * np.arange(9), atol=1e-6)
    assert all(np.array_equal(command, FORWARD) for _, command in moving)
    # And nothing in between: zeros would brake.
    assert len(watch.wheels(0.102)) == 9


def test_the_heart_beats_all_the_time():
    watch = Watch()
    watch.drive(2.0)
    watch.to(3.0)  # Waiting, driving, stopped.
    times = [time for time, _ in watch.sent(GuardStatus)]
    assert np.max(np.diff(times)) <= REPEAT + 0.011
    answered = {m.sequence for _, m in watch.sent(GuardStatus) if np.any(m.command)}
    assert answered == set(range(1, 20))


def test_silence_stops_in_time_and_for_good():
    watch = Watch()
    watch.drive(1.0)
    for k in range(10, 30):
        watch.link.at(100.0 + 0.1 * k, odometry(100.0 + 0.1 * k, 1e-3 * k))
    watch.link.at(102.0, ask(99, stamp=102.0))  # Too late.
    watch.to(2.5)
    last = 0.902  # The last command.
    (first, command) = watch.wheels(last + 0.001)[0]
    assert not np.any(command) and first - last <= 0.25
    assert all(not np.any(command) for _, command in watch.wheels(first))
    assert np.max(np.diff([time for time, _ in watch.wheels(first)])) <= REPEAT + 0.011
    assert watch.lines == ["guard: stopped: controller is silent: 0.238 s (limit 0.23 s)"]
    assert watch.sent(GuardStatus)[-1][1].stopped


def test_the_operators_stop_is_obeyed_at_once():
    watch = Watch()
    watch.drive(1.0)
    watch.link.at(100.55, OperatorRequest(Request.STOP))
    watch.to(0.8)
    assert watch.wheels(0.55)[0][0] == pytest.approx(0.55)
    assert not np.any(watch.wheels(0.55)[0][1])


def test_an_error_in_the_guard_itself_stops_the_wheels(monkeypatch):
    watch = Watch()
    watch.drive(1.0)
    watch.to(0.55)

    def fail(*_):
        raise RuntimeError("broken")

    monkeypatch.setattr(Governor, "on_odometry", fail)
    watch.to(1.5)
    first, command = watch.wheels(0.55)[0]
    assert first == pytest.approx(0.6) and not np.any(command)
    assert watch.lines == ["guard: stopped: error in the guard: RuntimeError('broken')"]
    assert all(not np.any(command) for _, command in watch.wheels(first))


def test_the_end_of_a_drive_is_no_alarm():
    watch = Watch()
    watch.drive(1.0)
    watch.link.at(100.95, ask(2**31 - 1, done=True))
    watch.to(2.0)
    first, command = watch.wheels(0.91)[0]
    assert first == pytest.approx(0.95) and not np.any(command)
    assert watch.lines == [] and not watch.sent(GuardStatus)[-1][1].stopped
    assert watch.guard.resting_since == pytest.approx(100.95)


def test_farewell_is_zeros_again_and_again(monkeypatch):
    monkeypatch.setattr("mirte_drake.hardware.guard.time.sleep", lambda _: None)
    watch = Watch()
    watch.guard.say_farewell()
    assert len(watch.wheels()) == 5 and not np.any([command for _, command in watch.wheels()])
