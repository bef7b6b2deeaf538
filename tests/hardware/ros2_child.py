"""A guard or robot in a process of its own that answers what it receives.

Usage: python ros2_child.py DOMAIN guard|robot. The guard answers a DriveCommand with a
GuardStatus that repeats it, an OperatorRequest with one that says so, and odometry with a wheel
command of its numbers; the robot answers a wheel command with odometry of its numbers.
"""

import sys

import numpy as np

from mirte_drake.hardware.link import Link, Role
from mirte_drake.hardware.messages import (
    DriveCommand,
    GuardStatus,
    Odometry,
    OperatorRequest,
    WheelCommand,
)
from mirte_drake.hardware.wire_config import Ros2WireConfig, open_link


def guard(link: Link) -> None:
    for drive in link.take(DriveCommand):
        link.send(
            GuardStatus(drive.session, drive.sequence, drive.command, drive.done, "drive", 0.5, 1)
        )
    for request in link.take(OperatorRequest):
        link.send(GuardStatus(0, 0, np.zeros(4), True, request.request.name, 0.5, 1))
    for odometry in link.take(Odometry):
        link.send(WheelCommand(np.array([*odometry.pose[:2], *odometry.body_velocity[:2]])))


def robot(link: Link) -> None:
    for command in link.take(WheelCommand):
        u1, u2, u3, u4 = command.command
        link.send(
            Odometry(link.count(WheelCommand), np.array([u1, u2, 0.0]), np.array([u3, u4, 0]))
        )


if __name__ == "__main__":
    domain, role = int(sys.argv[1]), Role(sys.argv[2])
    answer = {Role.GUARD: guard, Role.ROBOT: robot}[role]
    with open_link(Ros2WireConfig(domain=domain), role) as own_end:
        while True:  # Until it is killed.
            own_end.wait(1.0)
            answer(own_end)
