"""Drives the excitation of algorithm 1 on a robot and records what its odometry says."""

import dataclasses as dc
import math
from collections.abc import Callable

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import ZeroOrderHold

from mirte_drake.control.excitation import ExcitationConfig
from mirte_drake.errors import UserError
from mirte_drake.pacing import Pace, WireStopped
from mirte_drake.robot_assembly import AddRobot, export_wire
from mirte_drake.robots.odometry_sensor import OdometrySensorConfig
from mirte_drake.robots.robot_ports import RobotPorts
from mirte_drake.scenario import Scenario
from mirte_drake.systems.excitation_source import AddExcitationSource
from mirte_drake.vectors import WHEELS

PERIOD = OdometrySensorConfig.period  # [s] Rows come as the robot's odometry does.


@dc.dataclass(frozen=True)
class Collected:
    """What was recorded, one row per sample, with the meaning of the robot's recordings."""

    time: np.ndarray  # (N,) [s] from 0.
    pose: np.ndarray  # (N, 3) [m, m, rad] measured, world frame, yaw unwrapped.
    body_velocity: np.ndarray  # (N, 3) [m/s, m/s, rad/s] measured, mean over the sample before.
    wheel_command: np.ndarray  # (N, 4) [pwm] held from the row on.
    ended: str = ""  # Why it ended before its time; empty: it did not.


def collect(
    add_robot: Callable[[DiagramBuilder], RobotPorts],
    excitation: ExcitationConfig,
    *,
    seed: int = 0,
    period: float = PERIOD,
    integration_accuracy: float = 1e-6,
    on_sample: Callable[[], object] = lambda: None,
    make_pace: Callable[[Diagram], Pace] = lambda _: Pace(),
) -> Collected:
    """Drives a robot through the excitation, to its end, and records it.

    Args:
        add_robot: Adds the robot to a builder and returns its ports. ``body_velocity`` must be
            the mean over the period before, as of an OdometrySensor without latency.
        excitation: Settings of algorithm 1.
        seed: Seed >= 0 of the excitation.
        period: [s] between rows, for which commands are held.
        integration_accuracy: Of a robot with continuous states.
        on_sample: Called after each row, for a progress bar.
        make_pace: Gives what makes the Diagram's samples come; simulated time.

    Raises:
        ValueError: when ``excitation`` or ``seed`` is out of range.
    """
    builder = DiagramBuilder()
    source = AddExcitationSource(builder, excitation, seed=seed)
    hold = builder.AddNamedSystem("command_hold", ZeroOrderHold(period, len(WHEELS)))
    robot = add_robot(builder)
    builder.Connect(source.get_output_port(), hold.get_input_port())
    builder.Connect(hold.get_output_port(), robot.wheel_command)
    builder.ExportOutput(robot.pose, "pose")
    builder.ExportOutput(robot.body_velocity, "body_velocity")
    # What the hold takes over at the instant of a row.
    builder.ExportOutput(source.get_output_port(), "wheel_command")
    if robot.wire is not None:
        export_wire(builder, robot.wire)
    diagram = builder.Build()
    pace = make_pace(diagram)
    simulator = Simulator(diagram)
    simulator.get_mutable_integrator().set_target_accuracy(integration_accuracy)
    context = simulator.get_mutable_context()
    ports = [diagram.GetOutputPort(name) for name in ("pose", "body_velocity", "wheel_command")]
    rows: list[list[float]] = []
    ended = ""
    try:
        for k in range(num_samples(excitation, period)):
            pace.before(context)
            if k == 0:
                simulator.Initialize()  # Takes in what came over a wire before.
            simulator.AdvanceTo(k * period)
            values = np.concatenate([port.Eval(context) for port in ports])
            rows.append([context.get_time(), *values])
            simulator.AdvancePendingEvents()
            pace.after(context)
            on_sample()
    except WireStopped as stop:
        ended = str(stop)
    time, pose, velocity, command = np.split(np.array(rows).reshape(-1, 11), [1, 4, 7], axis=1)
    return Collected(time[:, 0], pose, velocity, command, ended)


def num_samples(excitation: ExcitationConfig, period: float = PERIOD) -> int:
    """Returns the number of rows of a recording, from rest to rest."""
    return math.ceil(excitation.duration / period - 1e-6) + 1  # Forgiving round-off.


def collect_scenario(
    scenario: Scenario,
    excitation: ExcitationConfig,
    *,
    seed: int | None = None,
    on_sample: Callable[[], object] = lambda: None,
) -> Collected:
    """Drives the robot of a scenario from its start pose, without disturbance; see ``collect``.

    Args:
        scenario: Whose robot it is.
        excitation: Settings of algorithm 1.
        seed: Seed >= 0 of the excitation and of the odometry's jitter; None: the scenario's.
        on_sample: Called after each row, for a progress bar.

    Raises:
        UserError: when its odometry is late, or does not come with the rows.
        ValueError: when the robot, ``excitation`` or ``seed`` is out of range.
    """
    # Odometry is what is recorded, so that a robot without it gets one.
    odometry = scenario.measuring_odometry or OdometrySensorConfig()
    # The velocity of a row is the mean since the row before, under the command held there.
    if odometry.latency > 0:
        raise UserError(
            f"odometry.latency: must be 0 s for a recording, got {odometry.latency}: a row would "
            "not belong to its commands"
        )
    if odometry.period != PERIOD:
        raise UserError(
            f"odometry.period: must be {PERIOD} s for a recording, the time between its rows, "
            f"got {odometry.period}"
        )
    seed = scenario.seed if seed is None else seed
    scenario = dc.replace(scenario, odometry=odometry, seed=seed)
    return collect(
        lambda builder: AddRobot(builder, scenario),
        excitation,
        seed=seed,
        integration_accuracy=scenario.accuracy,
        on_sample=on_sample,
    )
