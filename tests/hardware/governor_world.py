"""A world around a governor, and a judge that knows only what happened in it.

The judge demands what a person with a stopwatch would. It shares no code with the governor.
"""

import cmath
import math

import numpy as np

from mirte_drake.hardware.governor import Governor
from mirte_drake.hardware.governor_config import GovernorConfig
from mirte_drake.hardware.messages import (
    DriveCommand,
    Odometry,
    OperatorRequest,
    Request,
    WheelCommand,
)

AGE = 0.23  # [s] Limit of odometry and controller.
STALL = 0.1  # [s]
SLEW, SLEW_TIME = 300.0, 0.1  # [pwm/s], [s]
REACH = 0.4  # [m] Half a side of the allowed area.
OFF, TURNED = 0.5, 0.8  # [m], [rad]
BREAKAWAY, FROZEN = 40.0, 0.5  # [pwm], [s]
FAILURES = 3
STILL = [0, 0, 0, 0]
START = (0.1, -0.2, 0.5)
TINY = 1e-5  # What the float of a stamp loses is 2.4e-7 s.

NAN, INF = math.nan, math.inf
NEVER = -math.inf
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


class World:
    """A robot, controllers, an operator and others, a governor, and the judge's memory."""

    def __init__(self):
        area = np.array([START[0] - REACH, START[1] - REACH, START[0] + REACH, START[1] + REACH])
        config = GovernorConfig(allowed_area=area, slew_limit=SLEW)
        self.governor = Governor(config, np.array(START))
        self.now = 100.0
        self.clock = 5e8  # [s] What the robot's is ahead.
        self.pose = [1.0, -2.0, 3.0]  # Yaw not wrapped.
        self.frozen = False
        self.session, self.sequence = 1, 0
        self.stamp = 0  # [ns] of the last odometry.
        # The judge's. Honest: no stamp has lied so far, nor has the robot been silent for long,
        # so that whatever it said is accepted and its age is known.
        self.honest, self.clean = True, True
        self.messages = 0  # Of odometry.
        self.arrived = self.measured = NEVER  # [s] The last odometry that makes sense.
        self.same_since = self.pushed_since = INF
        self.highest = {}  # Sequence, by session.
        self.heartbeat = {}  # [s], by session.
        self.wanted = {}  # Commands, by session and sequence.
        self.failed = {}  # Solves in a row, by session.
        self.start = {}  # Poses, by session.
        self.over = set()  # Sessions that must not drive again.
        self.done_heard = set()  # Sessions that may be over.
        self.latched = False
        self.held = STILL
        self.passed, self.passed_at = (0, 0), NEVER
        self.looked = self.now
        self.status = self.governor.output(self.now)[1]

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
            if not self.honest or self.now - self.arrived > 0.9:  # It may be believed.
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

    def expire(self):
        """Nothing that comes too late helps."""
        silence = self.now - self.heartbeat.get(self.status.session, NEVER)
        if self.driving() and max(silence, self.age()) > AGE + TINY:
            self.latched = True

    def age(self):
        """How old the odometry is at least."""
        return self.now - min(self.arrived, self.measured if self.honest else INF)

    def odometry(self, late=0.0, stamp=None):
        self.expire()
        self.messages += 1
        silent = self.now - self.arrived > 0.9 if self.messages > 1 else late > 0
        if silent or self.messages > 50:  # The window forgets; a track may begin anew.
            self.honest = False
        measured = self.now - late
        self.arrived, self.measured = self.now, max(self.measured, measured)
        self.same_since = min(self.same_since, self.now)
        self.stamp = round(1e9 * (measured + self.clock)) if stamp is None else stamp
        x, y, yaw = self.pose
        pose = np.array([x, y, math.remainder(yaw, 2 * math.pi)])
        stalled = self.now - self.looked > STALL
        self.governor.on_odometry(Odometry(self.stamp, pose, np.zeros(3)), self.now)
        if self.driving() and self.honest and late == 0 and not stalled:
            self.latched |= self.outside()
            self.latched |= self.now - max(self.same_since, self.pushed_since) > FROZEN + TINY

    def command(self, command, *, sense=True, off=(0.0, 0.0, 0.0), turns=0, **fields):
        """The controller says something; whether it makes sense."""
        self.expire()
        session = fields.setdefault("session", self.session)
        sequence = fields.setdefault("sequence", self.sequence)
        self.sequence = max(self.sequence, sequence) + 1
        reference = np.add(np.add(self.pose, off), (0.0, 0.0, 2 * math.pi * turns))
        fields = {"reference": reference, "odometry_stamp": self.stamp} | fields
        fields.setdefault("solve_failed", False)
        driving = self.driving()
        if driving and session != self.status.session:
            self.latched = True
        if not driving:
            self.start[session] = list(self.pose)
        if not driving or sequence > self.highest.get(session, NEVER):
            self.highest[session] = sequence
            self.hear(command, session, sequence, driving, sense, off, fields)
        self.governor.on_drive_command(DriveCommand(command=command, **fields), self.now)

    def hear(self, command, session, sequence, driving, sense, off, fields):
        """The judge hears a command that is not a repetition."""
        if fields.get("done"):
            self.done_heard.add(session)
            if driving and session == self.status.session:
                self.over.add(session)
            return
        mine = driving and session == self.status.session
        if not sense:
            self.latched |= mine
            return
        self.heartbeat[session] = self.now
        self.wanted.setdefault((session, sequence), []).append(command)
        failed = self.failed.get(session, 0) + 1 if mine and fields["solve_failed"] else 0
        self.failed[session] = failed
        self.latched |= mine and failed >= FAILURES
        if mine and self.honest:
            ago = self.now + self.clock - 1e-9 * fields["odometry_stamp"]
            self.latched |= abs(ago) > AGE + TINY
            astray = math.hypot(off[0], off[1]) > OFF + TINY or abs(off[2]) > TURNED + TINY
            self.latched |= astray

    def maybe_look(self, byte):
        """Looks at once after half of all that happens."""
        if byte >= 128:
            self.look()

    # The judge.

    def driving(self):
        """Whether a drive was under way at the last look, and nobody has ended it since."""
        session = self.status.session
        ended = self.status.stopped or session in self.over | self.done_heard
        return session != 0 and not ended

    def outside(self):
        x, y, yaw = self.start[self.status.session]
        turn = cmath.exp(1j * (START[2] - yaw))
        way = complex(self.pose[0] - x, self.pose[1] - y) * turn
        return max(abs(way.real), abs(way.imag)) > REACH + TINY

    def look(self):
        """The guard looks at the governor, and the judge at what it sends."""
        was_driving, before = self.driving(), self.status
        stalled = self.now - self.looked > STALL + TINY
        self.looked = self.now
        command, self.status = self.governor.output(self.now)
        if command is not None:
            self.judge_command(command)
        status = self.status
        assert status.command.tolist() == self.held
        assert bool(status.reason) == status.stopped

        silence = self.now - self.heartbeat.get(status.session, NEVER)
        must_stop = max(silence, self.age()) > AGE + TINY or (stalled and was_driving)
        if must_stop or self.latched or status.stopped or status.session in self.over:
            assert self.held == STILL, "the wheels turn where they must not"
        if self.latched or (was_driving and must_stop):
            assert status.stopped, "no stop where one is due"
        if status.stopped:
            self.latched = True
            self.over.add(status.session)
        if before.session != status.session:
            self.over.add(before.session)

    def judge_command(self, command):
        assert command.shape == (4,)
        assert command.dtype.kind == "i"
        command = command.tolist()
        number = self.status.session, self.status.sequence
        new = number != self.passed and number in self.wanted
        if command != STILL:
            assert new, "a command that nobody gave"
            assert max(map(abs, command)) <= 100
            assert any(self.is_towards(wanted, command) for wanted in self.wanted[number])
            first = number[0] != self.passed[0]
            elapsed = SLEW_TIME if first else min(self.now - self.passed_at, SLEW_TIME)
            change = max(abs(u - held) for u, held in zip(command, self.held, strict=True))
            assert change <= SLEW * elapsed + TINY
        if new:
            self.passed, self.passed_at = number, self.now
        self.held = command
        u1, u2, u3, u4 = command
        useless = (u1 + u2 - u3 - u4) / 4
        pushing = math.sqrt(max(sum(u * u for u in command) / 4 - useless**2, 0.0))
        if pushing < BREAKAWAY - TINY:
            self.pushed_since = INF
        elif self.pushed_since == INF:
            self.pushed_since = self.now

    def is_towards(self, wanted, command):
        """Whether a command is what was wanted, or between that and the one before."""
        whole = [min(max(round(u), -100), 100) for u in wanted]
        both = zip(self.held, whole, command, strict=True)
        return all(min(held, u) <= sent <= max(held, u) for held, u, sent in both)


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
