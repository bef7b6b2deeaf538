"""A robot on LCM, by pydrake's own LCM systems."""

import dataclasses as dc
from typing import TYPE_CHECKING

from pydrake.systems.framework import Diagram, DiagramBuilder, TriggerType
from pydrake.systems.lcm import LcmPublisherSystem, LcmSubscriberSystem

from mirte_drake.checks import check_parts
from mirte_drake.hardware.governor_config import GovernorConfig
from mirte_drake.hardware.messages import DriveCommand, GuardStatus, Odometry, PlanView
from mirte_drake.hardware.wire_config import LcmWireConfig
from mirte_drake.robots.wire_robot import WireRobot
from mirte_drake.robots.wired_robot import MakeWiredRobot

if TYPE_CHECKING:
    from mirte_drake.hardware.lcm_link import LcmLink


@dc.dataclass
class LcmRobotConfig:
    """Config of a robot on LCM."""

    wire: LcmWireConfig = dc.field(default_factory=LcmWireConfig)
    governor: GovernorConfig = dc.field(default_factory=GovernorConfig)
    # Whether to predict the pose over the age of the measurement.
    roll_forward: bool = True

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_parts(self)


def MakeLcmRobot(config: LcmRobotConfig, adapter: WireRobot, link: "LcmLink") -> Diagram:
    """Builds the robot beyond an LCM wire; ports of ``MakeWiredRobot``.

    Args:
        config: The config.
        adapter: What is between wire and controller.
        link: The controller's end of the wire; somebody must wait on it.

    Raises:
        ValueError: when ``config`` is out of range.
    """
    from mirte_drake.hardware.lcm_messages import channel
    from mirte_drake.hardware.lcm_serializer import MessageSerializer

    config.validate()
    builder = DiagramBuilder()
    builder.AddNamedSystem("adapter", adapter)

    def subscriber(name: str, kind: type) -> LcmSubscriberSystem:
        system = LcmSubscriberSystem(
            channel(config.wire.prefix, kind), MessageSerializer(kind), link.lcm, 0.0
        )
        return builder.AddNamedSystem(name, system)

    def publisher(name: str, kind: type) -> LcmPublisherSystem:
        triggers = {TriggerType.kForced}  # See LinkSink.
        system = LcmPublisherSystem(
            channel(config.wire.prefix, kind), MessageSerializer(kind), link.lcm, triggers, 0.0
        )
        return builder.AddNamedSystem(name, system)

    odometry = subscriber("odometry_subscriber", Odometry)
    status = subscriber("guard_status_subscriber", GuardStatus)
    command = publisher("drive_command_publisher", DriveCommand)
    view = publisher("plan_view_publisher", PlanView)
    return MakeWiredRobot(
        "lcm_robot",
        builder,
        adapter,
        odometry=odometry.get_output_port(),
        guard_status=status.get_output_port(),
        drive_command=command.get_input_port(),
        plan_view=view.get_input_port(),
    )
