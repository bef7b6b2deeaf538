"""Records what is driven: to a bag, and to whoever looks on."""

import sys
import time
from collections.abc import Iterable, Sequence
from typing import Protocol

import numpy as np
from pydrake.systems.framework import Context, Diagram

from mirte_drake.hardware.link import Link
from mirte_drake.hardware.messages import NOTHING, GuardStatus, Message, Odometry, WheelCommand
from mirte_drake.hardware.ros2_messages import Encoded, Ros2Messages


class Sink(Protocol):
    """Where messages go: a BagRecorder, a FoxgloveLive."""

    def write(self, encoded: Iterable[Encoded]) -> None:
        """Takes messages; OSError where it cannot."""


class DriveRecorder:
    """Gives the messages of a drive, once a sample, to its sinks.

    Odometry and guard status are as they came over the wire, wheel commands as the guard says that
    it sent them. A sink that fails is given up with one line on stderr: the drive goes on.
    """

    def __init__(self, messages: Ros2Messages, sinks: Sequence[Sink]) -> None:
        """Begins with nothing recorded.

        Args:
            messages: Of the bag.
            sinks: Where they go.
        """
        self._messages, self._sinks = messages, list(sinks)
        self._wall = time.time_ns() - time.monotonic_ns()
        self._last: GuardStatus | None = None  # Whose wheel command was recorded.

    def record(self, link: Link, diagram: Diagram, context: Context) -> None:
        """Records a sample, whose command is on its way.

        Args:
            link: The controller's end of the wire.
            diagram: With the outputs ``drive_command`` and ``plan_view``.
            context: Its root Context.
        """
        if not self._sinks:
            return
        now = time.monotonic()
        timed: list[tuple[float, Message]] = [(m.arrival, m) for m in link.take(Odometry)]
        for status in link.take(GuardStatus):
            timed.append((status.arrival, status))
            if self._is_new_command(status):
                timed.append((status.arrival, WheelCommand(status.command)))
        for port in ("drive_command", "plan_view"):
            message = diagram.GetOutputPort(port).Eval(context)
            if message != NOTHING:
                timed.append((now, message))
        timed.sort(key=lambda entry: entry[0])
        encoded = [e for arrival, m in timed for e in self._encode(m, arrival)]
        for sink in list(self._sinks):
            try:
                sink.write(encoded)
            except OSError as error:
                self._sinks.remove(sink)
                print(f"recording ends: {error.strerror or error}", file=sys.stderr)

    def _is_new_command(self, status: GuardStatus) -> bool:
        last, self._last = self._last, status
        return (
            last is None
            or status.sequence != last.sequence
            or not np.array_equal(status.command, last.command)
        )

    def _encode(self, message: Message, arrival: float) -> list[Encoded]:
        return self._messages.encode(message, self._wall + round(1e9 * arrival))
