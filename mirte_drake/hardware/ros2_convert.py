"""Our messages to and from ROS 2's: yaw to quaternion, arrays to fields, and what onlookers see."""

import dataclasses as dc

import numpy as np

from mirte_drake.angles import quaternion_yaw, yaw_quaternion
from mirte_drake.hardware import messages
from mirte_drake.hardware import ros2_types as ros
from mirte_drake.hardware import ros2_visual_types as visual
from mirte_drake.vectors import YAW

BASE_FRAME = "base_link"
CUBE_LIST = 6  # Marker.CUBE_LIST: the same box at many points.
TUBE_COLOR = (0.1, 0.4, 0.9, 0.15)  # Red, green, blue, opacity.
SMALLEST_SIDE = 0.005  # [m] Of a box: viewers refuse flat ones.


def pose_to_ros(pose: np.ndarray) -> ros.Pose:
    """Returns the geometry_msgs/Pose of a pose (3,) [m, m, rad]."""
    x, y, yaw = (float(value) for value in pose)
    return ros.Pose(ros.Point(x, y, 0.0), ros.Quaternion(*yaw_quaternion(yaw)))


def pose_from_ros(pose: ros.Pose) -> np.ndarray:
    """Returns the pose (3,) [m, m, rad], yaw wrapped; nan of a quaternion without length."""
    p, q = pose.position, pose.orientation
    return np.array([p.x, p.y, quaternion_yaw(q.x, q.y, q.z, q.w)])


def odometry_to_ros(message: messages.Odometry) -> ros.Odometry:
    """Returns the nav_msgs/Odometry, covariances zero, of a stamp [ns] within 32 bits of seconds.

    The frames are odom and base_link, as the robot's.
    """
    seconds, nanoseconds = divmod(message.stamp, 1_000_000_000)
    vx, vy, yaw_rate = (float(value) for value in message.body_velocity)
    twist = ros.Twist(ros.Vector3(vx, vy, 0.0), ros.Vector3(0.0, 0.0, yaw_rate))
    return ros.Odometry(
        ros.Header(ros.Time(seconds, nanoseconds)),
        BASE_FRAME,
        ros.PoseWithCovariance(pose_to_ros(message.pose)),
        ros.TwistWithCovariance(twist),
    )


def odometry_from_ros(sample: ros.Odometry, arrival: float) -> messages.Odometry:
    """Returns what the robot said, unchecked; ``arrival`` [s] is when."""
    stamp, twist = sample.header.stamp, sample.twist.twist
    return messages.Odometry(
        stamp.sec * 1_000_000_000 + stamp.nanosec,
        pose_from_ros(sample.pose.pose),
        np.array([twist.linear.x, twist.linear.y, twist.angular.z]),
        arrival,
    )


def drive_command_to_ros(message: messages.DriveCommand) -> ros.DriveCommand:
    """Returns our DriveCommand as it is sent."""
    return ros.DriveCommand(**_fields(message))


def drive_command_from_ros(sample: ros.DriveCommand, arrival: float) -> messages.DriveCommand:
    """Returns our DriveCommand; ``arrival`` [s] is when it was received."""
    return messages.DriveCommand(**_values(sample), arrival=arrival)


def guard_status_to_ros(message: messages.GuardStatus) -> ros.GuardStatus:
    """Returns our GuardStatus as it is sent."""
    return ros.GuardStatus(**_fields(message))


def guard_status_from_ros(sample: ros.GuardStatus, arrival: float) -> messages.GuardStatus:
    """Returns our GuardStatus; ``arrival`` [s] is when it was received."""
    return messages.GuardStatus(**_values(sample), arrival=arrival)


def operator_request_to_ros(message: messages.OperatorRequest) -> ros.OperatorRequest:
    """Returns our OperatorRequest as it is sent."""
    return ros.OperatorRequest(int(message.request))


def operator_request_from_ros(sample: ros.OperatorRequest, _: float) -> messages.OperatorRequest:
    """Returns our OperatorRequest.

    Raises:
        ValueError: when there is no such request.
    """
    return messages.OperatorRequest(messages.Request(sample.request))


def pose_stamped(pose: np.ndarray) -> ros.PoseStamped:
    """Returns a pose (3,) [m, m, rad] in the odometry frame."""
    return ros.PoseStamped(ros.Header(), pose_to_ros(pose))


def path(poses: np.ndarray) -> visual.Path:
    """Returns poses (n, 3) [m, m, rad] in the odometry frame."""
    return visual.Path(ros.Header(), [pose_stamped(pose) for pose in poses])


def tube_markers(view: messages.PlanView) -> visual.MarkerArray:
    """Returns the tube: a translucent box +-d_k, along the axes of the world, at each planned pose.

    Deviation: the published program shows no tube.
    """
    width, depth = (max(2 * float(half), SMALLEST_SIDE) for half in view.half_width[:YAW])
    points = [ros.Point(float(x), float(y), 0.0) for x, y, _ in view.nominal]
    marker = visual.Marker(
        ns="tube",
        type=CUBE_LIST,
        scale=ros.Vector3(width, depth, SMALLEST_SIDE),
        color=visual.ColorRGBA(*TUBE_COLOR),
        points=points,
    )
    return visual.MarkerArray([marker])


def _fields(message: messages.DriveCommand | messages.GuardStatus) -> dict:
    """Fields that are sent, arrays as lists of floats."""
    values = {f.name: getattr(message, f.name) for f in dc.fields(message) if f.name != "arrival"}
    return {
        name: [float(entry) for entry in value] if isinstance(value, np.ndarray) else value
        for name, value in values.items()
    }


def _values(sample: ros.DriveCommand | ros.GuardStatus) -> dict:
    """Fields that were received, lists as arrays."""
    values = {f.name: getattr(sample, f.name) for f in dc.fields(sample)}
    return {n: np.array(v) if isinstance(v, list) else v for n, v in values.items()}
