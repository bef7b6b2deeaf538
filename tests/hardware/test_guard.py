import contextlib
import math
import os
import signal

import numpy as np
import pytest
from memory_link import MemoryLink, MemoryWire

from mirte_drake.hardware import guard
from mirte_drake.hardware.governor_config import GovernorConfig
from mirte_drake.hardware.guard import run_guard
from mirte_drake.hardware.link import Role
from mirte_drake.hardware.messages import (
    DriveCommand,
    GuardStatus,
    Odometry,
    OperatorRequest,
    Request,
    WheelCommand,
)

BEGIN = 100.0  # [s] Time of a new wire.
STILL = [0, 0, 0, 0]
SESSION = 77


def odometry(time):
    pose = np.array([1e-4 * (time - BEGIN), 0.0, 0.0])
    return Odometry(round(1e9 * time), pose, np.zeros(3))


def command(time, sequence, **fields):
    values = {
        "session": SESSION,
        "sequence": sequence,
        "command": np.full(4, 20.0),
        "reference": np.zeros(3),
        "odometry_stamp": round(1e9 * time),
        "solve_failed": False,
    }
    return DriveCommand(**values | fields)


class Drive:
    """A robot and a controller on a wire, each for a time [s], and the guard between them."""

    def __init__(self, robot=1.0, controller=1.0):
        self.wire = MemoryWire()
        self.link = MemoryLink(self.wire, Role.GUARD)
        for k in range(round(10 * robot)):
            self.at(0.1 * k, Role.ROBOT, odometry(BEGIN + 0.1 * k))
        for k in range(round(10 * controller)):
            message = command(BEGIN + 0.1 * k, k)
            self.at(0.1 * k + 0.005, Role.CONTROLLER, message)

    def at(self, time, role, message):
        self.wire.at(BEGIN + time, lambda: self.wire.send(role, message))

    def run(self, seconds=2.0):
        end = BEGIN + seconds
        run_guard(
            self.link,
            GovernorConfig(),
            np.zeros(3),
            clock=self.wire.clock,
            until=lambda: self.wire.now >= end,
        )
        return self

    @property
    def commands(self):
        """What the guard sent to the wheels, and when after the beginning [s]."""
        sent = self.wire.sent_by(Role.GUARD, WheelCommand)
        return [(t - BEGIN, m.command.tolist()) for t, m in sent]

    @property
    def statuses(self):
        return [(t - BEGIN, m) for t, m in self.wire.sent_by(Role.GUARD, GuardStatus)]

    def moving(self):
        """Times [s] at which the wheels began to turn, or were told to go on."""
        return [t for t, c in self.commands if c != STILL]

    def zeros_after(self, time):
        return [t for t, c in self.commands if t > time and c == STILL]

    def reason(self):
        return next((s.reason for _, s in self.statuses if s.stopped), "")


def gaps(times):
    return np.diff(np.array(times))


def test_waiting_it_sends_zeros_and_its_status_twenty_times_a_second():
    drive = Drive(robot=0.0, controller=0.0).run(1.0)
    assert {tuple(c) for _, c in drive.commands} == {(0, 0, 0, 0)}
    for times in ([t for t, _ in drive.commands], [t for t, _ in drive.statuses]):
        assert times[0] <= 0.01 + 1e-9
        assert max(gaps(times)) <= 0.05 + 1e-9
        assert np.median(gaps(times)) >= 0.04 - 1e-9
    assert all(not s.stopped and s.session == 0 for _, s in drive.statuses)


def test_it_passes_each_command_on_at_once_and_once():
    drive = Drive().run(0.95)
    np.testing.assert_allclose(drive.moving(), 0.1 * np.arange(10) + 0.005, atol=1e-9)
    passed = {s.sequence: t for t, s in reversed(drive.statuses) if s.session == SESSION}
    np.testing.assert_allclose([passed[k] for k in range(10)], drive.moving(), atol=1e-9)
    assert max(gaps([t for t, _ in drive.statuses])) <= 0.05 + 1e-9
    assert drive.statuses[-4][1].odometry_age == pytest.approx(0.05, abs=0.011)


