"""The only wiring: robot, controller and the Diagram of a scenario."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import ZeroOrderHold

from mirte_drake.control.lagged_tube import lagged_loop
from mirte_drake.errors import UserError
from mirte_drake.hardware.link import Link, Role
from mirte_drake.hardware.wire_config import open_link
from mirte_drake.model.lagged_model import LaggedModel
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.robots.lcm_robot import MakeLcmRobot
from mirte_drake.robots.measured_robot import AddMeasuredRobot
from mirte_drake.robots.robot_ports import RobotPorts, WirePorts
from mirte_drake.robots.ros2_robot import MakeRos2Robot, Ros2RobotConfig
from mirte_drake.robots.sindyc_robot import AddSindycRobot, SindycRobotConfig
from mirte_drake.robots.wire_robot import WireRobot
from mirte_drake.robots.wired_robot import wired_ports
from mirte_drake.scenario import Scenario, WiredRobotConfig, load_prediction_model
from mirte_drake.systems.ancillary_dlqr import AddAncillaryDlqr
from mirte_drake.systems.ancillary_inversion import AddAncillaryInversion
from mirte_drake.systems.ancillary_lagged import AddAncillaryLagged
from mirte_drake.systems.coverage_monitor import AddCoverageMonitor
from mirte_drake.systems.disturbance_source import AddDisturbanceSource, DisturbanceSource
from mirte_drake.systems.inversion_tube_updater import AddInversionTubeUpdater
from mirte_drake.systems.lagged_tube_updater import AddLaggedTubeUpdater
from mirte_drake.systems.nominal_nmpc import AddNominalNmpc
from mirte_drake.systems.pose_lqr import AddPoseLqr, PoseLqr
from mirte_drake.systems.pose_pid import AddPosePid, PosePid, PosePidConfig
from mirte_drake.systems.reference_source import AddReferenceSource, ReferenceSource
from mirte_drake.systems.state_estimator import AddStateEstimator
from mirte_drake.systems.tube_updater import AddTubeUpdater
from mirte_drake.systems.velocity_setpoint import (
    AddVelocitySetpointSource,
    VelocitySetpointConfig,
    VelocitySetpointSource,
)
from mirte_drake.systems.wheel_command_limiter import AddWheelCommandLimiter
from mirte_drake.vectors import WHEELS

# Outputs of controllers that have them: of the coverage monitor, and of those with an estimator.
COVERAGE = ("prediction_error", "calibrated_bound", "coverage", "coverage_warning")
ESTIMATES = ("state", "bias", "innovation", "error_bound")


def AddRobot(
    builder: DiagramBuilder, scenario: Scenario, link: Link | None = None, session: int = 0
) -> RobotPorts:
    """Adds the robot that the scenario names, with its odometry, and returns its ports.

    With odometry it is a Diagram of ``MakeMeasuredRobot``, without one a SindycRobot; beyond a
    wire, one of ``MakeRos2Robot`` or ``MakeLcmRobot``.

    Args:
        builder: The builder.
        scenario: The scenario.
        link: The controller's end of the wire, for a robot beyond one; None opens it.
        session: Number of this controller for the guard.

    Raises:
        UserError: when the wire cannot be used.
        ValueError: when robot or odometry is out of range.
    """
    robot, odometry = scenario.robot, scenario.measuring_odometry
    if isinstance(robot, WiredRobotConfig):
        return _add_wired_robot(builder, robot, scenario, link, session)
    if odometry is None:
        assert isinstance(robot, SindycRobotConfig)
        return AddSindycRobot(builder, robot, start=scenario.first_pose)
    return AddMeasuredRobot(builder, robot, odometry, start=scenario.first_pose, seed=scenario.seed)


def _add_wired_robot(
    builder: DiagramBuilder,
    robot: WiredRobotConfig,
    scenario: Scenario,
    link: Link | None,
    session: int,
) -> RobotPorts:
    link = link or open_link(robot.wire, Role.CONTROLLER)
    adapter = WireRobot(
        load_prediction_model(scenario),
        start=scenario.first_pose,
        period=scenario.period,
        session=session,
        limits=robot.governor.odometry,
        roll_forward=robot.roll_forward,
    )
    if isinstance(robot, Ros2RobotConfig):
        return wired_ports(builder.AddSystem(MakeRos2Robot(robot, adapter, link)))
    from mirte_drake.hardware.lcm_link import LcmLink

    assert isinstance(link, LcmLink)
    return wired_ports(builder.AddSystem(MakeLcmRobot(robot, adapter, link)))


def AddReference(
    builder: DiagramBuilder, scenario: Scenario
) -> ReferenceSource | VelocitySetpointSource:
    """Adds the source of the reference; ports ``reference`` and ``reference_window``.

    The window reaches over the horizon of a plan that begins after the controller's delay.
    """
    path, period = scenario.reference, scenario.period
    horizon = scenario.nominal_nmpc.horizon + scenario.delay
    if isinstance(path, VelocitySetpointConfig):
        return AddVelocitySetpointSource(builder, path, period=period, horizon=horizon)
    return AddReferenceSource(builder, path, period=period, horizon=horizon)


def MakeController(scenario: Scenario) -> Diagram:
    """Builds the controller of a scenario.

    That is one of ``MakeTubeController``, ``MakeLaggedController`` and ``MakePoseController``. All
    take ``pose`` and ``reference_window`` and give ``wheel_command``; those that plan give
    ``plan`` and ``solve_status``.

    Raises:
        UserError: when the prediction model cannot be read, does not fit the controller, or cannot
            be stabilised.
        ValueError: when a config is out of range.
    """
    scenario.validate()
    model = load_prediction_model(scenario)
    if scenario.controller is not None:
        return MakePoseController(scenario, model)
    if isinstance(model, LaggedModel):
        return MakeLaggedController(scenario, model)
    return MakeTubeController(scenario, model)


def MakeLaggedController(scenario: Scenario, model: LaggedModel) -> Diagram:
    """Builds the controller of a robot whose velocity lags.

    .. pydrake_system::

        name: Controller
        input_ports:
        - pose
        - reference_window
        output_ports:
        - wheel_command
        - plan
        - solve_status
        - half_width
        - error_bound
        - state
        - bias
        - innovation

    Estimator, nominal NMPC, ancillary law, limiter and hold. Everything from the estimator's
    ``state`` (6,) on is about the sample at which the command begins to act, a delay of d samples
    after the measured ``pose`` (3,): the ``reference_window`` (3 (d + N + 1),) holds r_k, ...,
    r_{k+d+N}, of which the plan tracks those from r_{k+d} on. The plan's inputs are effective
    commands, ``wheel_command`` (4,) [pwm] is what gives them. ``half_width``
    and ``error_bound`` are there with a tube.

    Args:
        scenario: The scenario.
        model: Its prediction model.

    Raises:
        UserError: when the prediction model cannot be stabilised.
        ValueError: when a config is out of range.
    """
    assert scenario.state_estimator is not None and scenario.ancillary_lagged is not None
    period, horizon = scenario.period, scenario.nominal_nmpc.horizon
    limit = model.effective_limit(scenario.input_limit)
    builder = DiagramBuilder()
    estimator = AddStateEstimator(builder, scenario.state_estimator, model, period=period)
    with _naming("nominal_nmpc"):
        nmpc = AddNominalNmpc(
            builder,
            scenario.nominal_nmpc,
            model.effective(),
            period=period,
            input_limit=limit,
            lead=estimator.delay,
        )
    ancillary = AddAncillaryLagged(
        builder, scenario.ancillary_lagged, model, period=period, input_limit=limit
    )
    tube = scenario.lagged_tube
    if tube is not None:
        loop = lagged_loop(
            model.parameters.lag, period, ancillary.gains, estimator.gains, estimator.delay
        )
        updater = AddLaggedTubeUpdater(
            builder,
            tube,
            model,
            loop,
            ancillary.gains,
            period=period,
            horizon=horizon,
            input_limit=limit,
        )
        builder.Connect(nmpc.GetOutputPort("plan"), updater.GetInputPort("plan"))
        for port in ("state", "bias"):
            builder.Connect(estimator.GetOutputPort(port), updater.GetInputPort(port))
        for port in ("half_width", "input_lower", "input_upper"):
            builder.Connect(updater.GetOutputPort(port), nmpc.GetInputPort(port))
    limiter = AddWheelCommandLimiter(
        builder, scenario.wheel_command_limiter, input_limit=scenario.input_limit
    )
    hold = builder.AddNamedSystem("command_hold", ZeroOrderHold(period, model.num_inputs))

    builder.ExportInput(estimator.GetInputPort("pose"), "pose")
    builder.ExportInput(nmpc.GetInputPort("reference_window"), "reference_window")
    builder.Connect(estimator.GetOutputPort("state"), nmpc.GetInputPort("state"))
    builder.Connect(estimator.GetOutputPort("state"), ancillary.GetInputPort("state"))
    builder.Connect(estimator.GetOutputPort("bias"), ancillary.GetInputPort("bias"))
    builder.Connect(nmpc.GetOutputPort("plan"), ancillary.GetInputPort("plan"))
    builder.Connect(ancillary.GetOutputPort("wheel_command"), limiter.GetInputPort("wheel_command"))
    limited = limiter.GetOutputPort("limited_command")
    builder.Connect(limited, hold.get_input_port())
    builder.Connect(limited, estimator.GetInputPort("wheel_command"))
    builder.ExportOutput(hold.get_output_port(), "wheel_command")
    builder.ExportOutput(nmpc.GetOutputPort("plan"), "plan")
    builder.ExportOutput(nmpc.GetOutputPort("solve_status"), "solve_status")
    if tube is not None:
        for port in ("half_width", "error_bound"):
            builder.ExportOutput(updater.GetOutputPort(port), port)
    for port in ("state", "bias", "innovation"):
        builder.ExportOutput(estimator.GetOutputPort(port), port)
    controller = builder.Build()
    controller.set_name("controller")
    return controller


def MakeTubeController(scenario: Scenario, model: PredictionModel) -> Diagram:
    """Builds the controller: nominal NMPC, ancillary law, its tube, limiter and hold.

    .. pydrake_system::

        name: Controller
        input_ports:
        - pose
        - reference_window
        output_ports:
        - wheel_command
        - plan
        - solve_status
        - half_width
        - designs
        - reached
        - prediction_error
        - calibrated_bound
        - coverage
        - coverage_warning

    ``pose`` (3,) [m, m, rad] is measured, yaw unwrapped; ``reference_window`` (3 (N+1),) holds
    r_k, ..., r_{k+N}; ``wheel_command`` (4,) [pwm] is held for T_s. At a sample everything
    follows from the pose at that instant. ``half_width`` is there with a tube, ``designs`` with
    the ancillary DLQR, ``reached`` with the ancillary inversion, the last four with a coverage
    monitor; the baseline NMPC has none.

    Args:
        scenario: The scenario.
        model: Its prediction model; its state is the pose.

    Raises:
        UserError: when the prediction model cannot be stabilised.
        ValueError: when a config is out of range.
    """
    period, horizon, limit = scenario.period, scenario.nominal_nmpc.horizon, scenario.input_limit
    builder = DiagramBuilder()
    with _naming("nominal_nmpc"):
        nmpc = AddNominalNmpc(
            builder, scenario.nominal_nmpc, model, period=period, input_limit=limit
        )
    limiter = AddWheelCommandLimiter(builder, scenario.wheel_command_limiter, input_limit=limit)
    hold = builder.AddNamedSystem("command_hold", ZeroOrderHold(period, model.num_inputs))

    builder.ExportInput(nmpc.GetInputPort("state"), "pose")
    builder.ExportInput(nmpc.GetInputPort("reference_window"), "reference_window")
    builder.Connect(limiter.GetOutputPort("limited_command"), hold.get_input_port())
    builder.Connect(hold.get_output_port(), nmpc.GetInputPort("applied_input"))
    builder.ExportOutput(hold.get_output_port(), "wheel_command")
    builder.ExportOutput(nmpc.GetOutputPort("plan"), "plan")
    builder.ExportOutput(nmpc.GetOutputPort("solve_status"), "solve_status")

    command = nmpc.GetOutputPort("nominal_input")
    tube = scenario.tube_updater
    if scenario.ancillary_dlqr is not None:
        stagewise = tube is not None and tube.tightening_over_horizon == "stagewise"
        stages = horizon if stagewise else 1
        with _naming("ancillary_dlqr"):
            ancillary = AddAncillaryDlqr(
                builder, scenario.ancillary_dlqr, model, period=period, stages=stages
            )
        builder.Connect(nmpc.GetOutputPort("plan"), ancillary.GetInputPort("plan"))
        builder.ConnectInput("pose", ancillary.GetInputPort("state"))
        builder.ExportOutput(ancillary.GetOutputPort("designs"), "designs")
        command = ancillary.GetOutputPort("wheel_command")
    law = scenario.ancillary_inversion
    if law is not None:
        with _naming("ancillary_inversion"):
            inversion = AddAncillaryInversion(builder, law, model, period=period, input_limit=limit)
        builder.Connect(nmpc.GetOutputPort("plan"), inversion.GetInputPort("plan"))
        builder.ConnectInput("pose", inversion.GetInputPort("state"))
        builder.ExportOutput(inversion.GetOutputPort("reached"), "reached")
        command = inversion.GetOutputPort("wheel_command")
    builder.Connect(command, limiter.GetInputPort("wheel_command"))
    updater: LeafSystem | None = None
    if tube is not None:
        updater = AddTubeUpdater(builder, tube, period=period, horizon=horizon, input_limit=limit)
        builder.Connect(ancillary.GetOutputPort("designs"), updater.GetInputPort("designs"))
    if scenario.inversion_tube_updater is not None:
        assert law is not None
        with _naming("inversion_tube_updater"):
            updater = AddInversionTubeUpdater(
                builder,
                scenario.inversion_tube_updater,
                model,
                period=period,
                horizon=horizon,
                feedback=law.feedback,
                input_limit=limit,
            )
        builder.Connect(nmpc.GetOutputPort("plan"), updater.GetInputPort("plan"))
        builder.ConnectInput("pose", updater.GetInputPort("state"))
        builder.Connect(
            limiter.GetOutputPort("limited_command"), updater.GetInputPort("wheel_command")
        )
    if updater is not None:
        for port in ("half_width", "input_lower", "input_upper"):
            builder.Connect(updater.GetOutputPort(port), nmpc.GetInputPort(port))
        builder.ExportOutput(updater.GetOutputPort("half_width"), "half_width")
    if scenario.coverage_monitor is not None:
        monitor = AddCoverageMonitor(builder, scenario.coverage_monitor, model, period=period)
        for port in ("pose", "state"):
            builder.ConnectInput("pose", monitor.GetInputPort(port))
        builder.Connect(
            limiter.GetOutputPort("limited_command"), monitor.GetInputPort("wheel_command")
        )
        for port in COVERAGE:
            builder.ExportOutput(monitor.GetOutputPort(port), port)
    controller = builder.Build()
    controller.set_name("controller")
    return controller


def MakePoseController(scenario: Scenario, model: PredictionModel) -> Diagram:
    """Builds a controller that does not plan: feedback from the pose, limiter and hold.

    .. pydrake_system::

        name: Controller
        input_ports:
        - pose
        - reference_window
        output_ports:
        - wheel_command

    Ports as of ``MakeTubeController``.

    Args:
        scenario: The scenario; its ``controller`` is given.
        model: Its prediction model, which a PID does without.

    Raises:
        UserError: when a value does not fit the rest of the scenario.
    """
    config, period, limit = scenario.controller, scenario.period, scenario.input_limit
    horizon = scenario.nominal_nmpc.horizon
    builder = DiagramBuilder()
    with _naming("controller"):
        feedback: PosePid | PoseLqr
        if isinstance(config, PosePidConfig):
            feedback = AddPosePid(
                builder, config, period=period, horizon=horizon, input_limit=limit
            )
        else:
            assert config is not None
            feedback = AddPoseLqr(
                builder, config, model, period=period, horizon=horizon, input_limit=limit
            )
    limiter = AddWheelCommandLimiter(builder, scenario.wheel_command_limiter, input_limit=limit)
    hold = builder.AddNamedSystem("command_hold", ZeroOrderHold(period, len(WHEELS)))
    builder.ExportInput(feedback.GetInputPort("pose"), "pose")
    builder.ExportInput(feedback.GetInputPort("reference_window"), "reference_window")
    builder.Connect(feedback.GetOutputPort("wheel_command"), limiter.GetInputPort("wheel_command"))
    builder.Connect(limiter.GetOutputPort("limited_command"), hold.get_input_port())
    builder.ExportOutput(hold.get_output_port(), "wheel_command")
    controller = builder.Build()
    controller.set_name("controller")
    return controller


@contextmanager
def _naming(field: str) -> Iterator[None]:
    """Names the scenario's field in errors that only show when its system is made."""
    try:
        yield
    except ValueError as error:
        raise UserError(f"{field}: {error}") from None


