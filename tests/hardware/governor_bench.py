"""A governor on a bench: shorthand for what happens to it, and for what it does."""

import math

import numpy as np

from mirte_drake.hardware.governor import Governor, Phase
from mirte_drake.hardware.governor_config import GovernorConfig
from mirte_drake.hardware.messages import (
    DriveCommand,
    Odometry,
    OperatorRequest,
    WheelCommand,
)

CLOCK = 1_700_000_000  # [s] What the robot's clock is ahead of ours.
SESSION, OTHER = 11, 22
DRIVE = (10.0, 10.0, 10.0, 10.0)
STILL = [0, 0, 0, 0]
NAN = math.nan


class Bench:
    """A governor that is looked at every 50 ms unless it stalls, and what happens to it.

    Times [s] are ours.
    """

    def __init__(self, *, start=(0.0, 0.0, 0.0), **config):
        self.governor = Governor(GovernorConfig(**config), np.array(start))
        self.sequence = -1
        self.stamp = 0  # Of the last odometry.
        self.looked = None  # [s] at the governor.
        self.stalls = False

    def look_until(self, now):
        """Looks at the governor up to, but not at, a time."""
        self.looked = now if self.looked is None else self.looked
        while not self.stalls and self.looked + 0.05 < now - 1e-6:
            self.looked += 0.05
            self.governor.output(self.looked)

    def odometry(self, now, pose=None, velocity=(0.0, 0.0, 0.0), *, measured=None):
        """Odometry of a robot that creeps, unless a pose is given."""
        self.look_until(now)
        measured = now if measured is None else measured
        pose = (1e-4 * measured, 0.0, 0.0) if pose is None else pose
        self.stamp = round(1e9 * (CLOCK + measured))
        self.governor.on_odometry(Odometry(self.stamp, np.array(pose), np.array(velocity)), now)

    def command(self, now, command=DRIVE, reference=(0.0, 0.0, 0.0), **fields):
        """The next command of the session, answering the last odometry."""
        self.look_until(now)
        self.sequence = fields.pop("sequence", self.sequence + 1)
        values = {
            "session": SESSION,
            "sequence": self.sequence,
            "command": np.array(command),
            "reference": np.array(reference),
            "odometry_stamp": self.stamp,
            "solve_failed": False,
        }
        self.governor.on_drive_command(DriveCommand(**values | fields), now)

    def output(self, now):
        """What is sent at this moment, and the status."""
        self.look_until(now)
        self.looked = now
        command, status = self.governor.output(now)
        return None if command is None else command.tolist(), status

    def drive(self, seconds=0.1, command=DRIVE):
        """Drives from 0 to a whole number of samples, which ends with an output."""
        for k in range(round(10 * seconds) + 1):
            self.odometry(0.1 * k)
            self.command(0.1 * k, command)
            self.output(0.1 * k)
        assert self.governor.phase is Phase.DRIVING
        return self

    def foreign(self, now, command):
        self.look_until(now)
        self.governor.on_foreign_command(WheelCommand(np.array(command)), now)

    def request(self, now, request):
        self.look_until(now)
        self.governor.on_request(OperatorRequest(request), now)


def stops(bench, now, reason):
    """Whether the next output stops the robot for a reason, and the one after it still does."""
    command, status = bench.output(now)
    assert command == STILL
    assert status.stopped
    assert status.reason == reason
    assert status.command.tolist() == STILL
    again, status = bench.output(now + 10.0)
    return again == STILL and status.reason == reason


def drives(bench, now):
    """Whether all is well at the next output."""
    command, status = bench.output(now)
    return command != STILL and not status.stopped and status.reason == ""
