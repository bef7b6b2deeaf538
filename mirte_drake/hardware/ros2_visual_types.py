"""ROS 2 messages for onlookers, RViz and Foxglove; names and fields as in ``ros2_types``."""

import dataclasses as dc

from cyclonedds.idl import IdlStruct
from cyclonedds.idl import annotations as idl
from cyclonedds.idl.types import float32, int32, sequence, uint8, uint32

from mirte_drake.hardware.ros2_types import Header, Point, Pose, PoseStamped, Vector3


@dc.dataclass
@idl.final
class Duration(IdlStruct, typename="builtin_interfaces.msg.dds_.Duration_"):
    """builtin_interfaces/Duration."""

    sec: int32 = 0
    nanosec: uint32 = 0


@dc.dataclass
@idl.final
class ColorRGBA(IdlStruct, typename="std_msgs.msg.dds_.ColorRGBA_"):
    """std_msgs/ColorRGBA."""

    r: float32 = 0.0
    g: float32 = 0.0
    b: float32 = 0.0
    a: float32 = 0.0


@dc.dataclass
@idl.final
class Path(IdlStruct, typename="nav_msgs.msg.dds_.Path_"):
    """nav_msgs/Path."""

    header: Header
    poses: sequence[PoseStamped]


@dc.dataclass
@idl.final
class CompressedImage(IdlStruct, typename="sensor_msgs.msg.dds_.CompressedImage_"):
    """sensor_msgs/CompressedImage, a field of Marker that we leave empty."""

    header: Header = dc.field(default_factory=Header)
    format: str = ""
    data: sequence[uint8] = dc.field(default_factory=list)


@dc.dataclass
@idl.final
class UVCoordinate(IdlStruct, typename="visualization_msgs.msg.dds_.UVCoordinate_"):
    """visualization_msgs/UVCoordinate, a field of Marker that we leave empty."""

    u: float32 = 0.0
    v: float32 = 0.0


@dc.dataclass
@idl.final
class MeshFile(IdlStruct, typename="visualization_msgs.msg.dds_.MeshFile_"):
    """visualization_msgs/MeshFile, a field of Marker that we leave empty."""

    filename: str = ""
    data: sequence[uint8] = dc.field(default_factory=list)


@dc.dataclass
@idl.final
class Marker(IdlStruct, typename="visualization_msgs.msg.dds_.Marker_"):
    """visualization_msgs/Marker."""

    header: Header = dc.field(default_factory=Header)
    ns: str = ""
    id: int32 = 0
    type: int32 = 0
    action: int32 = 0
    pose: Pose = dc.field(default_factory=Pose)
    scale: Vector3 = dc.field(default_factory=Vector3)
    color: ColorRGBA = dc.field(default_factory=ColorRGBA)
    lifetime: Duration = dc.field(default_factory=Duration)
    frame_locked: bool = False
    points: sequence[Point] = dc.field(default_factory=list)
    colors: sequence[ColorRGBA] = dc.field(default_factory=list)
    texture_resource: str = ""
    texture: CompressedImage = dc.field(default_factory=CompressedImage)
    uv_coordinates: sequence[UVCoordinate] = dc.field(default_factory=list)
    text: str = ""
    mesh_resource: str = ""
    mesh_file: MeshFile = dc.field(default_factory=MeshFile)
    mesh_use_embedded_materials: bool = False


@dc.dataclass
@idl.final
class MarkerArray(IdlStruct, typename="visualization_msgs.msg.dds_.MarkerArray_"):
    """visualization_msgs/MarkerArray."""

    markers: sequence[Marker]
