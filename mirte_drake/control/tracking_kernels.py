"""The loops of the optimal control problem, compiled by numba, on plain float arrays.

Shapes as in ``tracking_problem``: states (N + 1, n), jacobians (N, n, n + m) of each step by
state and input, inputs (N, m), reference (N, 3) for x_1, ..., x_N.
"""

import numpy as np

from mirte_drake.compiled import compiled


@compiled
def cost_and_gradient(
    states: np.ndarray,
    jacobians: np.ndarray,
    inputs: np.ndarray,
    reference: np.ndarray,
    previous_input: np.ndarray,
    Q: np.ndarray,
    R: np.ndarray,
    Rd: np.ndarray,
    P: np.ndarray,
) -> tuple[float, np.ndarray]:
    """Returns the cost (4-9) and its gradient (n + N m,), by one backward (adjoint) sweep.

    Without jacobians (N = 0 of them) the gradient is zero.
    """
    N, m = inputs.shape
    n = states.shape[1]
    value, gradient = 0.0, np.zeros(n + N * m)
    adjoint, carried, weighted_move = np.zeros(n), np.empty(n), np.zeros(m)
    for i in range(N - 1, -1, -1):
        for p in range(3):
            weighted = 0.0
            for q in range(3):
                weight = Q[p, q] + P[p, q] if i == N - 1 else Q[p, q]
                weighted += weight * (states[i + 1, q] - reference[i, q])
            value += weighted * (states[i + 1, p] - reference[i, p])
            adjoint[p] += 2.0 * weighted
        last = inputs[i - 1] if i > 0 else previous_input
        for p in range(m):
            weighted, after = 0.0, weighted_move[p]
            weighted_move[p] = 0.0
            for q in range(m):
                weighted += R[p, q] * inputs[i, q]
                weighted_move[p] += Rd[p, q] * (inputs[i, q] - last[q])
            value += weighted * inputs[i, p] + weighted_move[p] * (inputs[i, p] - last[p])
            gradient[n + i * m + p] = 2.0 * (weighted + weighted_move[p] - after)
        if len(jacobians) == 0:
            continue
        for c in range(n + m):
            total = 0.0
            for r in range(n):
                total += jacobians[i, r, c] * adjoint[r]
            if c < n:
                carried[c] = total
            else:
                gradient[i * m + c] += total
        adjoint[:] = carried
    gradient[:n] = adjoint
    return value, gradient


@compiled
def condense(
    jacobians: np.ndarray, Q: np.ndarray, R: np.ndarray, Rd: np.ndarray, P: np.ndarray
) -> np.ndarray:
    """Returns the Gauss-Newton Hessian (n + N m, n + N m) of the cost.

    One forward and one backward sweep per block column, so O(N^2) (Andersson 2013; Frison 2015).
    """
    N, n, width = jacobians.shape
    m = width - n
    size = n + N * m
    H = np.zeros((size, size))
    weight, last_weight = 2.0 * Q, 2.0 * (Q + P)
    sensitivity, adjoint, carried = np.empty((N + 1, n, width)), np.empty((n, width)), np.empty(n)
    for j in range(-1, N):  # Columns of x0 (-1), then of u_j.
        columns, first, begin = (n, 0, 0) if j < 0 else (m, n + j * m, j)
        for r in range(n):
            for c in range(columns):
                sensitivity[begin + 1, r, c] = jacobians[begin, r, c if j < 0 else n + c]
                adjoint[r, c] = 0.0
        for i in range(begin + 1, N):
            for r in range(n):
                for c in range(columns):
                    total = 0.0
                    for q in range(n):
                        total += jacobians[i, r, q] * sensitivity[i, q, c]
                    sensitivity[i + 1, r, c] = total
        for i in range(N - 1, begin - 1, -1):
            W = last_weight if i == N - 1 else weight
            for c in range(columns):
                for p in range(3):
                    for q in range(3):
                        adjoint[p, c] += W[p, q] * sensitivity[i + 1, q, c]
                for r in range(m):
                    total = 0.0
                    for q in range(n):
                        total += jacobians[i, q, n + r] * adjoint[q, c]
                    H[n + i * m + r, first + c] = total
                for r in range(n):
                    total = 0.0
                    for q in range(n):
                        total += jacobians[i, q, r] * adjoint[q, c]
                    carried[r] = total
                for r in range(n):
                    adjoint[r, c] = carried[r]
        if j < 0:
            H[:n, :n] = adjoint[:, :n]
    for i in range(N):
        for p in range(m):
            for q in range(m):
                row, column = n + i * m + p, n + i * m + q
                both = Rd[p, q] if i < N - 1 else 0.0
                H[row, column] += 2.0 * (R[p, q] + Rd[p, q] + both)
                if i < N - 1:
                    H[row + m, column] -= 2.0 * Rd[p, q]
    for r in range(size):
        for c in range(r):
            H[c, r] = H[r, c]
    return H


@compiled
def stage_references(window: np.ndarray, yaw: float, first: int, horizon: int) -> np.ndarray:
    """Returns rows ``first`` to ``first`` + N of a window of poses, its yaw unwrapped near yaw."""
    result, turn = window[first : first + horizon].copy(), 2.0 * np.pi
    continued = near = yaw
    for i in range(first + horizon):
        continued = window[i, 2] + turn * np.round((near - window[i, 2]) / turn)
        near = continued
        if i >= first:
            result[i - first, 2] = continued
    return result


