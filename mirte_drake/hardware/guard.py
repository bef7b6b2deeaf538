"""The guard: the last one before the wire, who alone sends commands to the wheels.

It runs the safety governor in a process of its own, so that the wheels stand still whatever becomes
of the controller.
"""

import contextlib
import math
import os
import select
import time
from collections.abc import Callable

import numpy as np

from mirte_drake.hardware.governor import Governor, Phase
from mirte_drake.hardware.governor_config import GovernorConfig
from mirte_drake.hardware.link import Link
from mirte_drake.hardware.messages import (
    DriveCommand,
    GuardStatus,
    Odometry,
    OperatorRequest,
    WheelCommand,
)
from mirte_drake.hardware.wheel_limits import STILL

LOOK = 0.01  # [s] Longest time between two looks at the governor.
# [s] after which zeros and the status are sent again: with a look, every 0.05 s.
REPEAT = 0.04
LAST_WORDS = 3  # Times that it says at its end that the wheels stand still; one may be lost.
STDERR = 2  # File descriptor.


class _Guard:
    """A governor, and what it says put on the wire."""

    def __init__(
        self, link: Link, config: GovernorConfig, start: np.ndarray, clock: Callable[[], float]
    ) -> None:
        self._link, self._clock = link, clock
        self._governor = Governor(config, start)
        self._command: np.ndarray | None = None  # Last sent, and the status.
        self._status: GuardStatus | None = None
        self._command_at = self._status_at = -math.inf  # [s] when that was.
        self._logged = ""

    def look(self) -> None:
        """Waits a little, hears what has come, and sends what is due."""
        self._link.wait(LOOK)
        link, governor, now = self._link, self._governor, self._clock()
        for odometry in link.take(Odometry):
            governor.on_odometry(odometry, now)
        for request in link.take(OperatorRequest):
            governor.on_request(request, now)
        for foreign in link.take(WheelCommand):
            governor.on_foreign_command(foreign, now)
        for command in link.take(DriveCommand):
            governor.on_drive_command(command, now)
        self._send(*governor.output(now), now)

    def fail(self, error: Exception) -> None:
        """Stops the robot when something has failed that never should."""
        reason = f"the guard failed: {type(error).__name__}: {error}"
        self._governor.stop(reason)
        with contextlib.suppress(Exception):
            self._link.send(WheelCommand(STILL))
        self._log(reason)
        time.sleep(LOOK)  # It may be waiting that fails.

    def end(self) -> None:
        """Leaves the wheels still, and says so."""
        if self._governor.phase is Phase.DRIVING:
            self._governor.stop("the guard was ended")
        for _ in range(LAST_WORDS):
            with contextlib.suppress(Exception):
                self._link.send(WheelCommand(STILL))
                self._link.send(self._governor.output(self._clock())[1])
                self._link.wait(LOOK)

    def _send(self, command: np.ndarray | None, status: GuardStatus, now: float) -> None:
        """Sends what is new at once, and zeros and the status again from time to time."""
        if command is not None:
            still = self._command is not None and not (command.any() or self._command.any())
            if not still or now - self._command_at >= REPEAT:
                self._link.send(WheelCommand(command))
                self._command, self._command_at = command, now
        same = self._status is not None and _content(status) == _content(self._status)
        if not same or now - self._status_at >= REPEAT:
            self._link.send(status)
            self._status, self._status_at = status, now
        self._log(status.reason)

    def _log(self, reason: str) -> None:
        """Writes a new reason as one line on stderr, unless that would have to wait.

        A terminal that is held, or a pipe that nobody reads, must not hold the guard.
        """
        if reason not in ("", self._logged):
            line = f"guard: stopped: {' '.join(reason.split())}\n"
            with contextlib.suppress(OSError, ValueError):
                if select.select([], [STDERR], [], 0)[1]:
                    os.write(STDERR, line.encode())
        self._logged = reason


def _content(status: GuardStatus) -> tuple:
    """What is sent at once when it changes."""
    return status.session, status.sequence, status.stopped, status.reason, status.rejected


def run_guard(
    link: Link,
    config: GovernorConfig,
    start: np.ndarray,
    *,
    clock: Callable[[], float] = time.monotonic,
    on_ready: Callable[[], None] = lambda: None,
    until: Callable[[], bool] = lambda: False,
) -> None:
    """Guards the robot at one end of a wire; at its end, however it comes, the wheels stand still.

    Args:
        link: The end of the wire, with the role GUARD.
        config: Limits of the governor.
        start: (3,) [m, m, rad] pose of the path where a drive begins.
        clock: Time [s], the same for all ages.
        on_ready: Called once, when the first zeros have been sent.
        until: Tells whether to end; asked at every look.

    Raises:
        ValueError: when ``config`` or ``start`` is out of range; then nothing is sent.
    """
    guard = _Guard(link, config, start, clock)
    try:
        link.send(WheelCommand(STILL))
        on_ready()
        while not until():
            try:
                guard.look()
            except Exception as error:
                guard.fail(error)
    finally:
        guard.end()
