"""Diagrams of the robots beyond a wire: what listens, what speaks, and the adapter between."""

from pydrake.systems.framework import Diagram, DiagramBuilder, InputPort, OutputPort

from mirte_drake.robots.robot_ports import RobotPorts, WirePorts
from mirte_drake.robots.wire_robot import WireRobot

INPUTS = ("wheel_command", "reference", "solve_status", "plan", "clock")
OUTPUTS = ("pose", "body_velocity", "odometry_age", "drive_command", "plan_view")


def MakeWiredRobot(
    name: str,
    builder: DiagramBuilder,
    adapter: WireRobot,
    *,
    odometry: OutputPort,
    guard_status: OutputPort,
    drive_command: InputPort,
    plan_view: InputPort,
) -> Diagram:
    """Connects an adapter to what speaks on its wire, and builds the Diagram.

    .. pydrake_system::

        name: WiredRobot
        input_ports:
        - wheel_command
        - reference
        - solve_status
        - plan
        - clock
        output_ports:
        - pose
        - body_velocity
        - odometry_age
        - drive_command
        - plan_view

    The ports are those of WireRobot, but for what comes over the wire.

    Args:
        name: Of the Diagram.
        builder: Where adapter, listeners and speakers are.
        adapter: The adapter.
        odometry: Gives Odometry or NOTHING.
        guard_status: Gives GuardStatus or NOTHING.
        drive_command: Sends a DriveCommand when told to publish; not NOTHING.
        plan_view: Sends a PlanView; not NOTHING.
    """
    builder.Connect(odometry, adapter.GetInputPort("odometry"))
    builder.Connect(guard_status, adapter.GetInputPort("guard_status"))
    builder.Connect(adapter.GetOutputPort("drive_command"), drive_command)
    builder.Connect(adapter.GetOutputPort("plan_view"), plan_view)
    for port in INPUTS:
        builder.ExportInput(adapter.GetInputPort(port), port)
    for port in OUTPUTS:
        builder.ExportOutput(adapter.GetOutputPort(port), port)
    robot = builder.Build()
    robot.set_name(name)
    return robot


def wired_ports(robot: Diagram) -> RobotPorts:
    """Returns the ports of a Diagram of ``MakeWiredRobot``."""
    return RobotPorts(
        wheel_command=robot.GetInputPort("wheel_command"),
        pose=robot.GetOutputPort("pose"),
        body_velocity=robot.GetOutputPort("body_velocity"),
        wire=WirePorts(
            reference=robot.GetInputPort("reference"),
            solve_status=robot.GetInputPort("solve_status"),
            plan=robot.GetInputPort("plan"),
            clock=robot.GetInputPort("clock"),
            odometry_age=robot.GetOutputPort("odometry_age"),
            drive_command=robot.GetOutputPort("drive_command"),
            plan_view=robot.GetOutputPort("plan_view"),
        ),
    )
