"""Types and conversions, compared with rosbags: an independent copy of ROS 2's definitions."""

import dataclasses as dc

import numpy as np
import pytest

IdlStruct = pytest.importorskip("cyclonedds.idl", reason="cyclonedds is not installed").IdlStruct
typesys = pytest.importorskip("rosbags.typesys", reason="rosbags is not installed")

from mirte_drake.hardware import messages  # noqa: E402
from mirte_drake.hardware import ros2_convert as convert  # noqa: E402
from mirte_drake.hardware import ros2_types as ros  # noqa: E402
from mirte_drake.hardware import ros2_visual_types as visual  # noqa: E402

STORE = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
STORE.register(typesys.get_types_from_msg("int32 speed", "mirte_msgs/msg/SetSpeed"))


def kinds(module):
    return {
        kind
        for kind in vars(module).values()
        if isinstance(kind, type) and issubclass(kind, IdlStruct) and kind is not IdlStruct
    }


OWN = {ros.DriveCommand, ros.GuardStatus, ros.OperatorRequest}
ROS_KINDS = sorted((kinds(ros) | kinds(visual)) - OWN, key=lambda kind: kind.__name__)


def ros_name(kind) -> str:
    """std_msgs.msg.dds_.Int32_ is std_msgs/msg/Int32."""
    package, msg, dds, name = kind.__idl_typename__.split(".")
    assert (msg, dds, name[-1]) == ("msg", "dds_", "_")
    return f"{package}/msg/{name[:-1]}"


def example(name: str, rng):
    """A message of rosbags, with a value in every field."""
    values = {}
    for field, (node, detail) in STORE.fielddefs[name][1]:
        if node.name == "BASE":
            values[field] = primitive(detail[0], rng)
        elif node.name == "NAME":
            values[field] = example(detail, rng)
        else:
            (inner, inner_detail), length = detail
            count = length or 3
            if inner.name == "BASE":
                values[field] = np.array([primitive(inner_detail[0], rng) for _ in range(count)])
                values[field] = values[field].astype(inner_detail[0])
            else:
                values[field] = [example(inner_detail, rng) for _ in range(count)]
    return STORE.types[name](**values)


def primitive(name: str, rng):
    match name:
        case "string":
            return "é" + "x" * int(rng.integers(0, 7))  # Of several lengths, for the alignment.
        case "bool":
            return bool(rng.integers(2))
        case "float32" | "float64":
            return float(np.float32(rng.normal()))
        case _:
            return int(rng.integers(0, 200))


def plain(value):
    """A message of either kind as dictionaries, lists and numbers, without constants."""
    if dc.is_dataclass(value):
        fields = [f.name for f in dc.fields(value) if f.name[0].islower()]
        return {name: plain(getattr(value, name)) for name in fields}
    if isinstance(value, np.ndarray):
        return value.tolist()
    return [plain(entry) for entry in value] if isinstance(value, list) else value


def test_there_are_types_to_compare():
    names = {ros_name(kind) for kind in ROS_KINDS}
    assert {"std_msgs/msg/Int32", "nav_msgs/msg/Odometry", "visualization_msgs/msg/Marker"} < names


@pytest.mark.parametrize("kind", ROS_KINDS, ids=lambda kind: kind.__name__)
def test_bytes_are_those_of_ros_2_both_ways(kind):
    name = ros_name(kind)
    theirs = example(name, np.random.default_rng(0))
    data = bytes(STORE.serialize_cdr(theirs, name))
    ours = kind.deserialize(data)
    assert plain(ours) == plain(theirs)
    assert plain(STORE.deserialize_cdr(ours.serialize(use_version_2=False), name)) == plain(theirs)


def test_odometry_by_hand():
    pose, velocity = np.array([1.0, -2.0, np.pi / 2]), np.array([0.1, 0.2, 0.3])
    sample = convert.odometry_to_ros(messages.Odometry(12_000_000_345, pose, velocity))
    assert sample.header == ros.Header(ros.Time(12, 345), "odom")
    assert sample.child_frame_id == "base_link"
    half = np.sqrt(0.5)
    assert sample.pose.pose.position == ros.Point(1.0, -2.0, 0.0)
    np.testing.assert_allclose(
        dc.astuple(sample.pose.pose.orientation), (0.0, 0.0, half, half), rtol=1e-15
    )
    assert sample.twist.twist == ros.Twist(ros.Vector3(0.1, 0.2, 0.0), ros.Vector3(0.0, 0.0, 0.3))


