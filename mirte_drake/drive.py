"""Drives a robot beyond a wire: controller and guard, and what must happen at the end."""

import dataclasses as dc
import gc
import secrets
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
from pydrake.systems.framework import Context, Diagram

from mirte_drake.assembly import AddRobot, MakeDiagram
from mirte_drake.collect import Collected, collect
from mirte_drake.control.excitation import ExcitationConfig
from mirte_drake.drive_recorder import DriveRecorder, Sink
from mirte_drake.errors import UserError
from mirte_drake.hardware.bag_recorder import BagRecorder
from mirte_drake.hardware.foxglove_live import FoxgloveLive
from mirte_drake.hardware.guard_process import start_guard
from mirte_drake.hardware.link import Link, Role
from mirte_drake.hardware.messages import (
    DriveCommand,
    GuardStatus,
    Odometry,
    OperatorRequest,
    Request,
    WheelCommand,
)
from mirte_drake.hardware.odometry_check import check
from mirte_drake.hardware.ros2_messages import Ros2Messages
from mirte_drake.hardware.wire_config import Ros2WireConfig, open_link
from mirte_drake.pacing import WirePace, WireStopped
from mirte_drake.run import Run, run_diagram
from mirte_drake.scenario import Scenario, WiredRobotConfig
from mirte_drake.vectors import POSE_SIZE, WHEELS

STOP_TIME = 0.5  # [s] For which zeros are repeated where no guard does it.
STOP_PERIOD = 0.05  # [s] Between them.
CONFIRMATION = 0.2  # [s] For the guard to say that the wheels stand.


def wired_robot(scenario: Scenario) -> WiredRobotConfig:
    """Returns the robot of a scenario, which must be beyond a wire.

    Raises:
        UserError: when it is a simulated one.
    """
    if not isinstance(scenario.robot, WiredRobotConfig):
        raise UserError(
            f"robot: {type(scenario.robot).__name__} is simulated; name its wire by "
            "--transport ros2 or --transport lcm"
        )
    return scenario.robot


@contextmanager
def wire_to(scenario: Scenario, *, own_guard: bool = True) -> Iterator[tuple[Link, int]]:
    """Yields the controller's end of the wire and its session, with a guard at the other end.

    However the block ends, the wheels stand afterwards.

    Args:
        scenario: Its robot and the first pose of its path.
        own_guard: Whether to start a guard on this machine; else one runs already.

    Raises:
        UserError: when the robot is simulated, or wire or guard cannot be used.
    """
    robot = wired_robot(scenario)
    session = secrets.randbits(62) + 1
    with open_link(robot.wire, Role.CONTROLLER) as link:
        guard = None
        if own_guard:
            guard = start_guard(robot.wire, robot.governor, scenario.first_pose)
        try:
            yield link, session
        finally:
            stop_wheels(link, session)
            if guard is not None:
                guard.stop()


@contextmanager
def recording(
    scenario: Scenario, *, bag: Path | None = None, live: bool = False
) -> Iterator[DriveRecorder | None]:
    """Yields a recorder to a bag and to a live view in Foxglove; None where neither is wanted.

    Args:
        scenario: Its robot is beyond a wire, and names the topics.
        bag: File to write, .mcap.
        live: Whether Foxglove on this machine can look on.

    Raises:
        UserError: when a package is missing, the file cannot be written or the port is taken.
    """
    wire = wired_robot(scenario).wire
    names = wire if isinstance(wire, Ros2WireConfig) else Ros2WireConfig()
    if bag is None and not live:
        yield None
        return
    messages = Ros2Messages(
        namespace=names.namespace, odometry_topic=names.odometry_topic, motor_type=names.motor_type
    )
    with ExitStack() as stack:
        sinks: list[Sink] = []
        if bag is not None:
            sinks.append(stack.enter_context(BagRecorder(bag, messages)))
        if live:
            sinks.append(stack.enter_context(FoxgloveLive(messages)))
        yield DriveRecorder(messages, sinks)