def test_it_stops_a_quarter_of_a_second_after_the_controller(capfd):
    drive = Drive(robot=2.0, controller=0.8).run()
    last = 0.705  # The controller's last command.
    assert drive.moving()[-1] == pytest.approx(last)
    zeros = drive.zeros_after(last)
    assert last + 0.23 < zeros[0] <= last + 0.25
    assert drive.reason().startswith("controller is silent: 0.2")
    # Again and again, and only zeros.
    assert max(gaps(zeros)) <= 0.05 + 1e-9
    stops = capfd.readouterr().err.splitlines()
    assert stops == [f"guard: stopped: {drive.reason()}"]


def test_it_stops_a_quarter_of_a_second_after_the_odometry():
    drive = Drive(robot=0.8, controller=2.0).run()
    zeros = drive.zeros_after(0.05)
    assert 0.7 + 0.23 < zeros[0] <= 0.7 + 0.25
    assert drive.reason().startswith("odometry is old: 0.2")


def test_a_stop_is_sent_at_once():
    drive = Drive()
    drive.at(0.52, Role.OPERATOR, OperatorRequest(Request.STOP))
    drive.run(1.0)
    assert drive.zeros_after(0.05)[0] == pytest.approx(0.52)
    stopped = [(t, s) for t, s in drive.statuses if s.stopped]
    assert stopped[0][0] == pytest.approx(0.52)
    assert stopped[0][1].reason == "the operator asked for it"
    assert stopped[0][1].command.tolist() == STILL
    assert drive.moving()[-1] < 0.52


def test_commands_of_others_stop_the_robot():
    drive = Drive()
    drive.at(0.52, Role.OPERATOR, WheelCommand(np.full(4, 5)))
    drive.run(1.0)
    assert drive.reason().startswith("another sender on the wheel topics")
    assert drive.moving()[-1] < 0.52


def test_after_a_reset_another_controller_may_drive(capfd):
    drive = Drive(robot=3.0, controller=0.5)
    drive.at(1.02, Role.OPERATOR, OperatorRequest(Request.RESET))
    for k in range(10):
        message = command(BEGIN + 1.1 + 0.1 * k, k, session=78)
        drive.at(1.105 + 0.1 * k, Role.CONTROLLER, message)
    drive.run(3.0)
    second = [t for t in drive.moving() if t > 1.0]
    np.testing.assert_allclose(second, 1.105 + 0.1 * np.arange(10), atol=1e-9)
    # Both times the controller was silent in the end, and both times it is said.
    assert len(capfd.readouterr().err.splitlines()) == 2


def test_done_is_no_alarm(capfd):
    drive = Drive(robot=2.0, controller=0.5)
    drive.at(0.51, Role.CONTROLLER, command(BEGIN + 0.5, 99, done=True))
    drive.run()
    assert drive.zeros_after(0.05)[0] == pytest.approx(0.51)
    assert drive.reason() == ""
    assert capfd.readouterr().err == ""


class BrokenError(Exception):
    """Something that nobody has thought of."""


def breaks(link, name, *, at, until=math.inf, kind=object):
    """Lets a method of a link fail from one time on, up to another [s]."""
    works = getattr(link, name)

    def method(*args):
        if at <= link.wire.now - BEGIN < until and (not args or isinstance(args[0], kind)):
            link.wire.now += 0.001  # Nothing fails without end in no time.
            raise BrokenError("of all\nthings")
        return works(*args)

    setattr(link, name, method)


@pytest.fixture
def no_sleep(monkeypatch):
    monkeypatch.setattr(guard.time, "sleep", lambda _: None)


