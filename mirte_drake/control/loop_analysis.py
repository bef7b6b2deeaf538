"""Linear closed loops of a robot whose velocity lags and whose commands come late.

The plant is three axes of ``lagged_axis``, at yaw zero, with a delay of any length from command to
robot. What a law asks for is the velocity r that the axes settle at; a loop is the matrix that
takes everything the loop remembers from one sample to the next. Its spectral radius tells by which
factor an error shrinks per sample in the long run.
"""

from collections.abc import Callable

import numpy as np

from mirte_drake.control.lagged_axis import axis_model, observer_model
from mirte_drake.vectors import POSE_SIZE

LARGEST_DELAY = 2.0  # [s] Beyond which no margin is looked for.
RESOLUTION = 1e-4  # [s] Of a margin.


def spectral_radius(loop: np.ndarray) -> float:
    """Returns the largest modulus of a loop's eigenvalues."""
    return float(np.max(np.abs(np.linalg.eigvals(loop))))


def delay_margin(loop_of_delay: Callable[[float], np.ndarray], step: float = 0.01) -> float:
    """Returns the delay [s] up to which a loop is stable; infinite beyond ``LARGEST_DELAY``.

    Args:
        loop_of_delay: Returns the loop with a delay [s] that the law knows nothing of.
        step: [s] Of the search for the first delay without stability.
    """
    stable, delay = 0.0, 0.0
    while spectral_radius(loop_of_delay(delay)) < 1.0:
        stable, delay = delay, delay + step
        if delay > LARGEST_DELAY:
            return np.inf
    while delay - stable > RESOLUTION:
        middle = 0.5 * (stable + delay)
        if spectral_radius(loop_of_delay(middle)) < 1.0:
            stable = middle
        else:
            delay = middle
    return stable


def late_axis_model(
    lag: float, period: float, fraction: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns A (2, 2), and the effect (2,) of the command of before and that of now.

    Args:
        lag: [s]
        period: [s] T_s.
        fraction: Of the sample, in [0, 1), after which the command of now acts.
    """
    A, _ = axis_model(lag, period)
    rest, now = axis_model(lag, (1.0 - fraction) * period)
    if fraction == 0.0:
        return A, np.zeros(2), now[:, 0]
    _, before = axis_model(lag, fraction * period)
    return A, rest @ before[:, 0], now[:, 0]


def pose_feedback_loop(
    gain: np.ndarray, lag: np.ndarray, period: float, delay: float
) -> np.ndarray:
    """Returns the loop of r = -gain e, with e the error of the pose: the published law.

    Args:
        gain: (3, 3) [1/s] Of the law u = -K e, the velocities dF/du K that its inputs give.
        lag: (3,) [s]
        period: [s] T_s.
        delay: [s]
    """
    late = _samples_late(delay, period)
    n = 2 * POSE_SIZE
    memory = np.eye(n + POSE_SIZE * late)
    state = memory[:n].reshape(POSE_SIZE, 2, -1)
    past = memory[n:].reshape(late, POSE_SIZE, len(memory))
    commands = [-gain @ state[:, 0], *past]
    following = _advance(state, commands, lag, period, delay)
    return np.vstack([following.reshape(n, -1), *commands[:late]])


def observer_loop(
    feedback: np.ndarray,
    observer: np.ndarray,
    lag: float,
    period: float,
    delay: float,
    *,
    known_delay: int = 0,
    plant_lag: float | None = None,
    plant_gain: float = 1.0,
) -> np.ndarray:
    """Returns the loop of one axis of ours: observer, prediction over the delay, feedback.

    Args:
        feedback: (2,) K, see ``feedback_gains``.
        observer: (3,) L, see ``observer_gains``.
        lag: [s] that the law is designed for.
        period: [s] T_s.
        delay: [s] of the robot.
        known_delay: [samples] that the law is designed for.
        plant_lag: [s] of the robot, if another one.
        plant_gain: Velocity that the robot settles at, of that asked for.
    """
    late = max(_samples_late(delay, period), known_delay)
    memory = np.eye(5 + late)
    state, estimate, past = memory[:2], memory[2:5], list(memory[5:])
    A, B = observer_model(lag, period), np.append(axis_model(lag, period)[1], 0.0)
    corrected = estimate + np.outer(observer, state[0] - estimate[0])
    ahead = corrected
    for command in reversed(past[:known_delay]):
        ahead = A @ ahead + np.outer(B, command)
    commands = [-feedback @ ahead[:2] - ahead[2], *past]
    acting = [plant_gain * command[None, :] for command in commands]
    lags = np.array([lag if plant_lag is None else plant_lag])
    (following,) = _advance(state[None], acting, lags, period, delay)
    estimate = A @ corrected + np.outer(B, commands[known_delay])
    return np.vstack([following, estimate, *commands[:late]])


def _samples_late(delay: float, period: float) -> int:
    """Returns how many past commands act in a sample or later."""
    return int(np.ceil(round(delay / period, 9)))


def _advance(
    state: np.ndarray, commands: list[np.ndarray], lag: np.ndarray, period: float, delay: float
) -> np.ndarray:
    """Returns rows (axes, 2, size) of position and velocity a sample later.

    Args:
        state: (axes, 2, size)
        commands: (axes, size) each, the one of now first.
        lag: (axes,) [s]
        period: [s]
        delay: [s]
    """
    whole, fraction = divmod(round(delay / period, 9), 1.0)
    now = commands[int(whole)]
    before = commands[int(whole) + 1] if fraction else now
    rows = []
    for axis, tau in enumerate(lag):
        A, by_before, by_now = late_axis_model(tau, period, fraction)
        row = A @ state[axis] + np.outer(by_before, before[axis])
        rows.append(row + np.outer(by_now, now[axis]))
    return np.array(rows)
