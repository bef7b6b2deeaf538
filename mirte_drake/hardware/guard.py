"""The guard: the process between controller and wheels, which has the last word on the wire.

``python -m mirte_drake.hardware.guard`` reads a GuardOrder as YAML from its standard input.
"""

import contextlib
import dataclasses as dc
import gc
import os
import signal
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from mirte_drake.checks import check_parts
from mirte_drake.errors import UserError
from mirte_drake.hardware.governor import Governor, Phase
from mirte_drake.hardware.governor_config import GovernorConfig
from mirte_drake.hardware.link import Link, Role
from mirte_drake.hardware.messages import (
    DriveCommand,
    GuardStatus,
    Odometry,
    OperatorRequest,
    WheelCommand,
)
from mirte_drake.hardware.wire_config import LcmWireConfig, Ros2WireConfig, open_link
from mirte_drake.typed_yaml import parse_typed
from mirte_drake.vectors import POSE_SIZE, WHEELS

POLL = 0.01  # [s] Longest time between two looks at the limits.
REPEAT = 0.05  # [s] Between zeros while the wheels stand, and between statuses at the most.
LINGER = 5.0  # [s] For which a guard of one session goes on with zeros when that is over.
FAREWELL = 5  # Zeros sent at the end, REPEAT apart.
READY = "ready"  # Said on standard output once the wire is open.


@dc.dataclass
class GuardOrder:
    """What a guard needs to know."""

    wire: Ros2WireConfig | LcmWireConfig = dc.field(default_factory=Ros2WireConfig)
    governor: GovernorConfig = dc.field(default_factory=GovernorConfig)
    start: np.ndarray = dc.field(default_factory=lambda: np.zeros(POSE_SIZE))  # [m, m, rad]

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_parts(self)


class Guard:
    """Feeds a Governor from a Link and sends what it gives; the wheels stand while in doubt."""

    def __init__(
        self,
        link: Link,
        governor: Governor,
        *,
        clock: Callable[[], float] = time.monotonic,
        log: Callable[[str], object] = lambda line: print(line, file=sys.stderr, flush=True),
    ) -> None:
        """Begins with nothing sent.

        Args:
            link: The guard's end of the wire.
            governor: Decides.
            clock: [s]
            log: Takes one line for each stop.
        """
        self._link, self._governor, self._clock, self._log = link, governor, clock, log
        self._repeat_at = self._status_at = -np.inf
        self._sent = np.full(len(WHEELS), np.nan)  # Nothing yet.
        self._stopped = False
        self.resting_since = clock()  # [s] When the wheels were last told to stand; inf: they move.

    def step(self) -> None:
        """Waits a little for messages, and sends what follows from them and from the time."""
        self._link.wait(POLL)
        try:
            self._hear()
            command, status = self._governor.output(self._clock())
        except Exception as error:  # Whatever it is, the wheels must not turn because of it.
            self._governor.stop(f"error in the guard: {error!r}")
            command, status = self._governor.output(self._clock())
        now = self._clock()
        moves = command is not None and bool(np.any(command))
        changed = command is not None and not np.array_equal(command, self._sent)
        if command is not None and (moves or changed or now >= self._repeat_at):
            self._link.send(WheelCommand(command))
            self._sent, self._repeat_at = command, now + REPEAT
        if changed or moves or now >= self._status_at or status.stopped != self._stopped:
            self._link.send(status)
            self._status_at = now + REPEAT
        self._tell(status)
        if np.any(status.command):
            self.resting_since = np.inf
        elif self.resting_since == np.inf:
            self.resting_since = now

    def say_farewell(self) -> None:
        """Sends zeros some times over, before the process ends."""
        for _ in range(FAREWELL):
            self._link.send(WheelCommand(np.zeros(len(WHEELS))))
            time.sleep(REPEAT)

    def _hear(self) -> None:
        governor = self._governor
        # Odometry first: what it says must be known when a command is judged.
        heard: tuple[tuple[type[Any], Callable[[Any, float], None]], ...] = (
            (Odometry, governor.on_odometry),
            (WheelCommand, governor.on_foreign_command),
            (DriveCommand, governor.on_drive_command),
            (OperatorRequest, governor.on_request),
        )
        for kind, tell in heard:
            for message in self._link.take(kind):
                tell(message, self._clock())

    def _tell(self, status: GuardStatus) -> None:
        if status.stopped and not self._stopped:
            self._log(f"guard: stopped: {status.reason}")
        self._stopped = status.stopped


def run_guard(
    link: Link,
    config: GovernorConfig,
    start: np.ndarray,
    *,
    one_session: bool = False,
    on_ready: Callable[[], object] = lambda: None,
) -> None:
    """Guards until SIGINT or SIGTERM; the wheels stand when it returns.

    Args:
        link: The guard's end of the wire.
        config: Limits.
        start: (3,) [m, m, rad] where the path begins.
        one_session: Whether it belongs to the process that started it: it ends by itself when the
            wheels have been at rest for ``LINGER`` after the session, or after that process.
        on_ready: Called once it guards.

    Raises:
        ValueError: when ``config`` or ``start`` is out of range.
    """
    governor = Governor(config, start)
    guard = Guard(link, governor)
    ends: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: ends.append(number))
    _become_urgent()
    parent = os.getppid()
    on_ready()
    while not ends:
        guard.step()
        over = governor.phase in (Phase.FINISHED, Phase.STOPPED) or os.getppid() != parent
        if one_session and over and time.monotonic() - guard.resting_since > LINGER:
            break
    guard.say_farewell()


def _become_urgent() -> None:
    """Keeps others, and the garbage collector, from holding the process up, where it may."""
    gc.collect()
    gc.freeze()
    with contextlib.suppress(OSError, AttributeError):
        os.nice(-10)
    with contextlib.suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))


def main() -> None:
    """Guards one session as ordered on standard input; exit code 2 where that is no use."""
    try:
        order = parse_typed(GuardOrder, sys.stdin.read(), "guard")
        order.validate()
        with open_link(order.wire, Role.GUARD) as link:
            run_guard(
                link,
                order.governor,
                order.start,
                one_session=True,
                on_ready=lambda: print(READY, flush=True),
            )
    except (UserError, ValueError) as error:
        print(error, file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
