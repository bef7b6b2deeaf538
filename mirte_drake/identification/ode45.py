"""Emulation of MATLAB's ode45, for comparison with results that were computed with it.

Dormand and Prince's 5(4) pair with local extrapolation, the step-size controller and the free
4th-order interpolant of Shampine and Reichelt, "The MATLAB ODE Suite", SIAM J. Sci. Comput. 18
(1997), section 4. At its default tolerances a step may be as long as a tenth of the whole
interval, so it passes over switches of the input that it never evaluates: to reproduce that, the
controller must decide as MATLAB's does, and a general RK45 of the same order will not do.
"""

import dataclasses as dc
from collections.abc import Callable

import numpy as np

# Stage times, stage weights (the last row is the 5th-order solution), and the difference between
# the solutions of 5th and 4th order: Dormand and Prince, J. Comput. Appl. Math. 6 (1980).
_NODES = np.array([1 / 5, 3 / 10, 4 / 5, 8 / 9, 1, 1])
_WEIGHTS = np.array(
    [
        [1 / 5, 0, 0, 0, 0, 0],
        [3 / 40, 9 / 40, 0, 0, 0, 0],
        [44 / 45, -56 / 15, 32 / 9, 0, 0, 0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0, 0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0],
        [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
_ERROR = np.array([71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
# Interpolant: row i holds the coefficients of s, s^2, s^3, s^4 that weigh stage i (ntrp45).
_INTERPOLANT = np.array(
    [
        [1, -183 / 64, 37 / 12, -145 / 128],
        [0, 0, 0, 0],
        [0, 1500 / 371, -1000 / 159, 1000 / 371],
        [0, -125 / 32, 125 / 12, -375 / 64],
        [0, 9477 / 3392, -729 / 106, 25515 / 6784],
        [0, -11 / 7, 11 / 3, -55 / 28],
        [0, 3 / 2, -4, 5 / 2],
    ]
)
_POWER = 1 / 5


@dc.dataclass(frozen=True)
class Ode45Solution:
    """States at the requested times, and the steps that led there."""

    states: np.ndarray  # (M, n) at the requested times.
    step_times: np.ndarray  # (accepted steps + 1,) [s] ends of the solver's own steps.
    failed_steps: int  # Steps tried and rejected.


def ode45(
    derivative: Callable[[float, np.ndarray], np.ndarray],
    times: np.ndarray,
    initial_state: np.ndarray,
    *,
    relative_tolerance: float = 1e-3,
    absolute_tolerance: float = 1e-6,
) -> Ode45Solution:
    """Integrates xdot = derivative(t, x) as MATLAB's ode45 does with default options.

    Deviation: a step whose error estimate is not finite is rejected; MATLAB accepts it.

    Args:
        derivative: Maps time [s] and state (n,) to the time derivative (n,).
        times: (M,) [s] strictly increasing; the first is the initial time. As in MATLAB, the
            first interval bounds the first step, and a tenth of the whole bounds every step.
        initial_state: (n,) state at ``times[0]``.
        relative_tolerance: RelTol.
        absolute_tolerance: AbsTol.

    Returns:
        The states at ``times``, interpolated within the solver's steps.

    Raises:
        ValueError: when ``times`` has fewer than two entries or does not increase.
        ArithmeticError: when the tolerance would need a step below 16 units of round-off.
    """
    if len(times) < 2 or not np.all(np.diff(times) > 0):
        raise ValueError("times: must be at least two, strictly increasing")
    threshold = absolute_tolerance / relative_tolerance
    t, end = float(times[0]), float(times[-1])
    y = np.array(initial_state, dtype=float)
    states = np.empty((len(times), len(y)))
    states[0] = y
    stages = np.zeros((7, len(y)))
    stages[0] = derivative(t, y)
    max_step = 0.1 * (end - t)
    step = min(max_step, float(times[1]) - t)
    rate = _max_norm(stages[0] / np.maximum(np.abs(y), threshold)) / (
        0.8 * relative_tolerance**_POWER
    )
    if step * rate > 1:
        step = 1 / rate
    step_times, failed_steps, row = [t], 0, 1
    while t < end:
        min_step = 16 * float(np.spacing(abs(t)))
        step = min(max_step, max(min_step, step))
        last = 1.1 * step >= end - t  # Stretches the step to the end where that is near.
        if last:
            step = end - t
        failed = False
        while True:
            t_new = end if last else t + step
            for i in range(6):
                y_new = y + step * (_WEIGHTS[i, : i + 1] @ stages[: i + 1])
                stages[i + 1] = derivative(t_new if i == 5 else t + step * _NODES[i], y_new)
            scale = np.maximum(np.maximum(np.abs(y), np.abs(y_new)), threshold)
            error = step * _max_norm(_ERROR @ stages / scale)
            if error <= relative_tolerance:
                break
            if step <= min_step:
                raise ArithmeticError(f"ode45: tolerance not met at t = {t:g} s")
            factor = max(0.1, 0.8 * (relative_tolerance / error) ** _POWER)
            step = max(min_step, step * (0.5 if failed else factor))
            failed, last, failed_steps = True, False, failed_steps + 1
        while row < len(times) and times[row] <= t_new:
            powers = ((times[row] - t) / (t_new - t)) ** np.arange(1, 5)
            inside = y + (t_new - t) * (_INTERPOLANT @ powers) @ stages
            states[row] = y_new if times[row] == t_new else inside
            row += 1
        if not failed:
            step /= max(0.2, 1.25 * (error / relative_tolerance) ** _POWER)
        t, y = t_new, y_new
        stages[0] = stages[6]
        step_times.append(t)
    return Ode45Solution(states, np.array(step_times), failed_steps)


def _max_norm(values: np.ndarray) -> float:
    return float(np.max(np.abs(values)))
