"""The wire over DDS between processes, on loopback."""

import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed")

from ros2_wire import exchange, own_wire

from mirte_drake.hardware.link import Role
from mirte_drake.hardware.messages import (
    DriveCommand,
    GuardStatus,
    Odometry,
    OperatorRequest,
    Request,
    WheelCommand,
)
from mirte_drake.hardware.wire_config import open_link

pytestmark = pytest.mark.xdist_group("wire")  # In real time: one after the other.

CHILD = Path(__file__).with_name("ros2_child.py")


@contextmanager
def child(config, role):
    process = subprocess.Popen([sys.executable, CHILD, str(config.domain), role])
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def open_all(config, *roles):
    return [open_link(config, role) for role in roles]


def odometry(values) -> Odometry:
    """Of which the child's guard makes the wheel command ``values``."""
    return Odometry(5, np.array([*values[:2], 0.0]), np.array([*values[2:], 0.0]))


def test_a_guard_in_another_process():
    config = own_wire()
    with child(config, "guard"):
        roles = (Role.CONTROLLER, Role.ROBOT, Role.OPERATOR)
        controller, robot, operator = links = open_all(config, *roles)
        values = np.array([10.0, -20.0, 30.0, -40.0])

        def answered():
            last = robot.latest(WheelCommand)
            return last is not None and np.array_equal(last.command, values)

        exchange(links, answered, lambda: robot.send(odometry(values)))
        sent = DriveCommand(2**62, 9, values / 3, np.zeros(3), 1, solve_failed=False, done=True)
        controller.send(sent)
        exchange(links, lambda: controller.count(GuardStatus) and operator.count(GuardStatus))
        for link in (controller, operator):
            status = link.latest(GuardStatus)
            assert (status.session, status.sequence, status.stopped) == (2**62, 9, True)
            np.testing.assert_array_equal(status.command, values / 3)
        operator.send(OperatorRequest(Request.RESET))
        exchange(links, lambda: operator.latest(GuardStatus).reason == "RESET")
        for link in links:
            link.close()


def test_a_robot_that_is_killed_and_comes_again():
    config = own_wire()
    with open_link(config, Role.GUARD) as guard:
        for speed in (10.0, 20.0):
            command = WheelCommand(np.full(4, speed))

            def answered(speed=speed):
                last = guard.latest(Odometry)
                return last is not None and np.all(last.body_velocity[:2] == speed)

            with child(config, "robot"):
                exchange([guard], answered, lambda c=command: guard.send(c))
                assert guard.robot_present()


def test_a_robot_that_is_stopped_holds_nobody_up():
    """SIGSTOP: its sockets are there, but it takes nothing."""
    config = own_wire()
    with child(config, "robot") as robot, open_link(config, Role.GUARD) as guard:
        command = WheelCommand(np.full(4, 10.0))
        exchange([guard], lambda: guard.count(Odometry), lambda: guard.send(command))
        os.kill(robot.pid, signal.SIGSTOP)
        start = time.monotonic()
        for _ in range(500):
            guard.send(command)
        assert time.monotonic() - start < 2.0
        os.kill(robot.pid, signal.SIGCONT)
        last = WheelCommand(np.full(4, 20.0))
        guard.send(last)
        exchange([guard], lambda: np.all(guard.latest(Odometry).body_velocity[:2] == 20.0))
