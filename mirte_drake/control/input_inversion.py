"""Wheel inputs that drive at a wanted velocity: the identified map from inputs, inverted exactly.

Four wheels move three velocities. Of the inputs that give a wanted velocity v the one taken is
near a given input u0: u - u0 is a combination of the rows of the Jacobian J at u0, as the
pseudo-inverse gives it, n'(u - u0) = 0 for the null vector n of J. Where a wheel would go beyond a
limit, n'(u - u0) is moved away from zero, no farther than the limits ask for there.
"""

from typing import NamedTuple

import numpy as np

from mirte_drake.compiled import compiled
from mirte_drake.control.riccati import solve_linear
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.model.term_table import dense
from mirte_drake.vectors import POSE

MAX_ITERATIONS = 20
CONVERGED = 1e-12  # [m/s, rad/s] Largest error of the velocity.
FIRST_STEP = 0.125  # Of the way, in the search for how much of it is within reach.
SMALLEST_STEP = 1e-9
SWEEP = 32  # Points each way along the null space, in the search for one within the limits.
REFINEMENTS = 40  # Of each that is nearest to them: down to 1e-8 of the way to the next point.
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
PROBE = 64.0  # [pwm] A power of two, so that dividing by it rounds nothing.


class InputMap(NamedTuple):
    """Velocity v = offset + linear u + u' quadratic u, of three entries, from four inputs."""

    offset: np.ndarray  # (3,) [m/s, m/s, rad/s]
    linear: np.ndarray  # (3, 4) [.../pwm]
    quadratic: np.ndarray  # (3, 4, 4) [.../pwm^2] symmetric in the last two axes.


class Inversion(NamedTuple):
    """What ``invert`` found."""

    input: np.ndarray  # (4,) [pwm]
    fraction: float  # Of the wanted change of velocity that it gives: 1 where within reach.


def input_map(model: PredictionModel, state: np.ndarray) -> InputMap:
    """Returns the map from inputs to the derivative of the pose (world frame) at a state (n,).

    It is exact for a model whose terms have at most two inputs each.

    Raises:
        ValueError: when the model has not four inputs, or terms with more of them.
    """
    m = model.num_inputs
    if m != 4:
        raise ValueError(f"{model.name}: must have 4 inputs, got {m}")
    # The last row is a test: there, the Jacobian must be what the other rows say.
    probes = PROBE * np.vstack([np.zeros(m), np.eye(m), np.arange(1.0, m + 1.0)])
    f, _, B = model.linearise(np.tile(state, (len(probes), 1)), probes)
    linear = B[0, POSE]
    slopes = (B[1 : m + 1, POSE] - linear) / PROBE  # (input, velocity, input)
    quadratic = dense(0.5 * slopes.transpose(1, 2, 0))
    expected = linear + 2.0 * quadratic @ probes[-1]
    if not np.allclose(B[-1, POSE], expected, rtol=1e-9, atol=1e-12):
        raise ValueError(f"{model.name}: terms must have at most two inputs each")
    return InputMap(dense(f[0, POSE]), dense(linear), quadratic)


@compiled
def velocity(mapping: InputMap, u: np.ndarray) -> np.ndarray:
    """Returns the velocity (3,) of an input (4,)."""
    v = mapping.offset.copy()
    for r in range(3):
        for i in range(4):
            slope = mapping.linear[r, i]
            for j in range(4):
                slope += mapping.quadratic[r, i, j] * u[j]
            v[r] += slope * u[i]
    return v


@compiled
def jacobian(mapping: InputMap, u: np.ndarray) -> np.ndarray:
    """Returns the Jacobian (3, 4) of ``velocity`` by the input (4,)."""
    J = mapping.linear.copy()
    for r in range(3):
        for i in range(4):
            for j in range(4):
                J[r, i] += 2.0 * mapping.quadratic[r, i, j] * u[j]
    return J


