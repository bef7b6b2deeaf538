"""A model's equations and their derivatives as tables of numbers, evaluated by compiled code.

The functions take states (B, n) and inputs (B, m) as contiguous float arrays. They know no model:
a new identified model is as fast as the published ones. numba keeps what it compiled on disk.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numba
import numpy as np

from mirte_drake.model.candidate_library import COS, HEADING, SIN, Polynomial, differentiate
from mirte_drake.vectors import YAW


class TermTable(NamedTuple):
    """Terms, and how f(x, u) and its Jacobian [df/dx, df/du] are sums of them."""

    factors: np.ndarray  # (T, length) of each term, index into [1, x, u, sin, cos]; 1 fills up.
    coefficients: np.ndarray  # (M,) those of f first, then those of the Jacobian.
    terms: np.ndarray  # (M,) index of the coefficient's term.
    entries: np.ndarray  # (M,) index into f (n), or into the Jacobian (n (n + m)) by rows.
    size: int  # Number of coefficients of f.
    # Whether RK4's two middle stages are the same: velocities depend on the states by yaw alone,
    # and the yaw rate not at all, so that yaw is linear over a step. Then RK4 is Simpson's rule.
    simpson: bool


def tabulate(
    equations: Sequence[Polynomial], states: Sequence[str], inputs: Sequence[str]
) -> TermTable:
    """Returns the table of equations, one per state, over named states and inputs."""
    assert states[YAW] == HEADING
    variables = (*states, *inputs)
    names = ("1", *variables, SIN, COS)
    jacobian = [differentiate(f, variable) for f in equations for variable in variables]
    used = sorted({term for polynomial in (*equations, *jacobian) for term in polynomial})
    length = max((len(term) for term in used), default=0)
    factors = [[*map(names.index, term), *[0] * (length - len(term))] for term in used]
    rows = [
        (coefficient, used.index(term), entry)
        for part in (equations, jacobian)
        for entry, polynomial in enumerate(part)
        for term, coefficient in polynomial.items()
    ]
    return TermTable(
        np.array(factors, dtype=np.uintp).reshape(len(used), length),
        np.array([coefficient for coefficient, _, _ in rows], dtype=float),
        np.array([term for _, term, _ in rows], dtype=np.uintp),
        np.array([entry for _, _, entry in rows], dtype=np.uintp),
        sum(len(f) for f in equations),
        _is_simpson(equations, states),
    )


def _is_simpson(equations: Sequence[Polynomial], states: Sequence[str]) -> bool:
    used = [{factor for term in f for factor in term} for f in equations]
    return not any(factors & set(states) for factors in used) and not used[YAW] & {SIN, COS}


def dense(array: np.ndarray) -> np.ndarray:
    """Returns an array as compiled code takes it: float, contiguous, writeable.

    Other kinds would be compiled anew.
    """
    array = np.ascontiguousarray(array, dtype=float)
    return array if array.flags.writeable else array.copy()


@numba.njit(cache=True)
def _workspace(table: TermTable, n: int, m: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns room for [1, x, u, sin, cos] and for the terms."""
    return np.ones(n + m + 3), np.empty(table.factors.shape[0])