def drive(
    scenario: Scenario,
    name: str,
    link: Link,
    session: int,
    *,
    on_sample: Callable[[], object] = lambda: None,
    recorder: DriveRecorder | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> Run:
    """Drives a scenario over a wire and logs every sample.

    Args:
        scenario: What to drive.
        name: Name for the summary.
        link: Of ``wire_to``.
        session: Of ``wire_to``.
        on_sample: Called after each sample, when its command is on its way.
        recorder: Records it.
        clock: [s] that messages' times of arrival are of.

    Raises:
        ValueError: when the scenario cannot be built; UserError is one.
    """
    diagram = MakeDiagram(scenario, link, session)
    with interruption() as watch, few_pauses():
        pace = _pace(diagram, scenario, link, watch, recorder, clock)
        return run_diagram(diagram, scenario, name, on_sample, pace)


def collect_over_wire(
    scenario: Scenario,
    excitation: ExcitationConfig,
    link: Link,
    session: int,
    *,
    seed: int | None = None,
    on_sample: Callable[[], object] = lambda: None,
    recorder: DriveRecorder | None = None,
) -> Collected:
    """Drives a robot beyond a wire through the excitation and records it; see ``collect``.

    Rows are odometry as it came. Where the guard stops the robot, the recording ends there.

    Raises:
        ValueError: when ``excitation`` or ``seed`` is out of range.
    """
    robot = dc.replace(wired_robot(scenario), roll_forward=False)
    scenario = dc.replace(scenario, robot=robot)
    with interruption() as watch, few_pauses():
        return collect(
            lambda builder: AddRobot(builder, scenario, link, session),
            excitation,
            seed=scenario.seed if seed is None else seed,
            on_sample=on_sample,
            make_pace=lambda diagram: _pace(diagram, scenario, link, watch, recorder),
        )


def _pace(
    diagram: Diagram,
    scenario: Scenario,
    link: Link,
    watch: Callable[[], None],
    recorder: DriveRecorder | None,
    clock: Callable[[], float] = time.monotonic,
) -> WirePace:
    limits = wired_robot(scenario).governor.odometry

    def record(context: Context) -> None:
        if recorder is not None:
            recorder.record(link, diagram, context)

    return WirePace(
        diagram,
        link,
        period=scenario.period,
        clock=clock,
        watch=watch,
        refuse=lambda odometry: check(None, odometry, limits)[1],
        record=record,
    )


def stop_wheels(link: Link, session: int, clock: Callable[[], float] = time.monotonic) -> None:
    """Has the wheels stand: by the guard, and where it does not say so, by zeros of one's own.

    Args:
        link: The controller's end of the wire.
        session: Number of this controller.
        clock: [s] that messages' times of arrival are of.
    """
    start = clock()
    nothing = np.zeros(len(WHEELS))
    # Of an end the guard wants to know nothing but whose it is.
    done = DriveCommand(session, 2**31 - 1, nothing, np.zeros(POSE_SIZE), 0, False, done=True)
    link.send(done)
    while clock() - start < CONFIRMATION:
        link.wait(0.01)
        status = link.latest(GuardStatus)
        if status is not None and status.arrival > start and not np.any(status.command):
            return
    while clock() - start < CONFIRMATION + STOP_TIME:
        link.send(WheelCommand(nothing))
        link.wait(STOP_PERIOD)
        time.sleep(STOP_PERIOD / 10)


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


@contextmanager
def few_pauses() -> Iterator[None]:
    """Keeps the garbage collector from pausing the block for what was there before."""
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def stop_all(link: Link, duration: float = 1.0) -> str:
    """Asks every guard to stop and sends zeros for ``duration`` [s]; returns what is known then.

    Args:
        link: An operator's end of the wire.
        duration: [s], longer than discovery takes.
    """
    end = time.monotonic() + duration
    while time.monotonic() < end:
        link.send(OperatorRequest(Request.STOP))
        link.send(WheelCommand(np.zeros(len(WHEELS))))
        link.wait(STOP_PERIOD)
        time.sleep(STOP_PERIOD / 2)
    status, odometry = link.latest(GuardStatus), link.latest(Odometry)
    guard = "no guard was heard" if status is None else f"the guard has stopped: {status.reason}"
    if odometry is None:
        return f"zeros sent; {guard}; no odometry was heard: look at the robot"
    speed = np.linalg.norm(odometry.body_velocity[:2])
    return f"zeros sent; {guard}; the robot moves at {speed:.2f} m/s"


def reset_guard(link: Link, timeout: float = 3.0) -> str:
    """Lets a guard that has stopped the robot go on; returns what it says.

    Args:
        link: An operator's end of the wire.
        timeout: [s] for the guard to answer.

    Raises:
        UserError: when no guard answers, or it stays stopped.
    """
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        link.send(OperatorRequest(Request.RESET))
        link.wait(STOP_PERIOD)
        status = link.latest(GuardStatus)
        if status is not None and not status.stopped:
            return "the guard is ready"
    status = link.latest(GuardStatus)
    if status is None:
        raise UserError("stop --reset: no guard was heard; is it running on this wire?")
    raise UserError(f"stop --reset: the guard stays stopped: {status.reason}")
