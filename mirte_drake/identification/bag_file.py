"""Recordings from ROS 2 bags, without a ROS installation: sqlite3 and mcap, through `rosbags`."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mirte_drake.angles import quaternion_yaw
from mirte_drake.errors import UserError
from mirte_drake.identification.recorded_run import RecordedRun, repaired
from mirte_drake.vectors import WHEELS

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

ODOMETRY_TOPIC = "/mirte_base_controller/odom"
HARDWARE_NAMESPACE = "/io"
ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
# Types of a wheel command, until and since 2026-03, and their field [pwm].
COMMAND_FIELDS = {"std_msgs/msg/Int32": "data", "mirte_msgs/msg/SetSpeed": "speed"}
SET_SPEED_DEFINITION = "int32 speed"


def load_bag(
    path: Path, odometry_topic: str = ODOMETRY_TOPIC, namespace: str = HARDWARE_NAMESPACE
) -> RecordedRun:
    """Reads a recording from a ROS 2 bag: one row per odometry message.

    Each row has the wheel commands in force half a sample after its odometry message was received,
    zero before the first. Time is that of the odometry's stamps; where they are empty, that of
    reception.

    Args:
        path: The bag's folder, or its .mcap or .db3 file.
        odometry_topic: Topic of the nav_msgs/Odometry messages.
        namespace: Where ``motor/WHEEL/speed`` are, std_msgs/Int32 or mirte_msgs/SetSpeed.

    Raises:
        UserError: when `rosbags` is not installed, the bag cannot be read or lacks a topic, or
            its content is of no use; see ``recorded_run.repaired``.
    """
    command_topics = [f"{namespace.rstrip('/')}/motor/{wheel}/speed" for wheel in WHEELS]
    types = {odometry_topic: (ODOMETRY_TYPE,)} | dict.fromkeys(command_topics, (*COMMAND_FIELDS,))
    received = _read(path, types)
    odometry = received[odometry_topic]
    arrival = np.array([stamp for stamp, _ in odometry], dtype=np.int64)
    repairs = []

    stamps = np.array([_nanoseconds(message) for _, message in odometry], dtype=np.int64)
    if not np.all(stamps > 0):
        stamps = arrival
        repairs.append("time: the odometry has no stamps; rebuilt from the times of reception")
    # A controller answers each odometry message a little later: what holds in the middle of the
    # sample is what drives it.
    middle = arrival + (int(np.median(np.diff(arrival))) // 2 if len(arrival) > 1 else 0)
    command = np.zeros((len(odometry), len(WHEELS)))
    for wheel, topic in enumerate(command_topics):
        sent = received[topic]
        values = np.array([0.0, *(getattr(m, _field(m)) for _, m in sent)])
        last = np.searchsorted([stamp for stamp, _ in sent], middle, side="right")
        command[:, wheel] = values[last]
        if zeros := np.count_nonzero(last == 0):
            rows = "1 row" if zeros == 1 else f"{zeros} rows"
            repairs.append(f"{WHEELS[wheel]}: zero in {rows} before its first command")
    poses = [_pose(message) for _, message in odometry]
    twists = [message.twist.twist for _, message in odometry]
    velocities = [[twist.linear.x, twist.linear.y, twist.angular.z] for twist in twists]
    run = RecordedRun(
        time=(stamps - stamps[:1]) / 1e9,
        pose=np.array(poses).reshape(-1, 3),
        body_velocity=np.array(velocities).reshape(-1, 3),
        wheel_command=command,
        source=path.name,
        sha256=_checksum(path),
        repairs=tuple(repairs),
    )
    return repaired(run, lambda row: f"{odometry_topic}, message {row + 1}", str(path))


def _read(path: Path, types: Mapping[str, tuple[str, ...]]) -> dict[str, list[tuple[int, Any]]]:
    """Returns per topic the times of reception [ns] and the messages."""
    if not path.exists():
        raise UserError(f"{path}: cannot be read: there is no such file or folder")
    if path.is_dir() and not (path / "metadata.yaml").exists():
        raise UserError(
            f"{path}: is a folder without metadata.yaml: name a CSV file, the folder of a ROS 2 "
            "bag, or its .mcap or .db3 file"
        )
    received: dict[str, list[tuple[int, Any]]] = {topic: [] for topic in types}
    try:
        with _open(path) as reader:
            _check_topics({c.topic: c.msgtype for c in reader.connections}, types)
            wanted = [c for c in reader.connections if c.topic in types]
            for connection, stamp, data in reader.messages(connections=wanted):
                message = reader.deserialize(data, connection.msgtype)
                received[connection.topic].append((stamp, message))
    except UserError as error:
        raise UserError(f"{path}: {error}") from None
    except Exception as error:  # Broken files fail in many ways inside rosbags.
        problem = " ".join(str(error).split()) or type(error).__name__
        raise UserError(
            f"{path}: cannot be read as a ROS 2 bag ({problem:.200}): mend it with "
            "`ros2 bag reindex` or `mcap recover`, or record again"
        ) from None
    return received


def _open(path: Path) -> "AnyReader":
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise UserError("needs the package rosbags: pip install mirte-drake[bags]") from None
    store = get_typestore(Stores.ROS2_HUMBLE)  # For bags that do not carry their definitions.
    store.register(get_types_from_msg(SET_SPEED_DEFINITION, "mirte_msgs/msg/SetSpeed"))
    return AnyReader([path], default_typestore=store)


def _check_topics(found: dict[str, str], types: Mapping[str, tuple[str, ...]]) -> None:
    if missing := [topic for topic in types if topic not in found]:
        there = ", ".join(sorted(found)) or "no topics"
        raise UserError(f"topics missing: {', '.join(missing)}; the bag has {there}")
    for topic, accepted in types.items():
        if found[topic] not in accepted:
            raise UserError(f"{topic} is {found[topic]}: must be {' or '.join(accepted)}")


def _nanoseconds(message: Any) -> int:  # noqa: ANN401
    stamp = message.header.stamp
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def _field(message: Any) -> str:  # noqa: ANN401
    return COMMAND_FIELDS[message.__msgtype__]


def _pose(message: Any) -> list[float]:  # noqa: ANN401
    """Returns x, y [m] and the yaw [rad] of the quaternion, nan for one of length zero."""
    position, q = message.pose.pose.position, message.pose.pose.orientation
    return [position.x, position.y, quaternion_yaw(q.x, q.y, q.z, q.w)]


def _checksum(path: Path) -> str:
    """Returns the SHA-256 of a file, or of the files of a folder in the order of their names."""
    digest = hashlib.sha256()
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    for file in files:
        if file.is_file():
            digest.update(file.read_bytes())
    return digest.hexdigest()
