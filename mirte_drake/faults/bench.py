"""The bench of one trial: robot, guard and controller on a wire, and what can be done to them."""

import os
import signal
import time
from typing import Self

import numpy as np

from mirte_drake.faults.babbler import join_wire
from mirte_drake.faults.injector import FaultyLink
from mirte_drake.faults.processes import (
    be_punctual,
    child_of,
    controller_process,
    fork_server,
    guard_process,
    is_alive,
    waiting_time,
)
from mirte_drake.faults.record import Record
from mirte_drake.faults.sabotage import Orders, Sabotage
from mirte_drake.hardware.link import Role
from mirte_drake.hardware.messages import (
    DriveCommand,
    GuardStatus,
    OperatorRequest,
    Request,
    WheelCommand,
)
from mirte_drake.hardware.wire_config import open_link
from mirte_drake.scenario import Scenario, wired_robot
from mirte_drake.stand_in import StandIn
from mirte_drake.vectors import WHEELS

# [pwm] None that a controller is likely to send.
FOREIGN_COMMAND = np.array([7.0, 11.0, 13.0, 9.0])
HUGE_COMMAND = np.full(len(WHEELS), 1e9)  # [pwm]


class Bench:
    """Robot and operator in this process, guard and controller in two of their own.

    Attributes:
        robot: The robot's end of the wire, where its odometry can be altered.
        orders: To the controller's solver and to the guard.
        record: What was seen so far.
    """

    def __init__(
        self,
        scenario: Scenario,
        robot: Scenario,
        sabotage: Sabotage | None,
        strangers: tuple[Role | type, ...],
        rng: np.random.Generator,
        *,
        own_guard: bool,
        deafens: bool,
    ) -> None:
        """Puts all of them on the wire.

        Args:
            scenario: What is driven; its robot is beyond a wire.
            robot: Whose robot is on the wire.
            sabotage: What the controller's solver can be ordered to do.
            strangers: Who else is on the wire, silent so far: another end in a role, or someone
                who babbles where messages of a kind are expected.
            rng: Draws what a fault leaves open.
            own_guard: Whether the controller starts the guard, as `mirte-drake drive` does; else
                one runs already, as with `drive --running-guard`.
            deafens: Whether the latter can be made deaf.
        """
        wire = wired_robot(scenario).wire
        self.record = Record()
        self.robot = FaultyLink(open_link(wire, Role.ROBOT), rng)
        self._operator = open_link(wire, Role.OPERATOR)
        self._strangers = [open_link(wire, s) for s in strangers if isinstance(s, Role)]
        self._babblers = [join_wire(wire, s) for s in strangers if not isinstance(s, Role)]
        self._rng = rng
        self._scenario = robot
        self._stand_in = StandIn(robot, self.robot)
        context = fork_server()
        self.orders = Orders(context)
        self._told, told = context.Pipe(duplex=False)
        self._guard = None
        if not own_guard:
            self._guard = context.Process(
                target=guard_process, args=(scenario, deafens, self.orders)
            )
            self._guard.start()
        self._controller = context.Process(
            target=controller_process, args=(scenario, own_guard, sabotage, self.orders, told)
        )
        self._controller.start()
        told.close()
        self._own_guard: int | None = None
        self._watched = {"robot": os.getpid()}
        self._waited: dict[str, float] = {}
        be_punctual(True)

    def run(self, until: float) -> None:
        """Lets the robot run, and looks on, until a time [s]."""
        while (begun := time.monotonic()) < until:
            self._stand_in.step()
            for link in (self._operator, *self._strangers):
                link.wait(0.0)
            self.record.statuses += self._operator.take(GuardStatus)
            self._watch_processes()
            if np.isfinite(self.record.start):
                self.record.pause = max(self.record.pause, time.monotonic() - begun)

    def restart_robot(self) -> None:
        """Puts the robot at its start, wheels at rest, with sound odometry."""
        self._stand_in = StandIn(self._scenario, self.robot)
        self.robot.fault = None

    def begin(self, patience: float) -> bool:
        """Lets the robot run until the drive has begun, and says whether it has.

        Args:
            patience: [s] longest time that it may take.
        """
        until = time.monotonic() + patience
        while time.monotonic() < until:
            self.run(time.monotonic() + 0.02)
            moving = (c.arrival for c in self.robot.commands if np.any(c.command))
            self.record.start = next(moving, np.inf)
            if np.isfinite(self.record.start):
                # Whose number is known now, and not once its parent is gone.
                self._own_guard = None if self._guard else child_of(self._pid("controller"))
                self._watched |= {name: self._pid(name) for name in ("controller", "guard")}
                return True
        return False

    def signal(self, name: str, number: signal.Signals) -> None:
        """Sends a signal to the guard or the controller."""
        os.kill(self._pid(name), number)

    def ask_to_stop(self) -> None:
        """Asks the guard to stop, as an operator."""
        self._operator.send(OperatorRequest(Request.STOP))

    def command_wheels(self) -> None:
        """Sends a wheel command past the guard, as another process would."""
        self._strangers[0].send(WheelCommand(FOREIGN_COMMAND))
        self.record.foreign.append(WheelCommand(FOREIGN_COMMAND, time.monotonic()))

    def speak_as_second_controller(self) -> None:
        """Sends a command of another session."""
        self._send_command(session=1, sequence=0, command=FOREIGN_COMMAND)

    def speak_for_controller(self, command: np.ndarray) -> None:
        """Sends a command (4,) [pwm] in the controller's name, as if it came from there."""
        status = self._operator.latest(GuardStatus)
        assert status is not None
        self._send_command(status.session, status.sequence + 1, command)

    def babble(self) -> None:
        """Sends a message without sense."""
        self._babblers[0].babble(self._rng)

    def finish(self) -> Record:
        """Returns what was seen."""
        record = self.record
        record.end = time.monotonic()
        record.odometry, record.commands = self.robot.odometry, self.robot.commands
        record.acted = self.orders.acted()
        record.controller_alive = is_alive(self._pid("controller"))
        record.guard_alive = is_alive(self._pid("guard"))
        if self._told.poll():
            try:
                record.ended = self._told.recv()
            except EOFError:
                record.ended = None
        return record

    def close(self) -> None:
        """Ends guard and controller, and leaves the wire."""
        be_punctual(False)
        if self._own_guard is not None and is_alive(self._own_guard):
            os.kill(self._own_guard, signal.SIGKILL)
        for process in (self._controller, self._guard):
            if process is not None:
                process.kill()
                process.join()
        for link in (self.robot, self._operator, *self._strangers):
            link.close()
        for babbler in self._babblers:
            babbler.close()

    def _watch_processes(self) -> None:
        starved = self.record.starved
        for name, pid in self._watched.items():
            waited = waiting_time(pid)
            starved[name] = max(starved.get(name, 0.0), waited - self._waited.get(name, waited))
            self._waited[name] = waited

    def _pid(self, name: str) -> int:
        process = self._controller if name == "controller" else self._guard
        pid = self._own_guard if process is None else process.pid
        assert pid is not None
        return pid

    def _send_command(self, session: int, sequence: int, command: np.ndarray) -> None:
        odometry = self.robot.odometry[-1].message
        self._strangers[0].send(
            DriveCommand(session, sequence, command, odometry.pose, odometry.stamp, False)
        )

    def __enter__(self) -> Self:
        """Returns itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Closes it."""
        self.close()