@pytest.mark.parametrize("yaw", [0.0, 3.0, -3.0, 100.0])
def test_odometry_there_and_back(yaw):
    message = messages.Odometry(2**31 * 10**9 - 1, np.array([1.0, 2.0, yaw]), np.arange(3.0))
    back = convert.odometry_from_ros(convert.odometry_to_ros(message), arrival=7.0)
    assert (back.stamp, back.arrival) == (message.stamp, 7.0)
    np.testing.assert_array_equal(back.body_velocity, message.body_velocity)
    np.testing.assert_array_equal(back.pose[:2], message.pose[:2])
    np.testing.assert_allclose(np.sin((back.pose[2] - yaw) / 2), 0.0, atol=1e-14)


def test_odometry_that_is_not_a_number_is_passed_on():
    message = messages.Odometry(1, np.array([np.nan, np.inf, np.nan]), np.full(3, -np.inf))
    back = convert.odometry_from_ros(convert.odometry_to_ros(message), arrival=0.0)
    np.testing.assert_array_equal(back.pose, message.pose)
    np.testing.assert_array_equal(back.body_velocity, message.body_velocity)


COMMAND = messages.DriveCommand(
    session=2**63 - 1,
    sequence=5,
    command=np.array([1.5, -2.0, 100.0, 0.0]),
    reference=np.array([1.0, 2.0, -3.0]),
    odometry_stamp=1_756_120_957_123_456_789,
    solve_failed=True,
    done=False,
)
STATUS = messages.GuardStatus(
    session=1,
    sequence=2**40,
    command=np.array([-1.0, 2.0, -3.0, 4.0]),
    stopped=True,
    reason="odometry is 0.31 s old: too late, näh",
    odometry_age=np.inf,
    rejected=3,
)


@pytest.mark.parametrize(
    ("message", "to_ros", "from_ros"),
    [
        (COMMAND, convert.drive_command_to_ros, convert.drive_command_from_ros),
        (STATUS, convert.guard_status_to_ros, convert.guard_status_from_ros),
        (
            messages.OperatorRequest(messages.Request.RESET),
            convert.operator_request_to_ros,
            convert.operator_request_from_ros,
        ),
    ],
    ids=lambda value: type(value).__name__,
)
def test_our_own_messages_there_and_back_through_bytes(message, to_ros, from_ros):
    sample = to_ros(message)
    back = from_ros(type(sample).deserialize(sample.serialize(use_version_2=False)), 7.0)
    assert plain(back) == plain(message) | ({"arrival": 7.0} if hasattr(message, "arrival") else {})


def test_a_request_that_does_not_exist():
    with pytest.raises(ValueError, match="7"):
        convert.operator_request_from_ros(ros.OperatorRequest(7), 0.0)


VIEW = messages.PlanView(
    reference=np.array([[0.0, 0.0, 0.0], [1.0, 0.5, np.pi]]),
    nominal=np.array([[0.1, 0.2, 0.0], [0.9, 0.4, 3.0]]),
    half_width=np.array([0.1, 0.0, 0.3]),
)


def test_tube_by_hand():
    """Boxes of 2 d_k along the axes of the odometry frame, 5 mm where they would be flat."""
    (marker,) = convert.tube_markers(VIEW).markers
    assert marker.type == 6 and marker.action == 0  # CUBE_LIST, ADD.
    assert marker.header.frame_id == "odom" and marker.pose == ros.Pose()
    assert marker.scale == ros.Vector3(0.2, 0.005, 0.005)
    assert marker.points == [ros.Point(0.1, 0.2, 0.0), ros.Point(0.9, 0.4, 0.0)]
    assert 0 < marker.color.a < 0.5


def test_path_by_hand():
    path = convert.path(VIEW.reference)
    assert path.header.frame_id == "odom"
    assert [p.header.frame_id for p in path.poses] == ["odom", "odom"]
    assert path.poses[0].pose == ros.Pose()
    np.testing.assert_allclose(convert.pose_from_ros(path.poses[1].pose), [1.0, 0.5, np.pi])
