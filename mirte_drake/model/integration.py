"""Integration over a sample with the input held: classical Runge-Kutta and its Jacobians."""

from collections.abc import Callable

import numpy as np

Derivative = Callable[[np.ndarray], np.ndarray]
Linearisation = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]


def rk4_step(derivative: Derivative, x: np.ndarray, dt: float | np.ndarray) -> np.ndarray:
    """Returns the state after ``dt`` [s].

    Args:
        derivative: Maps a state (..., n) to its time derivative, the input being held.
        x: (..., n) state at the start.
        dt: Step [s]; an array (..., 1) for a step of each batch entry.
    """
    k1 = derivative(x)
    k2 = derivative(x + 0.5 * dt * k1)
    k3 = derivative(x + 0.5 * dt * k2)
    k4 = derivative(x + dt * k3)
    return x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def rk4_step_jacobians(
    linearisation: Linearisation, x: np.ndarray, dt: float
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the exact Jacobians of ``rk4_step`` by the state and by the held input.

    Args:
        linearisation: Maps a state (..., n) to (f, df/dx, df/du), of shapes (..., n),
            (..., n, n), (..., n, m).
        x: (..., n) state at the start.
        dt: Step [s].

    Returns:
        (..., n, n) and (..., n, m).
    """
    identity = np.eye(x.shape[-1])
    k, A, B = linearisation(x)
    sum_x, sum_u = A, B
    k_x, k_u = A, B
    for fraction, weight in ((0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
        k, A, B = linearisation(x + fraction * dt * k)
        k_u = B + fraction * dt * A @ k_u
        k_x = A @ (identity + fraction * dt * k_x)
        sum_x, sum_u = sum_x + weight * k_x, sum_u + weight * k_u
    return identity + dt / 6 * sum_x, dt / 6 * sum_u