def AddController(builder: DiagramBuilder, scenario: Scenario) -> Diagram:
    """Adds the controller of ``MakeController``; the caller connects its ports."""
    return builder.AddNamedSystem("controller", MakeController(scenario))


class View(Protocol):
    """What makes a Diagram one to watch; it adds systems, and connects them to the Diagram's."""

    def add_disturbance_controls(
        self, builder: DiagramBuilder, disturbance: OutputPort
    ) -> OutputPort:
        """Adds controls of the disturbance (3,), and returns what it is with them."""

    def add_scene(
        self,
        builder: DiagramBuilder,
        controller: Diagram,
        reference: LeafSystem,
        robot: RobotPorts,
        disturbance: OutputPort | None,
    ) -> None:
        """Adds what shows the Diagram."""


def MakeDiagram(
    scenario: Scenario,
    link: Link | None = None,
    session: int = 0,
    *,
    view: View | None = None,
) -> Diagram:
    """Wires reference, controller, disturbance and robot of a scenario.

    .. pydrake_system::

        name: Diagram
        output_ports:
        - reference
        - pose
        - body_velocity
        - true_pose
        - wheel_command
        - plan
        - disturbance

    ``pose`` and ``body_velocity`` are measured, by odometry where the robot has one; ``true_pose``
    is where it is. A robot without an input for a disturbance leaves ``disturbance`` out.

    A robot beyond a wire has no ``true_pose``, but an input ``clock`` (1,) [s] and the outputs
    ``odometry_age``, ``drive_command`` and ``plan_view``, see WireRobot; it sends when the Diagram
    is told to publish. ``mirte_drake.drive`` drives it.

    With a VelocitySetpointConfig as reference there is an input ``velocity_setpoint`` (3,), which
    may stay open. The controller's outputs, see ``MakeController``, are exported too; one that
    does not plan has no ``plan``.

    Args:
        scenario: The scenario.
        link: The controller's end of the wire, for a robot beyond one; None opens it.
        session: Number of this controller for the guard.
        view: Shows the Diagram while it runs, and lets others disturb it; None: there is nothing
            of that in the Diagram.

    Raises:
        ValueError: when the scenario is out of range; UserError is one.
    """
    builder = DiagramBuilder()
    disturbance = None
    controller = AddController(builder, scenario)
    reference = AddReference(builder, scenario)
    robot = AddRobot(builder, scenario, link, session)
    builder.Connect(
        reference.GetOutputPort("reference_window"), controller.GetInputPort("reference_window")
    )
    builder.Connect(controller.GetOutputPort("wheel_command"), robot.wheel_command)
    builder.Connect(robot.pose, controller.GetInputPort("pose"))
    if robot.disturbance is not None:
        source = _add_disturbance(builder, scenario)
        disturbance = source.GetOutputPort("disturbance")
        if view is not None:
            disturbance = view.add_disturbance_controls(builder, disturbance)
        builder.Connect(disturbance, robot.disturbance)
        builder.ExportOutput(disturbance, "disturbance")
    if reference.HasInputPort("velocity_setpoint"):
        builder.ExportInput(reference.GetInputPort("velocity_setpoint"), "velocity_setpoint")
    builder.ExportOutput(reference.GetOutputPort("reference"), "reference")
    builder.ExportOutput(robot.pose, "pose")
    builder.ExportOutput(robot.body_velocity, "body_velocity")
    if robot.true_pose is not None:
        builder.ExportOutput(robot.true_pose, "true_pose")
    if robot.wire is not None:
        builder.Connect(reference.GetOutputPort("reference"), robot.wire.reference)
        if controller.HasOutputPort("plan"):
            builder.Connect(controller.GetOutputPort("solve_status"), robot.wire.solve_status)
            builder.Connect(controller.GetOutputPort("plan"), robot.wire.plan)
        export_wire(builder, robot.wire)
    for index in range(controller.num_output_ports()):
        port = controller.get_output_port(index)
        builder.ExportOutput(port, port.get_name())
    if view is not None:
        view.add_scene(builder, controller, reference, robot, disturbance)
    diagram = builder.Build()
    diagram.set_name("mirte_drake")
    return diagram