@pytest.mark.usefixtures("no_sleep")
@pytest.mark.parametrize("name", ["wait", "take"])
def test_an_error_stops_the_robot_and_not_the_guard(name, capfd):
    drive = Drive(robot=2.0, controller=2.0)
    breaks(drive.link, name, at=0.5, until=0.6)
    drive.run()
    assert drive.zeros_after(0.05)[0] == pytest.approx(0.5, abs=0.011)
    assert max(drive.moving()) < 0.51
    assert max(gaps(drive.zeros_after(0.5))) <= 0.05 + 1e-9
    assert drive.reason() == "the guard failed: BrokenError: of all\nthings"
    said = capfd.readouterr().err.splitlines()
    assert said == ["guard: stopped: the guard failed: BrokenError: of all things"]


@pytest.mark.usefixtures("no_sleep")
@pytest.mark.parametrize("name", ["wait", "take"])
def test_an_error_that_stays_leaves_zeros_on_the_wire(name, capfd):
    drive = Drive(robot=2.0, controller=2.0)
    breaks(drive.link, name, at=0.5)
    drive.run()
    zeros = drive.zeros_after(0.05)
    assert zeros[0] == pytest.approx(0.5, abs=0.011)
    assert zeros[-1] == pytest.approx(2.0, abs=0.05)
    assert len(capfd.readouterr().err.splitlines()) == 1
    assert max(gaps(zeros)) <= 0.05
    assert max(drive.moving()) < 0.51


@pytest.mark.usefixtures("no_sleep")
def test_a_status_that_cannot_be_sent_stops_the_robot():
    drive = Drive(robot=2.0, controller=2.0)
    breaks(drive.link, "send", at=0.5, kind=GuardStatus)
    drive.run()
    assert drive.zeros_after(0.5)[0] == pytest.approx(0.5, abs=0.05)
    assert max(drive.moving()) < 0.51


@pytest.mark.usefixtures("no_sleep")
def test_an_error_while_waiting_for_a_controller_is_no_drive():
    drive = Drive(robot=2.0, controller=2.0)
    breaks(drive.link, "wait", at=0.0, until=0.004)
    drive.run()
    assert drive.moving() == []


def test_at_its_end_the_wheels_stand_still():
    drive = Drive().run(0.52)
    last = [c for t, c in drive.commands if t > 0.51]
    assert last == [STILL] * 3
    assert drive.statuses[-1][1].reason == "the guard was ended"


def test_at_its_end_a_guard_that_waits_gives_no_alarm():
    drive = Drive(robot=0.0, controller=0.0).run(0.1)
    assert drive.reason() == ""


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit])
def test_whatever_ends_it_the_wheels_stand_still(error):
    drive = Drive()

    def ends():
        raise error

    drive.wire.at(BEGIN + 0.52, ends)
    with pytest.raises(error):
        drive.run(1.0)
    assert drive.commands[-1] == (pytest.approx(0.55, abs=0.02), STILL)
    assert len(drive.zeros_after(0.51)) == 3


def test_it_is_ready_when_zeros_are_on_the_wire():
    wire, seen = MemoryWire(), []
    run_guard(
        MemoryLink(wire, Role.GUARD),
        GovernorConfig(),
        np.zeros(3),
        on_ready=lambda: seen.extend(wire.sent),
        until=lambda: True,
    )
    ((_, role, message),) = seen
    assert role is Role.GUARD
    assert message.command.tolist() == STILL


class HeldError(BaseException):
    """The guard was held up."""


def test_a_terminal_that_takes_nothing_does_not_hold_the_guard(monkeypatch):
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(writer, b"x" * 4096)
    os.set_blocking(writer, True)
    monkeypatch.setattr(guard, "STDERR", writer)

    def held(*_):
        raise HeldError

    before = signal.signal(signal.SIGALRM, held)
    signal.alarm(5)
    try:
        drive = Drive(robot=0.5).run()
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
        os.close(reader)
        os.close(writer)
    assert drive.reason().startswith("odometry is old")


def test_bad_settings_are_said_before_anything_is_sent():
    wire = MemoryWire()
    with pytest.raises(ValueError, match=r"^start: "):
        run_guard(MemoryLink(wire, Role.GUARD), GovernorConfig(), np.full(3, 9.0))
    assert wire.sent == []
