"""The robot of a scenario, simulated or beyond a wire, and what disturbs it."""

from pydrake.systems.framework import Diagram, DiagramBuilder

from mirte_drake.hardware.link import Link, Role
from mirte_drake.hardware.wire_config import open_link
from mirte_drake.robots.lcm_robot import MakeLcmRobot
from mirte_drake.robots.measured_robot import AddMeasuredRobot
from mirte_drake.robots.robot_ports import RobotPorts, WirePorts
from mirte_drake.robots.ros2_robot import MakeRos2Robot, Ros2RobotConfig
from mirte_drake.robots.sindyc_robot import AddSindycRobot, SindycRobotConfig
from mirte_drake.robots.wire_robot import WireRobot
from mirte_drake.robots.wired_robot import wired_ports
from mirte_drake.scenario import Scenario, WiredRobotConfig, load_prediction_model
from mirte_drake.systems.disturbance_source import AddDisturbanceSource, DisturbanceSource


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


def export_wire(builder: DiagramBuilder, wire: WirePorts) -> None:
    """Makes of a wire's ports those of the Diagram that whoever drives it needs."""
    builder.ExportInput(wire.clock, "clock")
    builder.ExportOutput(wire.odometry_age, "odometry_age")
    builder.ExportOutput(wire.drive_command, "drive_command")
    builder.ExportOutput(wire.plan_view, "plan_view")


def AddDisturbance(builder: DiagramBuilder, scenario: Scenario) -> DisturbanceSource:
    """Adds the source of the disturbance; port ``disturbance``."""
    return AddDisturbanceSource(
        builder, scenario.disturbance, period=scenario.period, seed=scenario.seed
    )


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
        source = AddDisturbance(builder, scenario)
        builder.Connect(source.GetOutputPort("disturbance"), robot.disturbance)
    assert robot.true_pose is not None
    builder.ExportInput(robot.wheel_command, "wheel_command")
    builder.ExportOutput(robot.pose, "pose")
    builder.ExportOutput(robot.body_velocity, "body_velocity")
    builder.ExportOutput(robot.true_pose, "true_pose")
    return builder.Build()