@compiled
def null_vector(J: np.ndarray) -> np.ndarray:
    """Returns the unit vector n (4,) with J n = 0 of a matrix (3, 4), by its minors.

    It is not finite where the rows of J depend on each other.
    """
    n, square = np.empty(4), 0.0
    for i in range(4):
        a, b, c = (i + 1) % 4, (i + 2) % 4, (i + 3) % 4
        minor = (
            J[0, a] * (J[1, b] * J[2, c] - J[1, c] * J[2, b])
            + J[0, b] * (J[1, c] * J[2, a] - J[1, a] * J[2, c])
            + J[0, c] * (J[1, a] * J[2, b] - J[1, b] * J[2, a])
        )
        n[i] = -minor if i % 2 else minor
        square += minor**2
    for i in range(4):
        n[i] /= np.sqrt(square)
    return n


@compiled
def _room(
    u: np.ndarray, step: np.ndarray, along: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[float, float]:
    """Returns the least and the largest s with lower <= u + step + s along <= upper."""
    least, most = -np.inf, np.inf
    for i in range(4):
        start = u[i] + step[i]
        if along[i] != 0.0:
            s, t = (lower[i] - start) / along[i], (upper[i] - start) / along[i]
            least, most = max(least, min(s, t)), min(most, max(s, t))
        elif not lower[i] <= start <= upper[i]:
            return np.inf, -np.inf
    return least, most


@compiled
def _equations(
    mapping: InputMap, target: np.ndarray, near: np.ndarray, n: np.ndarray, u: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns Newton's equations (4, 4), (4,) for the target and n'(u - near) = 0, at u."""
    J, v = jacobian(mapping, u), velocity(mapping, u)
    system, right = np.empty((4, 4)), np.zeros(4)
    for i in range(4):
        for r in range(3):
            system[r, i] = J[r, i]
        system[3, i] = n[i]
        right[3] += n[i] * (near[i] - u[i])
    for r in range(3):
        right[r] = target[r] - v[r]
    return system, right


@compiled
def _newton(
    mapping: InputMap,
    target: np.ndarray,
    near: np.ndarray,
    start: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
) -> tuple[np.ndarray, bool]:
    """Returns an input (4,), and whether it gives the target within the limits.

    Newton's method from ``start`` on the three velocities and the fourth equation
    n'(u - near) = s. Along the null space s is 0 where that is within the limits, or the nearest
    to it that is; on the way, where none is, the one in the middle of what the limits ask for.
    """
    n = null_vector(jacobian(mapping, near))
    u, right = start.copy(), np.zeros((4, 2))
    right[3, 1] = 1.0
    for _ in range(MAX_ITERATIONS):
        system, right[:, 0] = _equations(mapping, target, near, n, u)
        solution = solve_linear(system, right)
        step, along = solution[:, 0], solution[:, 1]
        least, most = _room(u, step, along, lower, upper)
        inside = least <= most
        s = min(max(0.0, least), most) if inside else 0.5 * (least + most)
        for i in range(4):
            u[i] += step[i] + s * along[i]
        v, given = velocity(mapping, u), True
        for r in range(3):
            given = given and abs(v[r] - target[r]) <= CONVERGED
        if given:
            for i in range(4):  # A wheel at its limit may be past it by rounding.
                u[i] = min(max(u[i], lower[i]), upper[i])
            return u, inside
    return u, False


@compiled
def _at(
    mapping: InputMap,
    target: np.ndarray,
    near: np.ndarray,
    n: np.ndarray,
    s: float,
    start: np.ndarray,
) -> tuple[np.ndarray, bool]:
    """Returns the input (4,) that gives the target with n'(u - near) = s, and whether it does."""
    u, right = start.copy(), np.empty((4, 1))
    for _ in range(MAX_ITERATIONS):
        system, right[:, 0] = _equations(mapping, target, near, n, u)
        right[3, 0] += s
        missing = np.abs(right[:, 0])
        if np.max(missing[:3]) <= CONVERGED and missing[3] <= CONVERGED * (1.0 + abs(s)):
            return u, True
        u += solve_linear(system, right)[:, 0]
    return u, False


@compiled
def _excess(u: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> float:
    """Returns by how much [pwm] the wheel that is farthest beyond its limits is; inside: <= 0."""
    return np.max(np.maximum(lower - u, u - upper))


@compiled
def _sweep(
    mapping: InputMap,
    target: np.ndarray,
    near: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
) -> tuple[np.ndarray, bool]:
    """Returns an input (4,) that gives the target, and whether there is one within the limits.

    The inputs that give it are a curve along n'(u - near) = s, which bends: where limits bind, the
    s that they leave may not be reached by small steps from one that they left before.
    """
    if not np.any(mapping.quadratic):
        return near, False  # The curve is a line: Newton's method has seen all of it.
    n = null_vector(jacobian(mapping, near))
    spacing = np.sum(np.abs(n) * np.maximum(upper - near, near - lower)) / SWEEP
    points, excess = np.empty((2 * SWEEP + 1, 4)), np.full(2 * SWEEP + 1, np.inf)
    for way in (1, -1):
        start = near
        for step in range(SWEEP + 1):
            u, given = _at(mapping, target, near, n, way * step * spacing, start)
            if given:
                k = SWEEP + way * step
                points[k], excess[k], start = u, _excess(u, lower, upper), u
    for place in range(1, 2 * SWEEP):  # From s = 0 outwards, to both sides.
        k = SWEEP + (place // 2 if place % 2 == 0 else -(place // 2))
        if excess[k] == np.inf or excess[k] > excess[k - 1] or excess[k] > excess[k + 1]:
            continue
        u, least = points[k], excess[k]
        left, right = (k - 1 - SWEEP) * spacing, (k + 1 - SWEEP) * spacing
        for _ in range(REFINEMENTS):
            if least <= 0.0:
                return u, True
            inner = GOLDEN * (right - left)
            a, given_a = _at(mapping, target, near, n, right - inner, u)
            b, given_b = _at(mapping, target, near, n, left + inner, u)
            if not (given_a and given_b):
                break
            beyond_a, beyond_b = _excess(a, lower, upper), _excess(b, lower, upper)
            if beyond_a <= beyond_b:
                u, least, right = a, beyond_a, left + inner
            else:
                u, least, left = b, beyond_b, right - inner
    return near, False


@compiled
def _invert(
    mapping: InputMap,
    target: np.ndarray,
    near: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
) -> tuple[np.ndarray, float]:
    u, found = _newton(mapping, target, near, near, lower, upper)
    if found:
        return u, 1.0
    there, found = _sweep(mapping, target, near, lower, upper)
    if found:
        # From there to the end of what the limits leave that is nearest to s = 0.
        u, found = _newton(mapping, target, near, there, lower, upper)
        return (u if found else there), 1.0
    best, reached, step = near, 0.0, FIRST_STEP
    start = velocity(mapping, near)
    while step > SMALLEST_STEP:
        fraction = min(reached + step, 1.0)
        nearer = start + fraction * (target - start)
        u, found = _newton(mapping, nearer, near, best, lower, upper)
        if not found:
            step *= 0.5
            continue
        best, reached = u, fraction
        if reached == 1.0:
            break
    return best, reached


def invert(
    mapping: InputMap,
    target: np.ndarray,
    near: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
) -> Inversion:
    """Returns the input near a given one that gives a wanted velocity.

    Where none within the limits is found to give it, the input goes as far as it can on the
    straight way from the velocity of ``near`` to the wanted one, from ``near`` on: the change of
    velocity keeps its direction. Inputs that give all of it are looked for by way of smaller
    changes and on a grid along the null space, which can miss one that is far from ``near``.

    Args:
        mapping: The map from inputs to velocities.
        target: (3,) [m/s, m/s, rad/s] wanted velocity.
        near: (4,) [pwm] the given input; it is taken into the limits first.
        lower: (4,) [pwm] least input.
        upper: (4,) [pwm] largest input, not below ``lower``.

    Returns:
        The input, and the fraction: 1 where the wanted velocity is given to ``CONVERGED``.
    """
    near, lower, upper = np.clip(dense(near), lower, upper), dense(lower), dense(upper)
    return Inversion(*_invert(mapping, dense(target), near, lower, upper))
