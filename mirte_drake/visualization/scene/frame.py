"""What moves in the scene, as data."""

import dataclasses as dc

import numpy as np


@dc.dataclass(frozen=True)
class Frame:
    """What is seen at one instant; poses are in the world frame."""

    pose: np.ndarray  # (3,) [m, m, rad] as measured.
    true_pose: np.ndarray  # (3,) [m, m, rad] where the robot is.
    reference: np.ndarray  # (3,) [m, m, rad]
    plan: np.ndarray  # (N + 1, 3) [m, m, rad] nominal poses, now and over the horizon.
    half_widths: np.ndarray  # (N + 1, 3) [m, m, rad] of the tube around them; zeros: no tube.
    disturbance: np.ndarray  # (3,) [m/s, m/s, rad/s], body frame.
    wheel_command: np.ndarray  # (4,) [pwm]
    wheel_angles: np.ndarray  # (4,) [rad] turned since the start.


@dc.dataclass(frozen=True)
class Trail:
    """What stays of m samples: where the robot went, and the tube that it was to stay in."""

    poses: np.ndarray  # (m + 1, 3) [m, m, rad] as measured.
    true_poses: np.ndarray  # (m + 1, 3) [m, m, rad]
    # Of each sample, before and after: boxes around the nominal pose and around its successor.
    nominal: np.ndarray  # (m, 2, 3) [m, m, rad]
    half_widths: np.ndarray  # (m, 2, 3) [m, m, rad]; zeros: no tube.