@compiled
def input_limits(
    lower: np.ndarray, upper: np.ndarray, rate_limit: np.ndarray, previous_input: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the inputs from which all later bounds can be met, and the rates that this takes.

    Each wheel is a chain of intervals. Forward: what can be reached from the last input; where that
    misses the next bounds, the rate of that move is raised to the distance between the two, so
    that a rate gives way as late and as little as possible. Backward: what leads on.

    Args:
        lower: (N, m) [pwm], nowhere above ``upper``.
        upper: (N, m) [pwm]
        rate_limit: (m,) [pwm_per_sample]
        previous_input: (m,) [pwm]

    Returns:
        (N, m), (N, m) [pwm], and the rates (N, m) [pwm_per_sample] of u_i - u_{i-1}.
    """
    lowest, highest, rates = lower.copy(), upper.copy(), np.empty(lower.shape)
    N, m = lower.shape
    for p in range(m):
        low = high = previous_input[p]
        for i in range(N):
            rates[i, p] = rate = max(rate_limit[p], lower[i, p] - high, low - upper[i, p])
            low, high = (
                min(max(lower[i, p], low - rate), upper[i, p]),
                max(min(upper[i, p], high + rate), lower[i, p]),
            )
        for i in range(N - 1, 0, -1):
            lowest[i - 1, p] = min(
                max(lower[i - 1, p], lowest[i, p] - rates[i, p]), upper[i - 1, p]
            )
            highest[i - 1, p] = max(
                min(upper[i - 1, p], highest[i, p] + rates[i, p]), lower[i - 1, p]
            )
    return lowest, highest, rates


@compiled
def project(
    inputs: np.ndarray,
    previous_input: np.ndarray,
    lowest: np.ndarray,
    highest: np.ndarray,
    rates: np.ndarray,
) -> np.ndarray:
    """Returns inputs (N, m) moved, stage by stage, into ``input_limits``."""
    result, last = inputs.copy(), previous_input
    for i in range(len(inputs)):
        for p in range(inputs.shape[1]):
            low = max(lowest[i, p], min(last[p] - rates[i, p], highest[i, p]))
            high = min(highest[i, p], max(last[p] + rates[i, p], lowest[i, p]))
            result[i, p] = max(low, min(inputs[i, p], high))
        last = result[i]
    return result


@compiled
def constraint_bounds(
    state: np.ndarray,
    half_width: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    previous_input: np.ndarray,
    rates: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the bounds (n + 2 N m,) on [z; u_0; u_1 - u_0; ...; u_{N-1} - u_{N-2}]."""
    n, (N, m) = len(state), lower.shape
    least, most = np.empty(n + 2 * N * m), np.empty(n + 2 * N * m)
    least[:n], most[:n] = state - half_width, state + half_width
    for i in range(N):
        for p in range(m):
            k, last = n + i * m + p, previous_input[p] if i == 0 else 0.0
            least[k], most[k] = lower[i, p], upper[i, p]
            least[k + N * m], most[k + N * m] = last - rates[i, p], last + rates[i, p]
    return least, most


@compiled
def all_finite(array: np.ndarray) -> bool:
    """Tells whether an array holds finite numbers only."""
    for value in array.flat:
        if not np.isfinite(value):
            return False
    return True


@compiled
def pose(
    state: np.ndarray,
    window: np.ndarray,
    half_width: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    previous_input: np.ndarray,
    rate_limit: np.ndarray,
    n: int,
    N: int,
    first: int,
) -> tuple:
    """Returns everything that a sample's data say before a decision vector is known.

    First whether there is a problem: shapes that fit n states and N stages, finite numbers, no
    negative half-width, no crossing bounds. Then the references, ``input_limits``, whether a rate
    was raised, and ``constraint_bounds``.
    """
    m = len(rate_limit)
    if not (
        state.shape == half_width.shape == (n,)
        and window.shape == (N + 1, 3)
        and lower.shape == upper.shape == (N, m)
        and previous_input.shape == (m,)
    ):
        nothing, none = np.empty((0, m)), np.empty(0)
        return False, nothing, nothing, nothing, nothing, False, none, none
    sound = all_finite(state) and all_finite(window) and all_finite(half_width)
    sound = sound and all_finite(lower) and all_finite(upper) and all_finite(previous_input)
    sound = sound and bool(np.all(half_width >= 0.0)) and bool(np.all(lower <= upper))
    references = stage_references(window, state[2], first, len(lower))
    lowest, highest, rates = input_limits(lower, upper, rate_limit, previous_input)
    relaxed = np.any(rates > rate_limit)
    least, most = constraint_bounds(state, half_width, lower, upper, previous_input, rates)
    return sound, references, lowest, highest, rates, relaxed, least, most


@compiled
def project_all(
    z: np.ndarray,
    least: np.ndarray,
    most: np.ndarray,
    previous_input: np.ndarray,
    lowest: np.ndarray,
    highest: np.ndarray,
    rates: np.ndarray,
) -> np.ndarray:
    """Returns the decision vector near z whose initial state and inputs meet every constraint."""
    result, n = z.copy(), len(z) - lowest.size
    for i in range(n):
        result[i] = min(max(z[i], least[i]), most[i])
    inputs = z[n:].reshape(lowest.shape)
    result[n:] = project(inputs, previous_input, lowest, highest, rates).ravel()
    return result


@compiled
def meets_rates(
    z: np.ndarray, least: np.ndarray, most: np.ndarray, m: int, tolerance: float
) -> bool:
    """Tells whether the moves in z, of m inputs a stage, are within ``constraint_bounds``."""
    n = 2 * len(z) - len(least)
    for i in range(n, len(z)):
        move, k = z[i] - (z[i - m] if i >= n + m else 0.0), i + len(z) - n
        if not least[k] - tolerance <= move <= most[k] + tolerance:
            return False
    return True
