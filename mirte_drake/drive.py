"""Drives a robot beyond a wire, by the Diagram that is simulated otherwise, and records it."""

import dataclasses as dc
import gc
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram

from mirte_drake.assembly import MakeDiagram
from mirte_drake.collect import Collected, collect
from mirte_drake.control.excitation import ExcitationConfig
from mirte_drake.drive_recorder import DriveRecorder, Sink
from mirte_drake.hardware.bag_recorder import BagRecorder
from mirte_drake.hardware.foxglove_live import FoxgloveLive
from mirte_drake.hardware.link import Link
from mirte_drake.hardware.odometry_check import check
from mirte_drake.hardware.ros2_messages import Ros2Messages
from mirte_drake.hardware.wire_config import Ros2WireConfig
from mirte_drake.pacing import WirePace, interruption
from mirte_drake.robot_assembly import AddRobot
from mirte_drake.run import Run, run_diagram
from mirte_drake.scenario import Scenario, wired_robot


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
    on_diagram: Callable[[Diagram], object] = lambda _: None,
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
        on_diagram: Called with the Diagram before the drive begins.
        on_sample: Called after each sample, when its command is on its way.
        recorder: Records it.
        clock: [s] that messages' times of arrival are of.

    Raises:
        ValueError: when the scenario cannot be built; UserError is one.
    """
    diagram = MakeDiagram(scenario, link, session)
    _warm_up(diagram, scenario)
    on_diagram(diagram)
    with interruption() as watch, few_pauses():
        pace = _pace(diagram, scenario, link, watch, recorder, clock)
        return run_diagram(diagram, scenario, name, on_sample, pace)


def _warm_up(diagram: Diagram, scenario: Scenario) -> None:
    """Goes through a sample in a Context of its own, sending nothing.

    Compiled code is loaded when it is first called, which takes longer than odometry may be old.
    """
    simulator = Simulator(diagram)
    diagram.GetInputPort("clock").FixValue(simulator.get_mutable_context(), [0.0])
    simulator.AdvanceTo(1.5 * scenario.period)


def collect_over_wire(
    scenario: Scenario,
    excitation: ExcitationConfig,
    link: Link,
    session: int,
    *,
    seed: int | None = None,
    on_sample: Callable[[], object] = lambda: None,
    recorder: DriveRecorder | None = None,
    clock: Callable[[], float] = time.monotonic,
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
            make_pace=lambda diagram: _pace(diagram, scenario, link, watch, recorder, clock),
        )


def _pace(
    diagram: Diagram,
    scenario: Scenario,
    link: Link,
    watch: Callable[[], None],
    recorder: DriveRecorder | None,
    clock: Callable[[], float],
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


@contextmanager
def few_pauses() -> Iterator[None]:
    """Keeps the garbage collector from pausing the block for what was there before."""
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
