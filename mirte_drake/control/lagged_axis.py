"""One axis of a robot whose velocity follows its command with a lag, as a linear system.

Forward, sideways and turning are alike in the body frame: with the body velocity r that is asked
for as input, held over a sample, position p and velocity v of an axis follow exactly

    p+ = p + c v + (T_s - c) r,   v+ = a v + (1 - a) r,   a = exp(-T_s / lag),  c = lag (1 - a).

What is left out is that the frame turns: the robot's own turn within a sample.
"""

import numpy as np

from mirte_drake.control.dlqr import solve_dlqr


def axis_model(lag: float, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns A (2, 2) and B (2, 1) of position and velocity, by the velocity asked for.

    Args:
        lag: [s]
        period: [s] T_s.
    """
    decay = np.exp(-period / lag)
    covered = lag * (1.0 - decay)  # [s] By an initial velocity that dies away.
    A = np.array([[1.0, covered], [0.0, decay]])
    return A, np.array([[period - covered], [1.0 - decay]])


def feedback_gains(
    lag: np.ndarray,
    period: float,
    position_weight: np.ndarray,
    velocity_weight: np.ndarray,
    command_weight: np.ndarray,
) -> np.ndarray:
    """Returns the gains K (axes, 2) [1/s, -] of the LQR of each axis: r = -K (p, v).

    Args:
        lag: (axes,) [s]
        period: [s] T_s.
        position_weight: (axes,) on the squared position error.
        velocity_weight: (axes,) on the squared velocity error.
        command_weight: (axes,) on the squared velocity asked for.

    Raises:
        ValueError: when a weight is not positive.
    """
    gains = [
        solve_dlqr(*axis_model(tau, period), np.diag([q_p, q_v]), np.array([[r]]))[0][0]
        for tau, q_p, q_v, r in zip(
            lag, position_weight, velocity_weight, command_weight, strict=True
        )
    ]
    return np.array(gains)


def observer_model(lag: float, period: float) -> np.ndarray:
    """Returns A (3, 3) of position, velocity and a bias of the velocity asked for."""
    A, B = axis_model(lag, period)
    return np.block([[A, B], [np.zeros((1, 2)), np.eye(1)]])


def observer_gains(
    lag: np.ndarray,
    period: float,
    measurement_noise: np.ndarray,
    process_noise: np.ndarray,
) -> np.ndarray:
    """Returns the steady-state Kalman gains L (axes, 3) of position, velocity and bias.

    The estimate after a measurement y of the position is x + L (y - p), with x the prediction.

    Args:
        lag: (axes,) [s]
        period: [s] T_s.
        measurement_noise: (axes,) standard deviation of a measured position.
        process_noise: (axes, 3) standard deviation, per sample, of position, velocity and bias.

    Raises:
        ValueError: when a standard deviation is zero.
    """
    gains = []
    measured = np.array([[1.0, 0.0, 0.0]])
    for tau, noise, drive in zip(lag, measurement_noise, process_noise, strict=True):
        A = observer_model(tau, period)
        # The filter is the regulator of the transposed system: K' = P A' C' (...)^-1 = (A L)'.
        K, _ = solve_dlqr(A.T, measured.T, np.diag(drive**2), np.array([[noise**2]]))
        gains.append(np.linalg.solve(A, K[0]))
    return np.array(gains)
