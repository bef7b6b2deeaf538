"""Pose, body velocity and velocity bias from a measured pose and the commands sent.

The state is that of a LaggedModel; the bias is what must be added to the velocity that the model
settles at, slowly changing: what the model does not know of wheels, floor and load.

The measured velocity of an odometry is the increment of its pose: it tells nothing that two poses
do not, and its error is that of both of them. So the observer is of the pose alone.
"""

import numpy as np

from mirte_drake.angles import pose_error, rotation
from mirte_drake.model.lagged_model import BODY_VELOCITY, LaggedModel
from mirte_drake.vectors import POSE, YAW


def correct(
    state: np.ndarray, bias: np.ndarray, pose: np.ndarray, gains: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns state (6,) and bias (3,) after a measured pose.

    Args:
        state: (6,) predicted.
        bias: (3,) [m/s, m/s, rad/s] predicted.
        pose: (3,) measured [m, m, rad]; any turn of the yaw.
        gains: (3, 3) per axis of the body frame: of position, velocity and bias.
    """
    turn = rotation(state[YAW])
    innovation = turn.T @ pose_error(pose, state[POSE])
    corrected = state.copy()
    corrected[POSE] += turn @ (gains[:, 0] * innovation)
    corrected[BODY_VELOCITY] += gains[:, 1] * innovation
    return corrected, bias + gains[:, 2] * innovation


def predict(
    model: LaggedModel, state: np.ndarray, bias: np.ndarray, command: np.ndarray, period: float
) -> np.ndarray:
    """Returns the state (6,) after a sample [s] with effective commands (4,) [pwm] held.

    Args:
        model: The model in effective commands, see ``LaggedModel.effective``.
        state: (6,)
        bias: (3,) [m/s, m/s, rad/s] constant over the sample.
        command: (4,) [pwm]
        period: [s]
    """
    # F is linear: some command more gives the bias.
    more = np.linalg.pinv(model.steady_velocity_jacobian(np.zeros(model.num_inputs))) @ bias
    return model.step(state, command + more, period)