@numba.njit(cache=True)
def _evaluate_terms(
    table: TermTable, x: np.ndarray, u: np.ndarray, work: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    variables, values = work
    n, m = len(x), len(u)
    for i in range(n):
        variables[1 + i] = x[i]
    for i in range(m):
        variables[1 + n + i] = u[i]
    variables[n + m + 1] = np.sin(x[YAW])
    variables[n + m + 2] = np.cos(x[YAW])
    for t in range(table.factors.shape[0]):
        value = 1.0
        for j in range(table.factors.shape[1]):
            value *= variables[table.factors[t, j]]
        values[t] = value
    return values


@numba.njit(cache=True)
def _derivative(table: TermTable, values: np.ndarray, f: np.ndarray) -> None:
    for r in range(len(f)):
        f[r] = 0.0
    for k in range(table.size):
        f[table.entries[k]] += table.coefficients[k] * values[table.terms[k]]


@numba.njit(cache=True)
def _jacobian(table: TermTable, values: np.ndarray, jacobian: np.ndarray) -> None:
    for r in range(len(jacobian)):
        jacobian[r] = 0.0
    for k in range(table.size, len(table.entries)):
        jacobian[table.entries[k]] += table.coefficients[k] * values[table.terms[k]]


@numba.njit(cache=True)
def derivative(table: TermTable, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Returns f (B, n)."""
    f, work = np.empty(x.shape), _workspace(table, x.shape[1], u.shape[1])
    for b in range(len(x)):
        _derivative(table, _evaluate_terms(table, x[b], u[b], work), f[b])
    return f


@numba.njit(cache=True)
def linearise(table: TermTable, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns f (B, n) and its Jacobian [df/dx, df/du] (B, n (n + m)), by rows."""
    B, n = x.shape
    f, jacobian = np.empty((B, n)), np.empty((B, n * (n + u.shape[1])))
    work = _workspace(table, n, u.shape[1])
    for b in range(B):
        values = _evaluate_terms(table, x[b], u[b], work)
        _derivative(table, values, f[b])
        _jacobian(table, values, jacobian[b])
    return f, jacobian


@numba.njit(cache=True)
def _step(
    table: TermTable,
    x: np.ndarray,
    u: np.ndarray,
    dt: float,
    end: np.ndarray,
    work: tuple[np.ndarray, np.ndarray],
) -> None:
    f, stage = np.empty(len(x)), x.copy()
    end[:] = x
    for i in range(4):
        if not (table.simpson and i == 2):
            _derivative(table, _evaluate_terms(table, stage, u, work), f)
        for r in range(len(x)):
            end[r] += dt / (6.0 if i in (0, 3) else 3.0) * f[r]
            stage[r] = x[r] + (dt if i == 2 else 0.5 * dt) * f[r]


@numba.njit(cache=True)
def step(table: TermTable, x: np.ndarray, u: np.ndarray, dt: np.ndarray) -> np.ndarray:
    """Returns the states (B, n) after dt (B,) [s], by RK4 with u held."""
    end, work = np.empty(x.shape), _workspace(table, x.shape[1], u.shape[1])
    for b in range(len(x)):
        _step(table, x[b], u[b], dt[b], end[b], work)
    return end


@numba.njit(cache=True)
def roll_out(table: TermTable, x: np.ndarray, inputs: np.ndarray, dt: float) -> np.ndarray:
    """Returns the states (N + 1, n) under inputs (N, m), each held for dt [s], from x (n,)."""
    states = np.empty((len(inputs) + 1, len(x)))
    states[0] = x
    work = _workspace(table, len(x), inputs.shape[1])
    for k in range(len(inputs)):
        _step(table, states[k], inputs[k], dt, states[k + 1], work)
    return states


@numba.njit(cache=True)
def _vary(jacobian: np.ndarray, G: np.ndarray, slope: np.ndarray) -> None:
    """Sets slope to df/dx G + [0, df/du]."""
    n, width = G.shape
    for r in range(n):
        for c in range(width):
            slope[r, c] = jacobian[r * width + c] if c >= n else 0.0
        for q in range(n):
            by_state = jacobian[r * width + q]
            if by_state != 0.0:
                for c in range(width):
                    slope[r, c] += by_state * G[q, c]


@numba.njit(cache=True)
def _step_jacobian(
    table: TermTable,
    x: np.ndarray,
    u: np.ndarray,
    dt: float,
    end: np.ndarray,
    total: np.ndarray,
    work: tuple[np.ndarray, np.ndarray],
) -> None:
    """RK4 on the variational equation.

    G = d(state)/d(x, u) begins as [I, 0], and its derivative is df/dx G + [0, df/du].
    """
    n, width = total.shape
    f, jacobian, stage = np.empty(n), np.empty(n * width), x.copy()
    G, slope = np.zeros((n, width)), np.empty((n, width))
    for r in range(n):
        G[r, r] = 1.0
    end[:], total[:] = x, G
    for i in range(4):
        weight, ahead = dt / (6.0 if i in (0, 3) else 3.0), dt if i == 2 else 0.5 * dt
        if not (table.simpson and i == 2):
            values = _evaluate_terms(table, stage, u, work)
            _derivative(table, values, f)
            _jacobian(table, values, jacobian)
            _vary(jacobian, G, slope)
        for r in range(n):
            end[r] += weight * f[r]
            stage[r] = x[r] + ahead * f[r]
        for r in range(n):
            for c in range(width):
                total[r, c] += weight * slope[r, c]
                G[r, c] = ahead * slope[r, c] + (1.0 if r == c else 0.0)


@numba.njit(cache=True)
def step_jacobians(table: TermTable, x: np.ndarray, u: np.ndarray, dt: float) -> np.ndarray:
    """Returns the exact Jacobian (B, n, n + m) of ``step`` by x and u."""
    B, n = x.shape
    end, jacobians = np.empty(n), np.empty((B, n, n + u.shape[1]))
    work = _workspace(table, n, u.shape[1])
    for b in range(B):
        _step_jacobian(table, x[b], u[b], dt, end, jacobians[b], work)
    return jacobians


@numba.njit(cache=True)
def roll_out_jacobians(
    table: TermTable, x: np.ndarray, inputs: np.ndarray, dt: float
) -> tuple[np.ndarray, np.ndarray]:
    """Returns ``roll_out`` and the exact Jacobian (N, n, n + m) of each of its steps."""
    N, n = len(inputs), len(x)
    states, jacobians = np.empty((N + 1, n)), np.empty((N, n, n + inputs.shape[1]))
    states[0] = x
    work = _workspace(table, n, inputs.shape[1])
    for k in range(N):
        _step_jacobian(table, states[k], inputs[k], dt, states[k + 1], jacobians[k], work)
    return states, jacobians
