"""Derivatives of noisy samples: total variation regularised (TVR), and smoothed differences.

TVR finds the derivative u whose integral fits the data and whose total variation is small (3-4):

    min_u  1/2 |A u - (x - x_0)|^2 + alpha dt sum_i sqrt((D u)_i^2 + epsilon)

with A the trapezoid rule and D the difference quotient (Chartrand 2011). N data give N + 1 values
of u, the first before the first datum.
"""

import dataclasses as dc
from collections.abc import Callable

import numpy as np
from scipy.linalg import solve_banded
from scipy.signal import savgol_filter

MODES = ("converged", "published")


@dc.dataclass
class TvrConfig:
    """Settings of TVR differentiation; the defaults are the source's."""

    # Weight of the total variation. It stands against a sum over samples, so that the same value
    # smooths less at a higher sample rate.
    alpha: float = 0.01
    epsilon: float = 1e-6  # Rounds off the absolute value.
    tolerance: float = 1e-9  # "converged": gradient norm, relative to that of u = 0.
    max_iterations: int = 200  # "converged": Newton steps.


def tvr_derivative(
    x: np.ndarray, dt: float, mode: str = "converged", config: TvrConfig | None = None
) -> np.ndarray:
    """Returns the TVR derivative of evenly spaced samples, column by column.

    Args:
        x: (N, d) samples.
        dt: [s] sample time.
        mode: "published": lagged diffusivity, 100 iterations with conjugate gradients stopped
            early, on x[0..N-2], so that the values lag the rows by one sample, all as in the
            published programs. "converged": the minimiser, to ``config.tolerance``, aligned with
            the rows.
        config: Settings.

    Returns:
        (N, d) derivative.

    Raises:
        ValueError: for an unknown mode, or where the minimiser is not reached.
    """
    config = config or TvrConfig()
    if mode == "published":
        # The first N - 1 samples, the first of them as the origin: one sample of lag.
        columns = [_published(column[:-1], column[0], dt, config) for column in x.T]
    elif mode == "converged":
        # Deviation: the first sample is the origin alone, so that values and rows belong together.
        columns = [_converged(column[1:], column[0], dt, config) for column in x.T]
    else:
        raise ValueError(f"mode: must be one of {', '.join(MODES)}, got {mode!r}")
    return np.column_stack(columns)


def smoothed_derivative(x: np.ndarray, dt: float, window: int = 7) -> np.ndarray:
    """Returns the derivative (N, d) by a local parabola over ``window`` samples, to compare with.

    Savitzky and Golay's filter; at the ends the parabola of the first or last window.
    """
    return savgol_filter(x, window, polyorder=2, deriv=1, delta=dt, axis=0)


def integrate(u: np.ndarray, dt: float) -> np.ndarray:
    """Returns A u: the integral (N,) of N + 1 values from the first to each later one."""
    return (np.cumsum(u) - 0.5 * (u + u[0]))[1:] * dt


def integrate_adjoint(w: np.ndarray, dt: float) -> np.ndarray:
    """Returns A' w (N + 1,)."""
    total = w.sum()
    sums = np.concatenate([[total / 2], np.cumsum(w) - w / 2])
    return (total * np.ones(len(w) + 1) - sums) * dt


def objective_gradient(u: np.ndarray, data: np.ndarray, dt: float, config: TvrConfig) -> np.ndarray:
    """Returns the gradient (N + 1,) of (3-4), for data (N,) that begin at zero."""
    slope = np.diff(u) / dt
    flux = slope / np.sqrt(slope**2 + config.epsilon)
    variation = -np.diff(np.concatenate([[0.0], flux, [0.0]]))
    return integrate_adjoint(integrate(u, dt) - data, dt) + config.alpha * variation


def _published(
    data: np.ndarray, origin: float, dt: float, config: TvrConfig, iterations: int = 100
) -> np.ndarray:
    """Returns what the published programs return, although it has not converged.

    Which iterate the conjugate gradients stop at depends on rounding. This is the order of
    operations of the published program, without BLAS, whose sums differ between processors.
    """
    u = np.concatenate([[0.0], np.diff(data), [0.0]])
    constant = integrate_adjoint(origin - data, dt)
    quotient = 1 / dt
    for _ in range(iterations):
        weight = 1 / np.sqrt((quotient * np.diff(u)) ** 2 + config.epsilon)
        entries = dt * quotient * weight * quotient
        diagonal = np.concatenate([entries[:1], entries[:-1] + entries[1:], entries[-1:]])
        diffusion = _tridiagonal(config.alpha * diagonal, -config.alpha * entries)
        gradient = integrate_adjoint(integrate(u, dt), dt) + constant + diffusion(u)
        preconditioner = config.alpha * (diagonal + 1)
        step = np.zeros_like(u)
        residual = gradient.copy()
        goal = 1e-4 * np.sqrt((gradient * gradient).sum())
        if goal == 0.0:
            break
        direction, rho = np.zeros_like(u), 1.0
        for _ in range(1000):
            z = residual / preconditioner
            previous, rho = rho, (residual * z).sum()
            direction = z + rho / previous * direction
            image = diffusion(direction) + integrate_adjoint(integrate(direction, dt), dt)
            length = rho / (direction * image).sum()
            step = step + length * direction
            residual = residual - length * image
            if np.sqrt((residual * residual).sum()) <= goal:
                break
        u = u - step
    return u


