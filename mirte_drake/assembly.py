"""The only wiring: reference, controller, disturbance and robot to the Diagram of a scenario."""

from typing import Protocol

from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem, OutputPort

from mirte_drake.controllers.lagged_controller import MakeLaggedController
from mirte_drake.controllers.pose_controller import MakePoseController
from mirte_drake.controllers.tube_controller import MakeTubeController
from mirte_drake.hardware.link import Link
from mirte_drake.model.lagged_model import LaggedModel
from mirte_drake.robot_assembly import AddDisturbance, AddRobot, export_wire
from mirte_drake.robots.robot_ports import RobotPorts
from mirte_drake.scenario import Scenario, load_prediction_model
from mirte_drake.systems.reference_source import AddReferenceSource, ReferenceSource
from mirte_drake.systems.velocity_setpoint import (
    AddVelocitySetpointSource,
    VelocitySetpointConfig,
    VelocitySetpointSource,
)


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
        source = AddDisturbance(builder, scenario)
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
