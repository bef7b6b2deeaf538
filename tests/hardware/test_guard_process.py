"""The guard as a process, on LCM and over DDS; what happens to it and to those beside it."""

import os
import signal
import time

import numpy as np
import pytest

from mirte_drake.errors import UserError
from mirte_drake.hardware.governor_config import GovernorConfig
from mirte_drake.hardware.guard_process import start_guard
from mirte_drake.hardware.link import Role
from mirte_drake.hardware.messages import DriveCommand, GuardStatus, Odometry, WheelCommand
from mirte_drake.hardware.wire_config import LcmWireConfig, Ros2WireConfig, open_link

PORT = 31000 + os.getpid() % 10000
WIRES = [
    LcmWireConfig(url=f"udpm://239.255.76.67:{PORT}?ttl=0"),
    Ros2WireConfig(domain=60 + os.getpid() % 40),
]
FORWARD = np.full(4, 30.0)


class Driven:
    """A robot and a controller, by hand, beside a real guard."""

    def __init__(self, wire):
        self.robot = open_link(wire, Role.ROBOT)
        self.controller = open_link(wire, Role.CONTROLLER)
        self.sequence = 0
        self.commands = []  # (time, command) as the robot gets them.

    def close(self):
        self.robot.close()
        self.controller.close()

    def pass_time(self, duration):
        until = time.monotonic() + duration
        while time.monotonic() < until:
            self.robot.wait(0.002)
            self.controller.wait(0.0)
            for message in self.robot.take(WheelCommand):
                self.commands.append((time.monotonic(), message.command))

    def drive(self, samples, ask=True):
        for _ in range(samples):
            self.sequence += 1
            stamp = time.monotonic_ns()
            position = np.array([1e-3 * self.sequence, 0, 0])
            self.robot.send(Odometry(stamp, position, np.zeros(3)))
            self.pass_time(0.005)
            if ask:
                command = DriveCommand(9, self.sequence, FORWARD, position, stamp, False)
                self.controller.send(command)
            self.pass_time(0.095)


@pytest.fixture(params=WIRES, ids=["lcm", "ros2"])
def driven(request):
    """A guard that passes commands on."""
    guard = start_guard(request.param, GovernorConfig(), np.zeros(3))
    world = Driven(request.param)
    world.guard = guard
    world.drive(8, ask=False)  # DDS makes acquaintance.
    world.drive(5)
    assert np.array_equal(world.commands[-1][1], FORWARD)
    yield world
    world.close()
    guard.stop()


def zero_after(world, instant):
    """Returns how long after an instant all wheels were zero, and checks that they stay so."""
    after = [(t - instant, command) for t, command in world.commands if t > instant]
    zeros = [t for t, command in after if not np.any(command)]
    assert zeros
    assert all(not np.any(command) for t, command in after if t >= zeros[0])
    return zeros[0]


def test_silence_of_the_controller_stops_the_wheels(driven):
    last = time.monotonic() - 0.095  # When the last command was sent.
    driven.drive(6, ask=False)
    assert zero_after(driven, last) < 0.30  # 0.25, and what a loaded machine takes.
    status = driven.controller.latest(GuardStatus)
    assert status.stopped and status.reason.startswith("controller is silent")
    driven.drive(3)  # It has come back too late.
    assert zero_after(driven, last) < 0.30


def test_its_end_leaves_standing_wheels(driven):
    instant = time.monotonic()
    os.kill(driven.guard.pid, signal.SIGTERM)
    driven.pass_time(0.5)
    assert zero_after(driven, instant) < 0.1


def test_once_stalled_it_does_not_go_on(driven):
    """What piled up meanwhile is old; nobody can know how old."""
    os.kill(driven.guard.pid, signal.SIGSTOP)
    driven.drive(5)
    instant = time.monotonic()
    os.kill(driven.guard.pid, signal.SIGCONT)
    driven.drive(3)
    assert zero_after(driven, instant) < 0.1
    assert driven.controller.latest(GuardStatus).reason.startswith("guard stalled")


def test_a_guard_that_does_not_come_up_says_why(capfd):
    with pytest.raises(UserError, match="guard: did not come up"):
        start_guard(Ros2WireConfig(interface="eth99"), GovernorConfig(), np.zeros(3))
    assert "eth99" in capfd.readouterr().err


def test_it_ends_by_itself_when_the_process_that_started_it_is_gone():
    """A child of a child: its parent ends at once, the guard after its time of zeros."""
    import subprocess
    import sys

    code = (
        "import numpy as np\n"
        "from mirte_drake.hardware.guard_process import start_guard\n"
        "from mirte_drake.hardware.governor_config import GovernorConfig\n"
        "from mirte_drake.hardware.wire_config import LcmWireConfig\n"
        f"wire = LcmWireConfig(url={WIRES[0].url!r}, prefix='ORPHAN_')\n"
        "print(start_guard(wire, GovernorConfig(), np.zeros(3)).pid)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=30)
    pid = int(done.stdout)
    until = time.monotonic() + 9.0
    while time.monotonic() < until:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            break
        time.sleep(0.1)
    else:
        os.kill(pid, signal.SIGKILL)
        raise AssertionError("it is still there")
