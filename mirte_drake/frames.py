"""The frame of the path in that of the odometry, which begins wherever the robot was switched on.

A frame is the pose (3,) of its origin [m, m, rad]. Yaw is neither wrapped nor unwrapped.
"""

import numpy as np

from mirte_drake.angles import rotation
from mirte_drake.vectors import YAW


def path_frame(odometry_pose: np.ndarray, path_pose: np.ndarray) -> np.ndarray:
    """Returns the path's frame in the odometry's, in which both poses (3,) are the same place.

    Args:
        odometry_pose: (3,) [m, m, rad] of the robot at the start of a drive, odometry frame.
        path_pose: (3,) [m, m, rad] the path's start, path frame.
    """
    yaw = odometry_pose[YAW] - path_pose[YAW]
    return odometry_pose - rotation(yaw) @ path_pose


def to_odometry_frame(poses: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Returns poses (..., 3) of the path's frame in the odometry's."""
    return frame + poses @ rotation(frame[YAW]).T


def to_path_frame(poses: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Returns poses (..., 3) of the odometry's frame in the path's."""
    return (poses - frame) @ rotation(frame[YAW])
