import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lcm_examples import MESSAGES

from mirte_drake.errors import UserError
from mirte_drake.hardware import ros2_messages as ros2
from mirte_drake.hardware.messages import (
    DriveCommand,
    GuardStatus,
    Odometry,
    OperatorRequest,
    PlanView,
    WheelCommand,
)
from mirte_drake.hardware.ros2_messages import Ros2Messages

pytest.importorskip("rosbags", reason="rosbags is not installed")
decoder = pytest.importorskip("mcap_ros2.decoder", reason="mcap-ros2-support is not installed")
records = pytest.importorskip("mcap.records", reason="mcap is not installed")

CUBE_LIST, ADD = 6, 0  # By visualization_msgs/Marker.
TIME = 1_756_120_957_123_456_789  # [ns]


@pytest.fixture(scope="module")
def messages():
    return Ros2Messages()


def decoded(messages, message):
    """By topic, as an implementation of ROS 2's bytes other than the one that writes them."""
    found = {}
    for topic, time, data in messages.encode(message, TIME):
        assert time == TIME
        kind = messages.topics[topic]
        schema = records.Schema(1, messages.definition(kind).encode(), "ros2msg", kind)
        found[topic] = decoder.DecoderFactory().decoder_for("cdr", schema)(data)
    return found


def xy_yaw(pose):
    q = pose.orientation
    assert q.x == q.y == pose.position.z == 0
    return [pose.position.x, pose.position.y, 2 * np.arctan2(q.z, q.w)]


def stamp(header):
    assert header.frame_id == "odom"
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def test_odometry(messages):
    message = MESSAGES[Odometry]
    (odometry,) = decoded(messages, message).values()
    assert stamp(odometry.header) == message.stamp
    assert odometry.child_frame_id == "base_link"
    np.testing.assert_allclose(xy_yaw(odometry.pose.pose), message.pose, rtol=1e-15)
    twist = odometry.twist.twist
    velocity = [twist.linear.x, twist.linear.y, twist.angular.z]
    np.testing.assert_array_equal(velocity, message.body_velocity)
    assert twist.linear.z == twist.angular.x == twist.angular.y == 0


@pytest.mark.parametrize(
    ("motor_type", "kind", "field"),
    [
        ("auto", "std_msgs/msg/Int32", "data"),
        ("Int32", "std_msgs/msg/Int32", "data"),
        ("SetSpeed", "mirte_msgs/msg/SetSpeed", "speed"),
    ],
)
def test_wheel_command(motor_type, kind, field):
    messages = Ros2Messages(namespace="/robot/io", motor_type=motor_type)
    found = decoded(messages, MESSAGES[WheelCommand])
    assert {topic: getattr(wheel, field) for topic, wheel in found.items()} == {
        "/robot/io/motor/front_left/speed": 1,
        "/robot/io/motor/front_right/speed": -20,
        "/robot/io/motor/rear_right/speed": 100,
        "/robot/io/motor/rear_left/speed": -100,
    }
    assert {messages.topics[topic] for topic in found} == {kind}


@pytest.mark.parametrize("kind", [DriveCommand, GuardStatus, OperatorRequest])
def test_messages_of_our_own_have_our_fields(messages, kind):
    (found,) = decoded(messages, MESSAGES[kind]).values()
    for name in vars(MESSAGES[kind]).keys() - {"arrival"}:
        np.testing.assert_array_equal(getattr(found, name), getattr(MESSAGES[kind], name))


def test_plan(messages):
    plan = MESSAGES[PlanView]
    found = decoded(messages, plan)
    for topic, path_topic, poses in (
        (ros2.REFERENCE_TOPIC, ros2.REFERENCE_PATH_TOPIC, plan.reference),
        (ros2.NOMINAL_TOPIC, ros2.NOMINAL_PATH_TOPIC, plan.nominal),
    ):
        path = found[path_topic]
        shown = np.array([xy_yaw(pose.pose) for pose in path.poses])
        np.testing.assert_array_equal(shown[:, :2], poses[:, :2])
        np.testing.assert_allclose(np.sin(shown[:, 2] - poses[:, 2]), 0.0, atol=1e-14)
        assert xy_yaw(found[topic].pose) == shown[0].tolist()
        assert {stamp(m.header) for m in (found[topic], path, *path.poses)} == {TIME}


def test_tube(messages):
    plan = MESSAGES[PlanView]
    (tube,) = decoded(messages, plan)[ros2.TUBE_TOPIC].markers
    assert stamp(tube.header) == TIME and (tube.type, tube.action) == (CUBE_LIST, ADD)
    assert (tube.scale.x, tube.scale.y) == (0.2, 0.4)
    np.testing.assert_array_equal([[p.x, p.y] for p in tube.points], plan.nominal[:, :2])
    assert xy_yaw(tube.pose) == [0, 0, 0] and tube.pose.orientation.w == 1
    assert 0 < tube.color.a < 1


def test_boxes_without_a_tube_have_some_extent(messages):
    plan = PlanView(np.zeros((2, 3)), np.zeros((2, 3)), np.zeros(3))
    (tube,) = decoded(messages, plan)[ros2.TUBE_TOPIC].markers
    assert min(tube.scale.x, tube.scale.y, tube.scale.z) > 0


def test_each_topic_is_of_some_message(messages):
    topics = [topic for message in MESSAGES.values() for topic in decoded(messages, message)]
    assert sorted(topics) == sorted(messages.topics)


@given(
    st.lists(st.floats(), min_size=6, max_size=6),
    st.integers(-(2**63), 2**63 - 1),
)
def test_any_odometry_can_be_recorded(values, stamp):
    """It is recorded before the guard has judged it."""
    message = Odometry(stamp, np.array(values[:3]), np.array(values[3:]))
    (odometry,) = decoded(ANY, message).values()
    np.testing.assert_array_equal(odometry.pose.pose.position.x, values[0])


ANY = Ros2Messages()


def test_wheel_commands_are_finite(messages):
    with pytest.raises(ValueError, match="NaN"):
        messages.encode(WheelCommand(np.full(4, np.nan)), TIME)


def test_wrong_motor_type():
    with pytest.raises(ValueError, match=r"^motor_type: "):
        Ros2Messages(motor_type="Int64")


def test_rosbags_is_not_installed(monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(UserError, match=r"rosbags: pip install mirte-drake\[bags\]"):
        Ros2Messages()
