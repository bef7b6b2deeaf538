"""What makes the next sample come: simulated time, or odometry on a wire."""

import signal
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import numpy as np
from pydrake.systems.framework import Context, Diagram

from mirte_drake.hardware.link import Link
from mirte_drake.hardware.messages import GuardStatus, Odometry

START_TIMEOUT = 5.0  # [s] For guard and robot to be heard of.
GUARD_TIMEOUT = 0.2  # [s] A guard that says nothing for so long is gone; it speaks every 0.05 s.
SLICE = 0.02  # [s] Waiting is cut into such pieces, to look after the guard.


class WireStopped(Exception):  # noqa: N818 It is how a drive ends, not always an error.
    """The drive must end; the text says why."""


class GuardLost(WireStopped):
    """The guard is gone: nobody but the controller can stop the wheels."""


class Pace:
    """Simulated time: the next sample is there at once."""

    def before(self, context: Context) -> None:
        """Returns when the next sample is due, its inputs set in the root ``context``."""

    def after(self, context: Context) -> Mapping[str, object]:
        """Does what is due once the command of a sample stands; returns more for the log."""
        return {}


class WirePace(Pace):
    """Samples come with fresh odometry, or a little after it should have come.

    The period between samples is that of the odometry, at least half a controller period, so that
    a burst of late messages does not hurry the reference on. A sample without fresh odometry
    comes ``grace`` after its time; the robot's adapter then predicts from older odometry, and how
    long that may go on is the guard's to say.
    """

    def __init__(
        self,
        diagram: Diagram,
        link: Link,
        *,
        period: float,
        grace: float = 0.02,
        clock: Callable[[], float] = time.monotonic,
        watch: Callable[[], object] = lambda: None,
        refuse: Callable[[Odometry], str | None] = lambda _: None,
        record: Callable[[Context], object] = lambda _: None,
    ) -> None:
        """Begins before the first sample.

        Args:
            diagram: With an input ``clock``.
            link: The controller's end of the wire.
            period: [s] sample time T_s.
            grace: [s] how long odometry may be late.
            clock: [s] that messages' times of arrival are of.
            watch: Called between pieces of waiting; may raise to end the drive.
            refuse: Says why odometry is of no use to begin with, or None.
            record: Called at each sample, once its command is on its way.
        """
        self._diagram, self._link, self._period, self._grace = diagram, link, period, grace
        self._clock, self._watch, self._refuse = clock, watch, refuse
        self._record = record
        self._expected = self._last = -np.inf
        self._seen = 0
        self._fresh = False

    def before(self, context: Context) -> None:
        """Waits for the sample.

        Raises:
            WireStopped: when the guard has stopped the robot, or is gone, or nothing is heard of
                guard or robot at the start.
        """
        if self._last == -np.inf:
            self._wait_for_company()
        self._fresh = self._wait_for_odometry()
        self._seen = self._link.count(Odometry)
        now = self._clock()
        self._expected = (now if self._fresh else self._expected) + self._period
        self._last = now
        self._diagram.GetInputPort("clock").FixValue(context, [now])

    def after(self, context: Context) -> Mapping[str, object]:
        """Sends the command; returns times of the sample."""
        self._diagram.ForcedPublish(context)
        odometry = self._link.latest(Odometry)
        assert odometry is not None
        since = odometry.arrival if self._fresh else self._last
        latency = self._clock() - since
        self._record(context)
        return {
            "clock": self._last,
            "fresh_odometry": self._fresh,
            "odometry_age_s": self._diagram.GetOutputPort("odometry_age").Eval(context)[0],
            "command_latency_s": latency,
        }

    def check_guard(self) -> None:
        """Raises WireStopped where the guard has stopped the robot or is gone."""
        self._link.wait(0.0)  # What came during a long solve has not been looked at yet.
        status = self._link.latest(GuardStatus)
        assert status is not None
        if status.stopped:
            raise WireStopped(status.reason)
        silence = self._clock() - status.arrival
        if silence > GUARD_TIMEOUT:
            raise GuardLost(f"the guard has said nothing for {silence:.2f} s")

    def _wait_for_company(self) -> None:
        start = self._clock()
        while missing := self._missing():
            self._watch()
            if self._clock() - start > START_TIMEOUT:
                raise WireStopped(f"{missing} for {START_TIMEOUT:g} s")
            self._link.wait(SLICE)
        # What came while nobody waited, as when the Diagram was built, may have gaps.
        self._link.take(Odometry)
        self._seen = self._link.count(Odometry)
        self._expected = self._clock() + self._period

    def _missing(self) -> str:
        """Returns what it takes to begin and is not there, or nothing."""
        odometry = self._link.latest(Odometry)
        if self._link.latest(GuardStatus) is None:
            return "no guard was heard"
        if odometry is None:
            return "no odometry was heard"
        reason = self._refuse(odometry)
        return f"odometry was of no use ({reason})" if reason else ""

    def _wait_for_odometry(self) -> bool:
        """Returns whether fresh odometry has come, after at least half a period."""
        while True:
            self._watch()
            self.check_guard()
            now = self._clock()
            earliest = self._last + 0.5 * self._period
            fresh = self._link.count(Odometry) > self._seen
            if fresh and now >= earliest:
                return True
            deadline = earliest if fresh else self._expected + self._grace
            if now >= deadline:
                return fresh
            self._link.wait(min(deadline - now, SLICE))


@contextmanager
def interruption() -> Iterator[Callable[[], None]]:
    """Yields a function that raises WireStopped once SIGINT or SIGTERM came; they do not."""
    received: list[int] = []
    signals = (signal.SIGINT, signal.SIGTERM)
    handlers = {number: signal.signal(number, lambda *_: received.append(1)) for number in signals}

    def watch() -> None:
        if received:
            raise WireStopped("interrupted")

    try:
        yield watch
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
