"""A MIRTE Master on ROS 2, reached over DDS without a ROS installation."""

import dataclasses as dc

from pydrake.systems.framework import Diagram, DiagramBuilder

from mirte_drake.checks import check_parts
from mirte_drake.hardware.governor_config import GovernorConfig
from mirte_drake.hardware.link import Link
from mirte_drake.hardware.messages import GuardStatus, Odometry
from mirte_drake.hardware.wire_config import Ros2WireConfig
from mirte_drake.robots.link_systems import LinkSink, LinkSource
from mirte_drake.robots.wire_robot import WireRobot
from mirte_drake.robots.wired_robot import MakeWiredRobot


@dc.dataclass
class Ros2RobotConfig:
    """Config of a robot on ROS 2."""

    wire: Ros2WireConfig = dc.field(default_factory=Ros2WireConfig)
    governor: GovernorConfig = dc.field(default_factory=GovernorConfig)
    # Whether to predict the pose over the age of the measurement.
    roll_forward: bool = True

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_parts(self)


def MakeRos2Robot(config: Ros2RobotConfig, adapter: WireRobot, link: Link) -> Diagram:
    """Builds the robot beyond a ROS 2 wire; ports of ``MakeWiredRobot``.

    Args:
        config: The config.
        adapter: What is between wire and controller.
        link: The controller's end of the wire; somebody must wait on it.

    Raises:
        ValueError: when ``config`` is out of range.
    """
    config.validate()
    builder = DiagramBuilder()
    builder.AddNamedSystem("adapter", adapter)
    odometry = builder.AddNamedSystem("odometry_subscriber", LinkSource(link, Odometry))
    status = builder.AddNamedSystem("guard_status_subscriber", LinkSource(link, GuardStatus))
    command = builder.AddNamedSystem("drive_command_publisher", LinkSink(link))
    view = builder.AddNamedSystem("plan_view_publisher", LinkSink(link))
    return MakeWiredRobot(
        "ros2_robot",
        builder,
        adapter,
        odometry=odometry.get_output_port(),
        guard_status=status.get_output_port(),
        drive_command=command.get_input_port(),
        plan_view=view.get_input_port(),
    )
