"""When a stop is due, by what was really on the wire; independent of the governor's own code.

Each rule takes a Record and returns an Expectation. Limits are those that are promised: a stop at
odometry older than 0.25 s, and so on; where what happened lies within a measuring error of the
limit, either outcome is right.
"""

import dataclasses as dc
import itertools
from collections.abc import Callable, Iterator

import numpy as np

from mirte_drake.faults.record import Record, SentOdometry
from mirte_drake.vectors import WHEELS, YAW

MAX_AGE = 0.25  # [s] Odometry that is older must not drive the robot.
# [s] The governor gives up earlier than that, at 0.23 s, to be on the wire in time. It counts from
# the fastest message, so to it none is older than it is.
EARLIEST_AGE = 0.23
FROZEN_TIME = 0.5  # [s] That the wheels may push while the odometry stays the same.
BREAKAWAY = 40.0  # [pwm] What pushes enough for any robot to move.
MAX_DISTANCE = 0.5  # [m] From the reference.
DISTANCE_ERROR = 0.03  # [m] With which the reference is known here: it moves 0.01 m a sample.
PLACE_ERROR = 0.005  # [m]
# How wheels push together: forward, to the left, and around.
PUSHES = np.array([[1, 1, 1, 1], [-1, 1, -1, 1], [-1, 1, 1, -1]])


@dc.dataclass(frozen=True)
class Expectation:
    """What must come of a trial."""

    since: float = np.inf  # [s] the instant that makes a stop due; inf: there is none.
    allowed: bool = False  # Whether a stop is right as well where none is due.

    @property
    def due(self) -> bool:
        """Whether a stop is due."""
        return bool(np.isfinite(self.since))


Oracle = Callable[[Record], Expectation]
DRIVES_ON = Expectation()


def last_good_odometry(record: Record) -> Expectation:
    """A stop is due from the last good odometry on, if the next one is too late."""
    oldest = 0.0
    for age, measured in _ages(record):
        if age > MAX_AGE:
            return Expectation(measured)
        oldest = max(oldest, age)
    return Expectation(allowed=oldest > EARLIEST_AGE)


def at_fault(record: Record) -> Expectation:
    """A stop is due when the fault begins."""
    return Expectation(record.fault)


def last_heartbeat(record: Record) -> Expectation:
    """A stop is due from the last command on that came before the controller fell silent."""
    silent = record.acted[0] if record.acted else record.fault
    before = [command.arrival for command in record.commands if command.arrival <= silent]
    return Expectation(before[-1]) if before else DRIVES_ON


def act_number(number: int) -> Oracle:
    """Returns an oracle: a stop is due at the n-th act of sabotage, counted from 1."""

    def when(record: Record) -> Expectation:
        acted = record.acted
        return Expectation(acted[number - 1]) if len(acted) >= number else DRIVES_ON

    return when


def swapped_odometry(record: Record) -> Expectation:
    """A stop is right where a command answers odometry that is too old, though newer came before.

    The controller takes the last message that came for the newest one. Nothing is due that is not
    by ``last_good_odometry``.
    """
    expected = last_good_odometry(record)
    return dc.replace(expected, allowed=expected.allowed or _answers_old(record))


def frozen_odometry(record: Record) -> Expectation:
    """A stop is due when wheels have pushed for a while and the odometry has stayed the same."""
    since = _same_since(record.odometry)
    pushing = np.inf
    for command, until in _with_ends(record):
        pushing = min(pushing, command.arrival) if push(command.command) >= BREAKAWAY else np.inf
        due = max(since, pushing) + FROZEN_TIME
        if due < until:
            return Expectation(due)
    return DRIVES_ON


def outside(x_max: float) -> Oracle:
    """Returns an oracle: a stop is due at the first odometry beyond ``x_max`` [m]."""

    def when(record: Record) -> Expectation:
        beyond = [(sent.sent, sent.message.pose[0] - x_max) for sent in record.odometry]
        return _at_first_beyond(beyond, PLACE_ERROR)

    return when


def off_reference(poses: np.ndarray, period: float) -> Oracle:
    """Returns an oracle: a stop is due at the first odometry too far from the reference.

    Args:
        poses: (N, 3) [m, m, rad] reference, in the frame of the odometry.
        period: [s] between them.
    """

    def when(record: Record) -> Expectation:
        beyond = []
        for sent in record.odometry:
            sample = np.clip(round((sent.sent - record.start) / period), 0, len(poses) - 1)
            distance = np.linalg.norm((sent.message.pose - poses[sample])[:YAW])
            beyond.append((sent.sent, float(distance) - MAX_DISTANCE))
        return _at_first_beyond(beyond, DISTANCE_ERROR)

    return when


def push(command: np.ndarray) -> float:
    """Returns the command [pwm] of four wheels alike that pushes as much as this one (4,)."""
    return float(np.linalg.norm(PUSHES @ command)) / len(WHEELS)


def _at_first_beyond(beyond: list[tuple[float, float]], error: float) -> Expectation:
    """Returns that a stop is due when a limit is first passed, if it is by more than an error.

    Args:
        beyond: When [s], and by how much a limit is passed.
        error: With which the latter is known.
    """
    most = max((distance for _, distance in beyond), default=-np.inf)
    if most <= error:
        return Expectation(allowed=most > -error)
    return Expectation(next(time for time, distance in beyond if distance > 0))


def _ages(record: Record) -> Iterator[tuple[float, float]]:
    """Yields how old the good odometry had become each time when better came, and at the end.

    Yields:
        Its age [s], and when it was measured [s].
    """
    fresh = np.inf
    for sent in record.odometry:
        if not sent.good or (np.isfinite(fresh) and sent.measured <= fresh):
            continue
        if np.isfinite(fresh) and sent.sent > record.start:
            yield sent.sent - fresh, fresh
        fresh = sent.measured
    yield record.end - fresh, fresh


def _answers_old(record: Record) -> bool:
    """Whether the message that came last was too old when a command came."""
    oldest = 0.0
    for command in record.commands:
        came = [sent.measured for sent in record.odometry if sent.sent < command.arrival]
        if command.arrival > record.fault and came:
            oldest = max(oldest, command.arrival - came[-1])
    return oldest > EARLIEST_AGE


def _same_since(odometry: list[SentOdometry]) -> float:
    """Returns when the first of the messages was sent that have the last one's values."""
    since = np.inf
    for earlier, later in itertools.pairwise(odometry):
        same = np.array_equal(earlier.message.pose, later.message.pose) and np.array_equal(
            earlier.message.body_velocity, later.message.body_velocity
        )
        since = min(since, earlier.sent) if same else np.inf
    return since


def _with_ends(record: Record) -> Iterator[tuple]:
    """Yields every wheel command with the time when the next one took its place."""
    ends = [command.arrival for command in record.commands[1:]]
    yield from zip(record.commands, [*ends, record.end], strict=True)