def export_wire(builder: DiagramBuilder, wire: WirePorts) -> None:
    """Makes of a wire's ports those of the Diagram that whoever drives it needs."""
    builder.ExportInput(wire.clock, "clock")
    builder.ExportOutput(wire.odometry_age, "odometry_age")
    builder.ExportOutput(wire.drive_command, "drive_command")
    builder.ExportOutput(wire.plan_view, "plan_view")


def MakeRobot(scenario: Scenario) -> Diagram:
    """Wires disturbance and robot of a scenario: what `mirte-drake robot` puts behind a wire.

    .. pydrake_system::

        name: Robot
        input_ports:
        - wheel_command
        output_ports:
        - pose
        - body_velocity
        - true_pose

    Raises:
        ValueError: when the scenario is out of range; UserError is one.
    """
    builder = DiagramBuilder()
    robot = AddRobot(builder, scenario)
    if robot.disturbance is not None:
        source = _add_disturbance(builder, scenario)
        builder.Connect(source.GetOutputPort("disturbance"), robot.disturbance)
    assert robot.true_pose is not None
    builder.ExportInput(robot.wheel_command, "wheel_command")
    builder.ExportOutput(robot.pose, "pose")
    builder.ExportOutput(robot.body_velocity, "body_velocity")
    builder.ExportOutput(robot.true_pose, "true_pose")
    return builder.Build()


def _add_disturbance(builder: DiagramBuilder, scenario: Scenario) -> DisturbanceSource:
    return AddDisturbanceSource(
        builder, scenario.disturbance, period=scenario.period, seed=scenario.seed
    )
