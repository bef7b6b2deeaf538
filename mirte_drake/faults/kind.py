"""What a kind of fault is, and three ways to make one."""

import dataclasses as dc
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np

from mirte_drake.faults.bench import Bench
from mirte_drake.faults.injector import OdometryFault
from mirte_drake.faults.oracle import Oracle, last_good_odometry
from mirte_drake.faults.record import Record
from mirte_drake.faults.sabotage import Sabotage
from mirte_drake.hardware.link import Role
from mirte_drake.vectors import YAW

WITHIN = 0.25  # [s] From what makes a stop due to zero on the wire.
WITHIN_SIGNAL = 0.35  # [s] The same for SIGKILL and SIGSTOP.
USUAL_GAP = 0.15  # [s] Between two messages of odometry there is no more, unless one is missing.


@dc.dataclass(frozen=True)
class Step:
    """Something that is done a while after the fault began."""

    act: Callable[[Bench], None]
    after: float = 0.0  # [s]


@dc.dataclass(frozen=True)
class Kind:
    """One kind of fault, and what must come of it."""

    name: str
    outcome: str  # In words.
    oracle: Oracle
    reasons: tuple[str, ...]  # Of which the reason of a stop has one.
    within: float = WITHIN  # [s] To zero on the wire.
    odometry: OdometryFault | None = None
    sabotage: Sabotage | None = None
    steps: tuple[Step, ...] = ()
    # Who else is on the wire: an end in a role, or one who babbles as if it were such a message.
    strangers: tuple[Role | type, ...] = ()
    deafens: bool = False  # The guard is one that can be made deaf, none of the controller's.
    from_start: bool = False  # The fault is there before the drive begins.
    overrides: tuple[str, ...] = ()  # Of the scenario.
    begin: tuple[float, float] = (0.6, 1.5)  # [s] Of a drive, between which the fault begins.
    observe: float = 1.2  # [s] After the fault began.
    evidence: Callable[[Record], bool] | None = None  # Of the fault; None: see ``took_place``.

    def took_place(self, record: Record) -> bool:
        """Whether a trial shows the fault at all."""
        if self.evidence is not None:
            return self.evidence(record)
        if self.odometry is not None:
            return _is_altered(record)
        return bool(record.acted) or self.sabotage is None


def stops(
    name: str,
    since: str,
    reason: str | tuple[str, ...],
    oracle: Oracle,
    **more: Any,  # noqa: ANN401
) -> Kind:
    """Returns a kind that must stop the robot.

    Args:
        name: Its name.
        since: What makes the stop due, in words.
        reason: Words that the reason has, or several of which it has one.
        oracle: When the stop is due.
        more: Of Kind.
    """
    reasons = (reason,) if isinstance(reason, str) else reason
    within = more.get("within", WITHIN)
    return Kind(name, _due(within, since, reasons), oracle, reasons, **more)


def drives_on(name: str, **more: Any) -> Kind:  # noqa: ANN401
    """Returns a kind that must not stop the robot.

    A stop would be right all the same should the robot's process itself have been held up for so
    long that its odometry was old, which the oracle knows.
    """
    return Kind(name, "drives on", last_good_odometry, ("odometry is old",), **more)


def depends(
    name: str,
    when: str,
    reasons: tuple[str, ...],
    oracle: Oracle,
    **more: Any,  # noqa: ANN401
) -> Kind:
    """Returns a kind of which the oracle knows, for each trial, whether a stop is due.

    Args:
        name: Its name.
        when: When a stop is due, in words.
        reasons: Of which the reason of a stop has one.
        oracle: When the stop is due.
        more: Of Kind.
    """
    words = _due(WITHIN, when, reasons) + "; else drives on"
    return Kind(name, words, oracle, reasons, **more)


def _due(within: float, since: str, reasons: tuple[str, ...]) -> str:
    reason = " or ".join(filter(None, reasons)) or "nobody is left to tell"
    return f"zero within {within:g} s of {since}; reason: {reason}"


def yaw_crosses(record: Record) -> bool:
    """Whether the yaw jumps between pi and -pi while the robot drives."""
    yaws = [s.message.pose[YAW] for s in record.odometry if s.sent > record.start]
    return bool(np.any(np.abs(np.diff(yaws)) > np.pi))


def _is_altered(record: Record) -> bool:
    sent = [s for s in record.odometry if s.sent >= record.fault]
    before = [s.sent for s in record.odometry if s.sent < record.fault]
    times = [*before[-1:], *(s.sent for s in sent), record.end]
    gap = max(later - earlier for earlier, later in itertools.pairwise(times))
    return gap > USUAL_GAP or any(s.altered or not s.good for s in sent)
