"""A world around a governor: what can happen to it, in bytes."""

import math

import numpy as np
from governor_judge import AGE, INF, NAN, REACH, SLEW, START, TINY, Judge

from mirte_drake.hardware.governor import Governor
from mirte_drake.hardware.governor_config import GovernorConfig
from mirte_drake.hardware.messages import (
    DriveCommand,
    Odometry,
    OperatorRequest,
    Request,
    WheelCommand,
)

NO_VECTORS = [
    *(np.array([0.0, bad, 0.0]) for bad in (NAN, INF, -INF)),
    *(np.zeros(shape) for shape in ((), (0,), (2,), (4,), (3, 1), (1, 3))),
    np.array([0, 10**400, 0], dtype=object),
    np.array(["a", "b", "c"]),
    None,
]
NO_COMMANDS = [
    *(np.array([50.0, bad, 0.0, 0.0]) for bad in (NAN, INF, -INF)),
    *(np.full(shape, 50.0) for shape in ((), (0,), (3,), (5,), (4, 1), (2, 2))),
    np.array([50, 0, 0, 10**400], dtype=object),
    np.array(["a", "b", "c", "d"]),
    None,
]
NO_STAMPS = [-1, 2**63, 10**30, 10**400, None, NAN]


class World(Judge):
    """A robot, controllers, an operator and others, a governor, and its judge."""

    def __init__(self):
        area = np.array([START[0] - REACH, START[1] - REACH, START[0] + REACH, START[1] + REACH])
        config = GovernorConfig(allowed_area=area, slew_limit=SLEW)
        super().__init__(Governor(config, np.array(START)), 100.0, [1.0, -2.0, 3.0])
        self.clean = True  # All has been well so far.
        self.frozen = False
        self.session, self.sequence = 1, 0
        self.stamp = 0  # [ns] of the last odometry.

    # What can happen. Each takes a byte.

    def sample(self, byte):
        """All is well: the robot creeps, the controller answers."""
        self.step([byte - 128.0, 0.7 * byte - 90.0, 55.0, 60.5])
        if self.clean:
            assert not self.status.stopped
            assert self.status.sequence == self.sequence - 1, "a command was not passed on"

    def drift(self, byte):
        """The robot goes astray, the reference with it."""
        self.clean = False
        way = [(0.1, 0, 0), (-0.1, 0, 0), (0, 0.1, 0), (0, -0.1, 0), (0, 0, 0.5)][byte % 5]
        for _ in range(1 + byte // 5 % 6):
            self.step([50.0] * 4, way)

    def block(self, byte):
        """The robot stands, or the odometry is frozen, while the wheels push more or less."""
        self.clean, self.frozen = False, True
        for _ in range(1 + byte % 8):
            self.step([[50.0] * 4, [39.0] * 4, [60.0, 60.0, -60.0, -60.0]][byte // 8 % 3])
        self.frozen = False

    def fail(self, byte):
        """The solver fails some times."""
        self.clean = False
        for _ in range(1 + byte % 4):
            self.step([30.0] * 4, solve_failed=True)

    def silence(self, byte):
        """The controller is silent for some samples."""
        self.clean = False
        for _ in range(1 + byte % 4):
            self.advance(0.1)
            self.move(0.001, 0.0, 0.0)
            self.odometry()
        self.maybe_look(byte)

    def delay(self, byte):
        """Odometry is late for some samples."""
        self.clean = False
        for _ in range(1 + byte % 4):
            self.step([30.0] * 4, late=[0.05, 0.12, 0.2, 0.2299, 0.4][byte // 4 % 5])

    def repeat(self, byte):
        """The robot says what it has said before, for some samples."""
        self.clean = False
        for _ in range(1 + byte % 4):
            self.advance(0.1)
            if not self.honest or self.now - self.prompt > 0.9:  # It may be believed.
                self.honest, self.arrived = False, self.now
            stamp = self.stamp - [0, 1, 10**8, 10**12][byte // 4 % 4]
            odometry = Odometry(max(stamp, 0), np.array(self.pose), np.zeros(3))
            self.governor.on_odometry(odometry, self.now)
            self.command(np.full(4, 30.0))
            self.look()

    def wait(self, byte):
        self.clean = False
        self.advance([0.0, 0.001, 0.01, 0.05, 0.0999, 0.15, 0.2299, 0.2301, 0.5, 1.1][byte % 10])

    def stall(self, byte):
        self.clean = False
        self.now += [0.0, 0.05, 0.0999, 0.1001, 0.2301, 0.5, 3.0][byte % 7]

    def good_odometry(self, byte):
        self.clean = False
        self.odometry(late=[0.0, 0.0, 0.01, 0.1, 0.2299, 0.2301, 0.4][byte % 7])
        self.maybe_look(byte)

    def lying_odometry(self, byte):
        """Well-formed, but of another time or place."""
        self.clean = self.honest = False
        kind, steps = byte % 3, (1e-3, 0.05, 0.5, 3600.0, 1e9, -0.05, -0.5, -100.0, -4e8)
        if kind == 0:
            self.clock += steps[byte // 3 % len(steps)]
            self.odometry()
        elif kind == 1:
            self.odometry(stamp=max(self.stamp + round(1e9 * steps[byte // 3 % len(steps)]), 0))
        else:
            self.move(1.0, 0.0, 1.0)
            self.odometry()
        self.maybe_look(byte)

    def bad_odometry(self, byte):
        """What makes no sense."""
        self.clean = False
        stamp, pose, velocity = self.stamp + 10_000_000, np.array(self.pose), np.zeros(3)
        kind, which = byte % 5, byte // 5
        if kind == 0:
            pose = NO_VECTORS[which % len(NO_VECTORS)]
        elif kind == 1:
            velocity = NO_VECTORS[which % len(NO_VECTORS)]
        elif kind == 2:
            stamp = NO_STAMPS[which % len(NO_STAMPS)]
        elif kind == 3:
            velocity = np.array([[9.0, 0.0, 0.0], [0.0, 0.0, -9.0], [1e308, 1e308, 0]][which % 3])
        else:
            pose = np.array([[1e5, 0.0, 0.0], [0.0, -1e300, 0.0], [0.0, 0.0, 1e9]][which % 3])
        self.governor.on_odometry(Odometry(stamp, pose, velocity, self.now), self.now)
        self.maybe_look(byte)

    def good_command(self, byte):
        self.clean = False
        self.command(np.array([byte - 128.0, -byte / 3, 3.0 * (byte - 128.0), 0.0]))
        self.maybe_look(byte)

    def zero_command(self, byte):
        self.clean = False
        self.command(np.zeros(4))
        self.maybe_look(byte)

    def stray_command(self, byte):
        """Well-formed, but failed, astray or old."""
        self.clean = False
        kind, which = byte % 4, byte // 4
        if kind == 0:
            self.command(np.full(4, 50.0), solve_failed=True)
        elif kind == 1:
            off = [(0.49, 0.0, 0), (0.0, 0.51, 0), (9.0, 9.0, 0), (0, 0, 0.79), (0, 0, -0.81)]
            self.command(np.full(4, 50.0), off=off[which % 5], turns=which % 3 - 1)
        elif kind == 2:
            ago = [0.1, 0.2, 0.3, -0.1, -0.3, 1e6][which % 6]
            self.command(np.full(4, 50.0), odometry_stamp=max(self.stamp - round(1e9 * ago), 0))
        else:
            self.command(np.full(4, 99.0), sequence=self.sequence - 1 - which % 5)
        self.maybe_look(byte)

    def bad_command(self, byte):
        """What makes no sense."""
        self.clean = False
        kind, which = byte % 4, byte // 4
        if kind == 0:
            self.command(NO_COMMANDS[which % len(NO_COMMANDS)], sense=False)
        elif kind == 1:
            reference = NO_VECTORS[which % len(NO_VECTORS)]
            self.command(np.full(4, 50.0), sense=False, reference=reference)
        elif kind == 2:
            stamp = NO_STAMPS[which % len(NO_STAMPS)]
            self.command(np.full(4, 50.0), sense=False, odometry_stamp=stamp)
        else:
            self.command(
                np.full(4, 50.0), session=[0, self.session - 1, 10**6, 2**63 - 1][which % 4]
            )
        self.maybe_look(byte)

    def done(self, byte):
        self.clean = False
        self.command(np.full(4, NAN if byte % 2 else 50.0), sense=False, done=True)
        self.maybe_look(byte)

    def foreign(self, byte):
        self.clean = False
        command = [[0, 0, 0, 1], [NAN, 0, 0, 0], [0, 0, 0, 0], [10**6, 0, 0, 0]][byte % 4]
        self.latched |= byte % 4 != 2 or self.driving()
        self.governor.on_foreign_command(WheelCommand(np.array(command)), self.now)
        self.maybe_look(byte)

    def request(self, byte):
        """Mostly resets, after which there is a new controller where one is needed."""
        self.clean = False
        self.look()  # What stops and is reset between two looks, the judge would not understand.
        if byte % 4 == 0:
            self.latched = True
            self.governor.on_request(OperatorRequest(Request.STOP), self.now)
        else:
            self.latched &= self.now - self.arrived > AGE
            self.governor.on_request(OperatorRequest(Request.RESET), self.now)
            self.look()
            if self.session in self.over:
                self.session, self.sequence = self.session + 1, 0
        self.maybe_look(byte)

    # Parts of these.

    def step(self, command, way=(0.001, 0.0, 0.0), late=0.0, **fields):
        """One sample in which the robot moves, says so, and the controller answers."""
        self.advance(0.1)
        self.move(*way)
        self.odometry(late)
        self.command(np.array(command), **fields)
        self.look()

    def advance(self, seconds):
        """Time passes, and the guard looks every 50 ms at least."""
        looks = math.ceil(seconds / 0.05 - TINY)
        for _ in range(looks):
            self.now += seconds / looks
            self.look()

    def move(self, dx, dy, dyaw):
        if not self.frozen:
            self.pose = [self.pose[0] + dx, self.pose[1] + dy, self.pose[2] + dyaw]
            self.same_since = INF  # Until somebody has seen it.

    def odometry(self, late=0.0, stamp=None):
        self.hear_odometry(late)
        measured = self.now - late
        self.stamp = round(1e9 * (measured + self.clock)) if stamp is None else stamp
        x, y, yaw = self.pose
        pose = np.array([x, y, math.remainder(yaw, 2 * math.pi)])
        self.governor.on_odometry(Odometry(self.stamp, pose, np.zeros(3)), self.now)

    def command(self, command, *, sense=True, off=(0.0, 0.0, 0.0), turns=0, **fields):
        """The controller says something; whether it makes sense."""
        fields = {
            "session": self.session,
            "sequence": self.sequence,
            "reference": np.add(np.add(self.pose, off), (0.0, 0.0, 2 * math.pi * turns)),
            "odometry_stamp": self.stamp,
            "solve_failed": False,
        } | fields
        self.sequence = max(self.sequence, fields["sequence"]) + 1
        self.hear_command(command, sense, off, fields)
        self.governor.on_drive_command(DriveCommand(command=command, **fields), self.now)

    def maybe_look(self, byte):
        """Looks at once after half of all that happens."""
        if byte >= 128:
            self.look()


# What a byte stands for: mostly all is well, so that other things happen to a robot that drives.
EVENTS = [
    *[World.sample] * 88,
    *[World.delay] * 6,
    *[World.repeat] * 6,
    *[World.drift] * 10,
    *[World.block] * 8,
    *[World.fail] * 8,
    *[World.silence] * 8,
    *[World.wait] * 14,
    *[World.stall] * 4,
    *[World.good_odometry] * 16,
    *[World.lying_odometry] * 8,
    *[World.bad_odometry] * 12,
    *[World.good_command] * 12,
    *[World.zero_command] * 4,
    *[World.stray_command] * 12,
    *[World.bad_command] * 6,
    *[World.done] * 4,
    *[World.foreign] * 4,
    *[World.request] * 26,
]
assert len(EVENTS) == 256


def run(sequence: bytes) -> World:
    """Lets happen what pairs of bytes say: what, and of which kind."""
    world = World()
    for what, kind in zip(sequence[::2], sequence[1::2], strict=False):
        EVENTS[what](world, kind)
    world.look()
    return world