def _tridiagonal(
    diagonal: np.ndarray, off_diagonal: np.ndarray
) -> Callable[[np.ndarray], np.ndarray]:
    """Returns the product with a symmetric tridiagonal matrix."""

    def product(v: np.ndarray) -> np.ndarray:
        result = diagonal * v
        result[:-1] += off_diagonal * v[1:]
        result[1:] += off_diagonal * v[:-1]
        return result

    return product


def _converged(data: np.ndarray, origin: float, dt: float, config: TvrConfig) -> np.ndarray:
    """Returns the minimiser by the primal-dual Newton method of Chan, Golub and Mulet (1999).

    The dual variable z stands for slope / sqrt(slope^2 + epsilon). Where lagged diffusivity
    creeps, this converges quadratically; each step is one banded solve, O(N).
    """
    data = data - origin
    n = len(data)
    u, z = np.zeros(n + 1), np.zeros(n)
    goal = config.tolerance * np.linalg.norm(objective_gradient(u, data, dt, config))
    for _ in range(config.max_iterations):
        gradient = objective_gradient(u, data, dt, config)
        if np.linalg.norm(gradient) <= goal:
            return u
        slope = np.diff(u) / dt
        norm = np.sqrt(slope**2 + config.epsilon)
        weight = (1 - z * slope / norm) / norm
        step = _solve_normal_equations(config.alpha * weight / dt, -gradient, dt)
        change = weight * np.diff(step) / dt + slope / norm - z
        z = z + _step_length(z, change) * change
        u = u + step
    raise ValueError(
        f"TVR: no minimiser within {config.max_iterations} steps: the gradient is "
        f"{np.linalg.norm(gradient) / goal * config.tolerance:.1e}, not {config.tolerance:.1e}"
    )


def _step_length(z: np.ndarray, change: np.ndarray) -> float:
    """Returns the longest step (at most 1) that keeps |z| < 1."""
    room = np.where(change > 0, 1 - z, 1 + z)
    with np.errstate(divide="ignore", invalid="ignore"):
        return min(1.0, 0.99 * float(np.min(room / np.abs(change), initial=np.inf)))


def _solve_normal_equations(weight: np.ndarray, rhs: np.ndarray, dt: float) -> np.ndarray:
    """Returns s with (A' A + D' diag(weight) D) s = rhs, D the plain difference, in O(N).

    A' A is full. But the integral w = A s adds up cells, w_i - w_{i-1} = (C s)_i, and so does the
    adjoint p, w_i = p_i - p_{i+1}, so that all equations couple neighbours only:

        D' diag(weight) D s + C' p = rhs,   -p_{i-1} + 2 p_i - p_{i+1} = (C s)_i

    Interleaved as s_0, p_1, s_1, p_2, ... the matrix has two diagonals on each side.
    """
    n = len(weight)
    # Row 2 + r - c of the bands holds the entry at row r and column c; even columns are s.
    bands = np.zeros((5, 2 * n + 1))
    bands[2, 0:-2:2] += weight
    bands[2, 2::2] += weight
    bands[0, 2::2] = bands[4, 0:-2:2] = -weight
    bands[1, 1::2] = bands[3, 1::2] = dt / 2  # C' p in the rows of s.
    bands[1, 2::2] = bands[3, 0:-2:2] = -dt / 2  # -C s in the rows of p.
    bands[2, 1::2] = 2.0
    bands[2, 1] = 1.0  # w_0 = 0.
    bands[0, 3::2] = bands[4, 1:-2:2] = -1.0
    right = np.zeros(2 * n + 1)
    right[::2] = rhs
    solution = solve_banded(
        (2, 2), bands, right, overwrite_ab=True, overwrite_b=True, check_finite=False
    )
    return solution[::2]
