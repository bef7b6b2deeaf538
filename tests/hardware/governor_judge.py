"""A judge of the governor, who knows only what happened, not how the governor works.

It demands what a person with a stopwatch would, and shares no code with the governor.
"""

import cmath
import math

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


class Judge:
    """Remembers what was said to a governor, and looks at what that sends.

    Where it cannot know whether something was believed, it demands less, never more.
    """

    def __init__(self, governor, now, pose):
        self.governor, self.now = governor, now
        self.clock = 5e8  # [s] What the robot's is ahead.
        self.pose = pose  # Where the robot says it is; yaw not wrapped.
        # No stamp has lied so far, nor has the robot been silent for long, so that whatever it
        # said is accepted and its age is known.
        self.honest = True
        self.messages = 0  # Of odometry.
        self.arrived = self.measured = NEVER  # [s] The last odometry that makes sense.
        self.prompt = NEVER  # [s] The last of it that was not late.
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
        self.looked = now
        self.status = governor.output(now)[1]

    # What it hears.

    def expire(self):
        """Nothing that comes too late helps."""
        silence = self.now - self.heartbeat.get(self.status.session, NEVER)
        if self.driving() and max(silence, self.age()) > AGE + TINY:
            self.latched = True

    def age(self):
        """How old the odometry is at least."""
        return self.now - min(self.arrived, self.measured if self.honest else INF)

    def hear_odometry(self, late):
        """Hears odometry that makes sense, before the governor does."""
        self.expire()
        self.messages += 1
        # The window forgets, and a track may begin anew with a message that is late.
        lost = self.now - self.prompt > 0.9 and late > 0
        if lost or self.messages > 50:
            self.honest = False
        if late == 0:
            self.prompt = self.now
        self.arrived, self.measured = self.now, max(self.measured, self.now - late)
        self.same_since = min(self.same_since, self.now)
        heard = self.now - self.looked <= STALL  # By a governor that has not stalled.
        if self.driving() and self.honest and late == 0 and heard:
            frozen = self.now - max(self.same_since, self.pushed_since) > FROZEN + TINY
            self.latched |= self.outside() or frozen

    def hear_command(self, command, sense, off, fields):
        """Hears a command, before the governor does; and whether it makes sense.

        It asks for a reference that is off the robot.
        """
        self.expire()
        session, sequence = fields["session"], fields["sequence"]
        driving = self.driving()
        mine = driving and session == self.status.session
        self.latched |= driving and not mine
        if not driving:
            self.start[session] = list(self.pose)
        elif sequence <= self.highest.get(session, NEVER):
            return
        self.highest[session] = sequence
        if fields.get("done"):
            self.done_heard.add(session)
            if mine:
                self.over.add(session)
            return
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
            astray = math.hypot(off[0], off[1]) > OFF + TINY or abs(off[2]) > TURNED + TINY
            self.latched |= abs(ago) > AGE + TINY or astray

    # What it sees.

    def driving(self):
        """Whether a drive was under way at the last look, and nobody has ended it since."""
        session = self.status.session
        ended = self.status.stopped or session in self.over | self.done_heard
        return session != 0 and not ended

    def outside(self):
        x, y, yaw = self.start[self.status.session]
        turn = cmath.exp(1j * (START[2] - yaw))
        way = complex(self.pose[0] - x, self.pose[1] - y) * turn
        # It may have begun a message earlier or later than the governor, some millimetres away.
        return max(abs(way.real), abs(way.imag)) > REACH + 0.01

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
