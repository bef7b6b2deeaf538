"""The messages as ROS 2 sees them, in bytes: what bags and the live view have in common."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mirte_drake.checks import check_choice
from mirte_drake.errors import UserError
from mirte_drake.hardware.messages import (
    DriveCommand,
    GuardStatus,
    Message,
    Odometry,
    OperatorRequest,
    PlanView,
    WheelCommand,
)
from mirte_drake.hardware.wire_config import MOTOR_TYPES, Ros2WireConfig
from mirte_drake.vectors import WHEELS

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

FRAME, BODY_FRAME = "odom", "base_link"  # As the robot names them.

# Topics of what the controller shows; the first two as the thesis's program has them.
REFERENCE_TOPIC = "/reference_trajectory"
NOMINAL_TOPIC = "/nominal_trajectory"
REFERENCE_PATH_TOPIC = "/reference_path"
NOMINAL_PATH_TOPIC = "/nominal_path"
TUBE_TOPIC = "/tube"
DRIVE_TOPIC = "/drive_command"
STATUS_TOPIC = "/guard_status"
REQUEST_TOPIC = "/operator_request"

ODOMETRY, POSE_STAMPED = "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped"
PATH, MARKERS = "nav_msgs/msg/Path", "visualization_msgs/msg/MarkerArray"
MOTORS = {"Int32": "std_msgs/msg/Int32", "SetSpeed": "mirte_msgs/msg/SetSpeed"}
DRIVE, STATUS = "mirte_drake_msgs/msg/DriveCommand", "mirte_drake_msgs/msg/GuardStatus"
REQUEST = "mirte_drake_msgs/msg/OperatorRequest"
DEFINITIONS = {
    MOTORS["SetSpeed"]: "int32 speed",
    DRIVE: """int64 session
int64 sequence
float64[4] command         # [pwm]
float64[3] reference       # [m, m, rad]
int64 odometry_stamp       # [ns]
bool solve_failed
bool done""",
    STATUS: """int64 session
