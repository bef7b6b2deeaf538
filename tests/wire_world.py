"""Controller, guard and robot on one wire in one process, on a clock that only waiting moves."""

import numpy as np
import pytest
from pydrake.lcm import DrakeLcm

from mirte_drake.hardware import lcm_link, lcm_serializer
from mirte_drake.hardware.governor import Governor
from mirte_drake.hardware.governor_config import GovernorConfig
from mirte_drake.hardware.lcm_link import LcmLink
from mirte_drake.hardware.link import Role
from mirte_drake.hardware.messages import DriveCommand, Odometry, WheelCommand
from mirte_drake.hardware.wire_config import LcmWireConfig
from mirte_drake.stand_in import StandIn

WIRE = LcmWireConfig(url="memq://")
STEP = 0.0025  # [s]
STATUS_PERIOD = 0.05  # [s]


class _Clock:
    def __init__(self):
        self.now = 100.0

    def monotonic(self):
        return self.now


class _End(LcmLink):
    """A link on the shared wire whose waiting takes no time."""

    def __init__(self, role, lcm, alter=lambda message: message):
        super().__init__(WIRE, role, lcm)
        self._alter = alter

    def wait(self, timeout):
        self.lcm.HandleSubscriptions(0)
        return False

    def send(self, message):
        message = self._alter(message)
        if message is not None:
            super().send(message)


class ControllersEnd(LcmLink):
    """The controller's link: while it waits, guard and robot live."""

    def __init__(self, world, lcm):
        super().__init__(WIRE, Role.CONTROLLER, lcm)
        self._world = world

    def wait(self, timeout):
        until = self._world.now + timeout
        before = sum(self._counts.values())
        while True:
            self._world.live()
            self.lcm.HandleSubscriptions(0)
            if sum(self._counts.values()) > before:
                return True
            if self._world.now >= until:
                return False
            self._world.advance_to(min(self._world.now + STEP, until))


class World:
    """All that is on the wire; ``odometry`` alters or drops (None) what the robot sends."""

    def __init__(self, monkeypatch, scenario, odometry=lambda message: message):
        self._clock = _Clock()
        monkeypatch.setattr(lcm_link, "time", self._clock)
        monkeypatch.setattr(lcm_serializer, "time", self._clock)
        lcm = DrakeLcm("memq://")
        self.guards_end = _End(Role.GUARD, lcm)
        self.governor = Governor(GovernorConfig(), scenario.first_pose)
        self.guard_lives = True
        self.robot = StandIn(scenario, _End(Role.ROBOT, lcm, odometry), self.clock)
        self.link = ControllersEnd(self, lcm)
        self.commands = []  # (time, command) as the robot has them.
        self._status_due = 0.0

    @property
    def now(self):
        return self._clock.now

    def clock(self):
        return self._clock.now

    def advance_to(self, time):
        self._clock.now = time

    def live(self):
        """Lets guard and robot do what is due."""
        self.robot.step()
        if not self.commands or np.any(self.commands[-1][1] != self.robot.command):
            self.commands.append((self.now, self.robot.command))
        if self.guard_lives:
            self._guard()
        self.robot.step()

    def _guard(self):
        end, now = self.guards_end, self.now
        end.wait(0)
        for message in end.take(Odometry):
            self.governor.on_odometry(message, now)
        came = end.take(DriveCommand)
        for message in came:
            self.governor.on_drive_command(message, now)
        for message in end.take(WheelCommand):
            self.governor.on_foreign_command(message, now)
        command, status = self.governor.output(now)
        if came or now >= self._status_due or status.stopped:
            if command is not None:
                end.send(WheelCommand(command))
            end.send(status)
            self._status_due = now + STATUS_PERIOD


@pytest.fixture
def make_world(monkeypatch):
    return lambda *args, **kwargs: World(monkeypatch, *args, **kwargs)
