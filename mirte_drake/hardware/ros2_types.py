"""ROS 2 messages as they are on the wire: names, fields and order of ROS 2 Humble's definitions.

Each class has the DDS name of its type (``std_msgs/msg/Int32`` is ``std_msgs::msg::dds_::Int32_``)
and final extensibility, which gives the plain CDR that ROS 2 sends.
"""

import dataclasses as dc

from cyclonedds.idl import IdlStruct
from cyclonedds.idl import annotations as idl
from cyclonedds.idl.types import array, float64, int32, int64, uint8, uint32


@dc.dataclass
@idl.final
class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    """builtin_interfaces/Time."""

    sec: int32 = 0
    nanosec: uint32 = 0


@dc.dataclass
@idl.final
class Header(IdlStruct, typename="std_msgs.msg.dds_.Header_"):
    """std_msgs/Header. A stamp of zero asks an onlooker for the newest transform of the frame."""

    stamp: Time = dc.field(default_factory=Time)
    frame_id: str = "odom"


@dc.dataclass
@idl.final
class Int32(IdlStruct, typename="std_msgs.msg.dds_.Int32_"):
    """std_msgs/Int32, a wheel command [pwm] until 2026-03."""

    data: int32


@dc.dataclass
@idl.final
class SetSpeed(IdlStruct, typename="mirte_msgs.msg.dds_.SetSpeed_"):
    """mirte_msgs/SetSpeed, a wheel command [pwm] since 2026-03."""

    speed: int32


@dc.dataclass
@idl.final
class Point(IdlStruct, typename="geometry_msgs.msg.dds_.Point_"):
    """geometry_msgs/Point [m]."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dc.dataclass
@idl.final
class Vector3(IdlStruct, typename="geometry_msgs.msg.dds_.Vector3_"):
    """geometry_msgs/Vector3."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dc.dataclass
@idl.final
class Quaternion(IdlStruct, typename="geometry_msgs.msg.dds_.Quaternion_"):
    """geometry_msgs/Quaternion."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0


@dc.dataclass
@idl.final
class Pose(IdlStruct, typename="geometry_msgs.msg.dds_.Pose_"):
    """geometry_msgs/Pose."""

    position: Point = dc.field(default_factory=Point)
    orientation: Quaternion = dc.field(default_factory=Quaternion)


@dc.dataclass
@idl.final
class PoseStamped(IdlStruct, typename="geometry_msgs.msg.dds_.PoseStamped_"):
    """geometry_msgs/PoseStamped."""

    header: Header
    pose: Pose


@dc.dataclass
@idl.final
class PoseWithCovariance(IdlStruct, typename="geometry_msgs.msg.dds_.PoseWithCovariance_"):
    """geometry_msgs/PoseWithCovariance."""

    pose: Pose
    covariance: array[float64, 36] = dc.field(default_factory=lambda: [0.0] * 36)


@dc.dataclass
@idl.final
class Twist(IdlStruct, typename="geometry_msgs.msg.dds_.Twist_"):
    """geometry_msgs/Twist [m/s, rad/s]."""

    linear: Vector3
    angular: Vector3


@dc.dataclass
@idl.final
class TwistWithCovariance(IdlStruct, typename="geometry_msgs.msg.dds_.TwistWithCovariance_"):
    """geometry_msgs/TwistWithCovariance."""

    twist: Twist
    covariance: array[float64, 36] = dc.field(default_factory=lambda: [0.0] * 36)


@dc.dataclass
@idl.final
class Odometry(IdlStruct, typename="nav_msgs.msg.dds_.Odometry_"):
    """nav_msgs/Odometry."""

    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


@dc.dataclass
@idl.final
class DriveCommand(IdlStruct, typename="mirte_drake_msgs.msg.dds_.DriveCommand_"):
    """Our own: ``messages.DriveCommand``."""

    session: int64
    sequence: int64
    command: array[float64, 4]
    reference: array[float64, 3]
    odometry_stamp: int64
    solve_failed: bool
    done: bool


@dc.dataclass
@idl.final
class GuardStatus(IdlStruct, typename="mirte_drake_msgs.msg.dds_.GuardStatus_"):
    """Our own: ``messages.GuardStatus``."""

    session: int64
    sequence: int64
    command: array[float64, 4]
    stopped: bool
    reason: str
    odometry_age: float64
    rejected: int64


@dc.dataclass
@idl.final
class OperatorRequest(IdlStruct, typename="mirte_drake_msgs.msg.dds_.OperatorRequest_"):
    """Our own: ``messages.OperatorRequest``."""

    request: uint8
