"""The robot's end of a wire, with a fault between the robot and its odometry's way out."""

import dataclasses as dc
import heapq
import itertools
import time
from collections.abc import Callable

import numpy as np

from mirte_drake.faults.record import SentOdometry
from mirte_drake.hardware.link import Link
from mirte_drake.hardware.messages import Message, Odometry, WheelCommand


@dc.dataclass(frozen=True)
class Passing:
    """One message of odometry that a fault gets hold of."""

    odometry: Odometry
    number: int  # Since the fault began, from 0.
    before: Odometry  # The last one before the fault.
    previous: Odometry  # The last one.
    direction: np.ndarray  # (2,) Unit vector, the same throughout a trial.
    sign: int  # 1 or -1, the same throughout a trial.
    rng: np.random.Generator


@dc.dataclass(frozen=True)
class Sending:
    """What a fault lets out instead."""

    message: Odometry
    origin: Odometry  # What the robot measured.
    delay: float = 0.0  # [s]
    good: bool = True  # Whether it is one to be believed.


OdometryFault = Callable[[Passing], list[Sending]]


class FaultyLink(Link):
    """The robot's end of a wire, which records what passes and lets a fault alter the odometry.

    Attributes:
        fault: What is done to odometry; None: nothing.
        odometry: What was sent.
        commands: What was received.
    """

    def __init__(
        self,
        link: Link,
        rng: np.random.Generator,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begins without a fault.

        Args:
            link: The robot's end of the wire.
            rng: Draws what the fault leaves open.
            clock: [s] of the robot.
        """
        super().__init__(link.role)
        self._link, self._rng, self._clock = link, rng, clock
        # The robot stamps by wall time.
        self._wall = time.time_ns() - round(1e9 * clock())
        angle = rng.uniform(-np.pi, np.pi)
        self._direction = np.array([np.cos(angle), np.sin(angle)])
        self._sign = int(rng.choice([-1, 1]))
        self._queue: list[tuple[float, int, Sending]] = []
        self._order = itertools.count()
        self._before: Odometry | None = None
        self._previous: Odometry | None = None
        self._number = 0
        self.fault: OdometryFault | None = None
        self.odometry: list[SentOdometry] = []
        self.commands: list[WheelCommand] = []

    def wait(self, timeout: float) -> bool:
        """Returns as soon as something has come, True, or after ``timeout`` [s], False."""
        until = self._clock() + timeout
        while True:
            self._send_due()
            now = self._clock()
            due = self._queue[0][0] if self._queue else np.inf
            came = self._link.wait(max(min(until, due) - now, 0.0))
            for command in self._link.take(WheelCommand):
                self.commands.append(command)
                self._deliver(command)
            if came or self._clock() >= until:
                self._send_due()
                return came

    def send(self, message: Message) -> None:
        """Sends odometry, or what the fault makes of it."""
        assert isinstance(message, Odometry)
        sendings = [Sending(message, message)]
        if self.fault is None:
            self._before, self._number = message, 0
        else:
            sendings = self.fault(self._passing(message))
            self._number += 1
        self._previous = message
        now = self._clock()
        for sending in sendings:
            heapq.heappush(self._queue, (now + sending.delay, next(self._order), sending))
        self._send_due()

    def close(self) -> None:
        """Closes the robot's end of the wire."""
        self._link.close()

    def _passing(self, message: Odometry) -> Passing:
        return Passing(
            odometry=message,
            number=self._number,
            before=self._before or message,
            previous=self._previous or message,
            direction=self._direction,
            sign=self._sign,
            rng=self._rng,
        )

    def _send_due(self) -> None:
        now = self._clock()
        while self._queue and self._queue[0][0] <= now:
            _, _, sending = heapq.heappop(self._queue)
            self._link.send(sending.message)
            measured = 1e-9 * (sending.origin.stamp - self._wall)
            altered = sending.message is not sending.origin or sending.delay > 0
            self.odometry.append(
                SentOdometry(sending.message, measured, now, sending.good, altered)
            )