int64 sequence
float64[4] command         # [pwm]
bool stopped
string reason
float64 odometry_age       # [s]
int64 rejected""",
    REQUEST: "uint8 request    # 1: stop, 2: reset",
}

CUBE_LIST, ADD = 6, 0  # visualization_msgs/Marker.
TUBE_COLOR = (0.1, 0.5, 0.9, 0.25)  # Red, green, blue, alpha.
SMALLEST_BOX = 1e-3  # [m] Viewers complain of boxes without extent.
LARGEST_SECOND = 2**31 - 1


class Encoded(NamedTuple):
    """One message of ROS 2."""

    topic: str
    time: int  # [ns] since 1970, when it was sent or received.
    data: bytes  # CDR.


class Ros2Messages:
    """Turns our messages into those of ROS 2, whatever wire they came from.

    ====================  =====================================================================
    message               becomes
    ====================  =====================================================================
    Odometry              nav_msgs/Odometry on its topic, covariances zero
    WheelCommand          std_msgs/Int32 or mirte_msgs/SetSpeed on the four motor topics
    DriveCommand          mirte_drake_msgs/DriveCommand on ``DRIVE_TOPIC``
    GuardStatus           mirte_drake_msgs/GuardStatus on ``STATUS_TOPIC``
    OperatorRequest       mirte_drake_msgs/OperatorRequest on ``REQUEST_TOPIC``
    PlanView              reference and nominal pose of now as geometry_msgs/PoseStamped, both over
                          the horizon as nav_msgs/Path, the box of half-widths d_k around each
                          nominal pose as visualization_msgs/MarkerArray
    ====================  =====================================================================

    The types of mirte_drake_msgs have the fields of ``messages``; viewers need no package of them,
    since bag and live view carry the definitions.

    Attributes:
        topics: Type of each topic.
    """

    def __init__(
        self,
        *,
        namespace: str = Ros2WireConfig.namespace,
        odometry_topic: str = Ros2WireConfig.odometry_topic,
        motor_type: str = Ros2WireConfig.motor_type,
    ) -> None:
        """Prepares all types, so that none costs time while a robot drives.

        Args:
            namespace: Where ``motor/WHEEL/speed`` are.
            odometry_topic: Topic of the odometry.
            motor_type: "Int32", "SetSpeed", or "auto", which is Int32 here.

        Raises:
            UserError: when the package rosbags is not installed.
            ValueError: when ``motor_type`` is none of these.
        """
        check_choice("motor_type", motor_type, MOTOR_TYPES)
        self._motor_type = MOTORS["Int32" if motor_type == "auto" else motor_type]
        self._motor_topics = [f"{namespace}/motor/{wheel}/speed" for wheel in WHEELS]
        self._odometry_topic = odometry_topic
        self.topics = {
            odometry_topic: ODOMETRY,
            **dict.fromkeys(self._motor_topics, self._motor_type),
            REFERENCE_TOPIC: POSE_STAMPED,
            NOMINAL_TOPIC: POSE_STAMPED,
            REFERENCE_PATH_TOPIC: PATH,
            NOMINAL_PATH_TOPIC: PATH,
            TUBE_TOPIC: MARKERS,
            DRIVE_TOPIC: DRIVE,
            STATUS_TOPIC: STATUS,
            REQUEST_TOPIC: REQUEST,
        }
        self._store = _typestore()
        for kind in self.topics.values():
            self._store.get_msgdef(kind)

    def definition(self, kind: str) -> str:
        """Returns the definition of a type and of those within, as .msg text."""
        return str(self._store.generate_msgdef(kind, ros_version=2)[0])

    def encode(self, message: Message, time: int) -> list[Encoded]:
        """Returns the messages of ROS 2 that show a message.

        Args:
            message: The message; its numbers may be of no sense, as they may come from a wire.
            time: [ns] since 1970, when it was sent or received.

        Raises:
            ValueError: when a wheel command is not finite.
        """
        return [
            Encoded(topic, time, bytes(self._store.serialize_cdr(content, self.topics[topic])))
            for topic, content in self._contents(message, time)
        ]

    def _contents(self, message: Message, time: int) -> Iterator[tuple[str, object]]:
        match message:
            case Odometry():
                yield self._odometry_topic, self._odometry(message)
            case WheelCommand():
                for topic, wheel in zip(self._motor_topics, message.command, strict=True):
                    yield topic, self._make(self._motor_type, round(float(wheel)))
            case DriveCommand():
                yield DRIVE_TOPIC, self._fields(DRIVE, message)
            case GuardStatus():
                yield STATUS_TOPIC, self._fields(STATUS, message)
            case OperatorRequest():
                yield REQUEST_TOPIC, self._make(REQUEST, int(message.request))
            case PlanView():
                header = self._header(time)
                reference, nominal = (
                    [self._make(POSE_STAMPED, header, self._pose(pose)) for pose in poses]
                    for poses in (message.reference, message.nominal)
                )
                yield REFERENCE_TOPIC, reference[0]
                yield NOMINAL_TOPIC, nominal[0]
                yield REFERENCE_PATH_TOPIC, self._make(PATH, header, reference)
                yield NOMINAL_PATH_TOPIC, self._make(PATH, header, nominal)
                yield TUBE_TOPIC, self._make(MARKERS, [self._tube(message, header)])

    def _make(self, kind: str, *fields: Any, **named: Any) -> Any:  # noqa: ANN401
        return self._store.types[kind](*fields, **named)

    def _fields(self, kind: str, message: Message) -> object:
        """Returns a message whose fields have the names of ours."""
        names = [field for field, _ in self._store.fielddefs[kind][1]]
        return self._make(kind, *(getattr(message, name) for name in names))

    def _header(self, time: int) -> object:
        seconds, nanoseconds = divmod(time, 10**9)
        seconds = max(-LARGEST_SECOND, min(seconds, LARGEST_SECOND))  # A stamp may be anything.
        stamp = self._make("builtin_interfaces/msg/Time", seconds, nanoseconds)
        return self._make("std_msgs/msg/Header", stamp, FRAME)

    def _point(self, x: float, y: float) -> object:
        return self._make("geometry_msgs/msg/Point", float(x), float(y), 0.0)

    def _vector(self, x: float, y: float, z: float) -> object:
        return self._make("geometry_msgs/msg/Vector3", float(x), float(y), float(z))

    def _pose(self, pose: np.ndarray) -> object:
        x, y, yaw = pose
        with np.errstate(invalid="ignore"):  # An infinite yaw has no sine.
            turn = (0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2)))
        return self._make(
            "geometry_msgs/msg/Pose",
            self._point(x, y),
            self._make("geometry_msgs/msg/Quaternion", *turn),
        )

    def _odometry(self, message: Odometry) -> object:
        vx, vy, yaw_rate = message.body_velocity
        twist = self._make(
            "geometry_msgs/msg/Twist", self._vector(vx, vy, 0.0), self._vector(0.0, 0.0, yaw_rate)
        )
        covariance = np.zeros(36)
        return self._make(
            ODOMETRY,
            self._header(message.stamp),
            BODY_FRAME,
            self._make(
                "geometry_msgs/msg/PoseWithCovariance", self._pose(message.pose), covariance
            ),
            self._make("geometry_msgs/msg/TwistWithCovariance", twist, covariance),
        )

    def _tube(self, message: PlanView, header: object) -> object:
        width, height, _ = np.maximum(2 * message.half_width, SMALLEST_BOX)
        nothing = np.zeros(0, np.uint8)
        return self._make(
            "visualization_msgs/msg/Marker",
            header=header,
            ns="tube",
            id=0,
            type=CUBE_LIST,
            action=ADD,
            pose=self._pose(np.zeros(3)),
            scale=self._vector(width, height, SMALLEST_BOX),
            color=self._make("std_msgs/msg/ColorRGBA", *TUBE_COLOR),
            lifetime=self._make("builtin_interfaces/msg/Duration", 0, 0),  # For ever.
            frame_locked=False,
            points=[self._point(x, y) for x, y, _ in message.nominal],
            colors=[],
            texture_resource="",
            texture=self._make("sensor_msgs/msg/CompressedImage", header, "", nothing),
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=self._make("visualization_msgs/msg/MeshFile", "", nothing),
            mesh_use_embedded_materials=False,
        )


def _typestore() -> "Typestore":
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise UserError("needs the package rosbags: pip install mirte-drake[bags]") from None
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, definition in DEFINITIONS.items():
        store.register(get_types_from_msg(definition, name))
    return store
