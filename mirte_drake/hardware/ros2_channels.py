"""On which ROS 2 topic and as which type each of our messages travels."""

import dataclasses as dc
from collections.abc import Callable
from typing import Any

from cyclonedds.idl import IdlStruct

from mirte_drake.hardware import ros2_convert as convert
from mirte_drake.hardware import ros2_types as ros
from mirte_drake.hardware import ros2_visual_types as visual
from mirte_drake.hardware.messages import (
    DriveCommand,
    GuardStatus,
    Odometry,
    OperatorRequest,
    PlanView,
)


@dc.dataclass(frozen=True)
class Channel:
    """How one of our messages travels."""

    topic: str
    kind: type[IdlStruct]
    to_ros: Callable[[Any], IdlStruct]
    from_ros: Callable[[Any, float], Any]  # Of a sample and the time of its arrival.


def channels(odometry_topic: str) -> dict[type, Channel]:
    """Returns the channels of the messages that travel on one topic each."""
    return {
        Odometry: Channel(
            odometry_topic, ros.Odometry, convert.odometry_to_ros, convert.odometry_from_ros
        ),
        DriveCommand: Channel(
            "/mirte_drake/drive_command",
            ros.DriveCommand,
            convert.drive_command_to_ros,
            convert.drive_command_from_ros,
        ),
        GuardStatus: Channel(
            "/mirte_drake/guard_status",
            ros.GuardStatus,
            convert.guard_status_to_ros,
            convert.guard_status_from_ros,
        ),
        OperatorRequest: Channel(
            "/mirte_drake/operator_request",
            ros.OperatorRequest,
            convert.operator_request_to_ros,
            convert.operator_request_from_ros,
        ),
    }


# What an onlooker sees of a PlanView: topic, type and content. The first two are those of the
# published controller.
VIEWS: list[tuple[str, type[IdlStruct], Callable[[PlanView], IdlStruct]]] = [
    ("/reference_trajectory", ros.PoseStamped, lambda v: convert.pose_stamped(v.reference[0])),
    ("/nominal_trajectory", ros.PoseStamped, lambda v: convert.pose_stamped(v.nominal[0])),
    ("/mirte_drake/reference_path", visual.Path, lambda v: convert.path(v.reference)),
    ("/mirte_drake/nominal_path", visual.Path, lambda v: convert.path(v.nominal)),
    ("/mirte_drake/tube", visual.MarkerArray, convert.tube_markers),
]
