"""A simulated robot as a process of its own, which behaves on the wire like a MIRTE Master."""

import dataclasses as dc
import time
from collections.abc import Callable

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from mirte_drake.hardware.link import Link
from mirte_drake.hardware.messages import Odometry, WheelCommand
from mirte_drake.robot_assembly import MakeRobot
from mirte_drake.scenario import Scenario
from mirte_drake.vectors import WHEELS

PERIOD = 0.1  # [s] Of the robot's odometry.
ROUND_OFF = 1e-6  # [s] Of times that a clock which runs for years tells.
CHUNK = 0.01  # [s] Simulated time lags the clock by no more, so that odometry is there when due.


@dc.dataclass
class StandInLog:
    """What a stand-in has seen; it grows while the robot runs."""

    odometry_sent: int = 0
    commands: int = 0
    # [s] From odometry on the wire to the wheel command that answers it, while the robot drives.
    latencies: list[float] = dc.field(default_factory=list)


class StandIn:
    """Any robot of ours on a wire: odometry at 10 Hz; the last wheel command persists.

    It stands still, and its simulated time with it, until the first command that is not zero. From
    then on time is that of the clock. There is no watchdog: as with the real robot, the last
    command holds if its sender dies.
    """

    def __init__(
        self, scenario: Scenario, link: Link, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Builds the robot.

        Args:
            scenario: Its robot, start pose, disturbance and odometry.
            link: The robot's end of the wire.
            clock: [s] of the robot.

        Raises:
            ValueError: when the robot cannot be built; UserError is one.
        """
        self._diagram = MakeRobot(scenario)
        self._link, self._clock = link, clock
        self._simulator = Simulator(self._diagram)
        self._simulator.get_mutable_integrator().set_target_accuracy(scenario.accuracy)
        self._context = self._simulator.get_mutable_context()
        self._command = np.zeros(len(WHEELS))
        self._diagram.GetInputPort("wheel_command").FixValue(self._context, self._command)
        self._warm_up()
        self._simulator.Initialize()
        self._start: float | None = None  # Of simulated time on the clock.
        self._next = clock()  # When odometry is due.
        self._sent_at = -np.inf
        self._wall = time.time_ns() - round(1e9 * clock())  # Stamps are wall time.
        self.log = StandInLog()

    @property
    def pose(self) -> np.ndarray:
        """True pose (3,) [m, m, rad]."""
        return self._diagram.GetOutputPort("true_pose").Eval(self._context)

    @property
    def command(self) -> np.ndarray:
        """Wheel command (4,) [pwm] in force."""
        return self._command

    def step(self) -> None:
        """Waits a little, for a command or odometry to be due, and does what is due.

        Of odometry that has become late, because the process was held up, only the first is sent.
        """
        now = self._clock()
        self._link.wait(max(min(self._next - now, CHUNK), 0.0))
        for message in self._link.take(WheelCommand):
            if message.arrival >= self._next:
                self._send_odometry()
            self._obey(message)
        now = self._clock()
        if now >= self._next:
            self._send_odometry()
        self._advance(now)
        while self._next <= now:
            self._next += PERIOD

    def _warm_up(self) -> None:
        """Moves a copy for one period: compiling a model, or loading it, would delay odometry."""
        context = self._context.Clone()
        self._diagram.GetInputPort("wheel_command").FixValue(context, np.ones(len(WHEELS)))
        Simulator(self._diagram, context).AdvanceTo(PERIOD)
        self._odometry(context)

    def _odometry(self, context: Context) -> tuple[np.ndarray, np.ndarray]:
        pose, velocity = (
            self._diagram.GetOutputPort(port).Eval(context) for port in ("pose", "body_velocity")
        )
        return pose, velocity

    def _send_odometry(self) -> None:
        self._advance(self._next)
        stamp = self._wall + round(1e9 * self._next)
        self._link.send(Odometry(stamp, *self._odometry(self._context)))
        self._next += PERIOD
        self._sent_at = self._clock()
        self.log.odometry_sent += 1

    def _obey(self, message: WheelCommand) -> None:
        self.log.commands += 1
        if self._start is None and np.any(message.command):
            # From the last odometry on, so that its samples stay in step with it.
            self._start = self._next - PERIOD
        self._advance(message.arrival)
        self._command = np.clip(message.command, -100, 100)
        self._diagram.GetInputPort("wheel_command").FixValue(self._context, self._command)
        if np.any(self._command) and self._sent_at > -np.inf:
            self.log.latencies.append(message.arrival - self._sent_at)
            self._sent_at = -np.inf

    def _advance(self, now: float) -> None:
        if self._start is None:
            return
        simulated = now - self._start
        # To the time of a sample, not beyond it by the clock's round-off, which grows with its
        # reading: odometry is of before the updates of that instant.
        sample = PERIOD * round(simulated / PERIOD)
        if abs(simulated - sample) < ROUND_OFF:
            simulated = sample
        if simulated > self._context.get_time():
            self._simulator.AdvanceTo(simulated)
