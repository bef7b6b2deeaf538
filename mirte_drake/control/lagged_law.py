"""Feedback for a robot whose velocity lags: a velocity to ask for, from errors in its own frame.

In the robot's frame an error of position and one of velocity follow, axis by axis, the linear
system of ``lagged_axis`` by the velocity r that is asked for beside the nominal one, but for the
turn of the frame. So r = -K (position error, velocity error) has the poles that K was designed for.
The wheels are told whatever gives the velocity that the nominal input settles at, plus r.
"""

import numpy as np

from mirte_drake.angles import pose_error, rotation
from mirte_drake.model.lagged_model import BODY_VELOCITY
from mirte_drake.vectors import POSE, YAW


def tracking_error(state: np.ndarray, nominal: np.ndarray) -> np.ndarray:
    """Returns the errors (..., 3, 2) of position and velocity by axis, in the robot's frame.

    The nominal velocity is that of the nominal robot turned into this one's frame: a robot that
    moves as the nominal one does through the world has no velocity error.

    Args:
        state: (..., 6) of a LaggedModel.
        nominal: (..., 6)
    """
    error = pose_error(state[..., POSE], nominal[..., POSE])
    velocity = state[..., BODY_VELOCITY] - _turned(-error[..., YAW], nominal[..., BODY_VELOCITY])
    return np.stack([_turned(-state[..., YAW], error), velocity], axis=-1)


def _turned(yaw: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return np.einsum("...ij,...j->...i", rotation(yaw), vector)


def wanted_velocity(
    error: np.ndarray, nominal_velocity: np.ndarray, bias: np.ndarray, gains: np.ndarray
) -> np.ndarray:
    """Returns the velocity (3,) [m/s, m/s, rad/s] that the wheels shall settle at.

    Args:
        error: (3, 2) of ``tracking_error``.
        nominal_velocity: (3,) that the nominal input settles at, in the nominal robot's frame.
        bias: (3,) of the velocity that the robot settles at.
        gains: (3, 2) K of each axis.
    """
    turned = rotation(-error[YAW, 0]) @ nominal_velocity
    return turned - np.sum(gains * error, axis=1) - bias
