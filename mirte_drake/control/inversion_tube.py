"""The tube of the law that inverts the input map: docs/concepts/rigorous_tube.md derives it.

The robot is the identified model with a disturbance w, |w| <= bound, in the body frame:
xdot = F(yaw, u) + R(yaw) w. The law asks that the model's successor has 1 - k T_s of the error.
"""

import numpy as np

from mirte_drake.angles import pose_error
from mirte_drake.compiled import compiled
from mirte_drake.control.input_inversion import jacobian, null_vector, velocity
from mirte_drake.control.turning_map import TurningMap, simpson
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.model.term_table import dense
from mirte_drake.vectors import YAW

QUARTER = 0.5 * np.pi
PASSES = 3  # Of a bound that depends on itself, each smaller than the one before.
SLACK = 1e-6  # Relative; more than rounding and the inversion's tolerance need.


def swept_bound(bound: np.ndarray, yaw: float, spread: float) -> np.ndarray:
    """Returns the smallest world-frame box (3,) around a body-frame box that turns.

    It holds R(psi) w for all |psi - yaw| <= spread and |w| <= bound.
    """
    length, peak = np.hypot(bound[0], bound[1]), np.arctan2(bound[1], bound[0])
    # |cos psi| w_x + |sin psi| w_y is the larger of length |cos(psi -+ peak)|; in y a quarter on.
    angles = np.array([[yaw], [yaw - QUARTER]]) + np.array([-peak, peak])
    sides = length * _largest_cosine(angles, spread).max(axis=1)
    return np.array([*sides, bound[YAW]])


def _largest_cosine(angles: np.ndarray, spread: float) -> np.ndarray:
    """Returns the largest |cos| of all angles within the spread of each."""
    distance = np.abs((angles + QUARTER) % np.pi - QUARTER)  # From where |cos| is one.
    return np.cos(np.maximum(distance - spread, 0.0))


def disturbance_reach(
    mapping: TurningMap,
    yaw: float,
    u: np.ndarray,
    bound: np.ndarray,
    period: float,
    spread: float = 0.0,
) -> np.ndarray:
    """Returns how far (3,) a sample's disturbance takes the robot from the model's prediction.

    That is the disturbance itself, in the world frame while the robot turns; the turn that the
    disturbed yaw gives to the model's velocity; and the error of RK4, here Simpson's rule.

    Args:
        mapping: The model.
        yaw: [rad] at the start of the sample.
        u: (4,) [pwm] the input held.
        bound: (3,) [m/s, m/s, rad/s] of the disturbance, body frame.
        period: [s] the sample.
        spread: [rad] by which the yaw may be off.
    """
    rate = abs(velocity(mapping.still, u)[YAW])
    swept = spread + 0.5 * rate * period + bound[YAW] * period
    middle = yaw + 0.5 * velocity(mapping.still, u)[YAW] * period
    turn = 0.5 * period**2 * bound[YAW] * turning_speed(mapping, u, middle, swept)
    integration = period**5 / 2880.0 * rate**4 * turning_speed(mapping, u)
    return period * swept_bound(bound, middle, swept) + turn + integration


def turning_speed(
    mapping: TurningMap, u: np.ndarray, yaw: float = 0.0, spread: float = np.pi
) -> np.ndarray:
    """Returns the largest |dF/dyaw| (3,) at an input (4,) of all yaws within the spread."""
    sine, cosine = velocity(mapping.sine, u), velocity(mapping.cosine, u)
    return np.hypot(sine, cosine) * _largest_cosine(yaw + np.arctan2(cosine, sine), spread)


def propagate_inversion_tube(
    model: PredictionModel,
    mapping: TurningMap,
    nominal: tuple[np.ndarray, np.ndarray],
    state: np.ndarray,
    u: np.ndarray,
    half_width: np.ndarray,
    bound: np.ndarray,
    feedback: float,
    period: float,
) -> np.ndarray:
    """Returns d_{k+1} (3,), which holds |x_{k+1} - xbar_{k+1}| for every disturbance.

    d_{k+1} = |1 - k T_s| d_k + |m_k| + W_k, where m_k is how far the model's successor under the
    input is from what the law asks for: zero where the law reached it, and whatever it fell short
    of otherwise. Nothing is assumed of the input.

    Args:
        model: The model.
        mapping: The same.
        nominal: xhat_k (3,) and xbar_{k+1} (3,), with |x_k - xhat_k| <= d_k.
        state: (3,) measured x_k; where it is not finite, any in the tube is reckoned with.
        u: (4,) [pwm] the input applied.
        half_width: (3,) d_k.
        bound: (3,) [m/s, m/s, rad/s] of the disturbance, body frame.
        feedback: [1/s] k.
        period: [s] T_s.
    """
    xhat, successor = nominal
    if not np.all(np.isfinite(state)):
        moved = np.abs(model.step(xhat, u, period) - successor)
        drift = period * half_width[YAW] * turning_speed(mapping, u)
        reach = disturbance_reach(mapping, xhat[YAW], u, bound, period, half_width[YAW])
        return half_width + moved + drift + reach
    factor = 1.0 - feedback * period
    predicted = model.step(state, u, period)
    mismatch = pose_error(predicted, successor) - factor * pose_error(state, xhat)
    reach = disturbance_reach(mapping, state[YAW], u, bound, period)
    return abs(factor) * half_width + np.abs(mismatch) + reach


def check_linear_position(mapping: TurningMap, name: str) -> None:
    """Checks that inputs move the position linearly, as ``required_room`` takes it.

    Raises:
        ValueError: when they do not; ``name`` is the model's.
    """
    parts = mapping.still, mapping.sine, mapping.cosine
    if any(np.any(part.quadratic[:YAW]) for part in parts):
        raise ValueError(f"{name}: products of inputs must be in the yaw rate alone")


def required_room(
    mapping: TurningMap,
    yaw: float,
    nominal_input: np.ndarray,
    half_width: np.ndarray,
    feedback: float,
    period: float,
    limit: float,
) -> np.ndarray:
    """Returns how far (4,) [pwm] the law may have to move each wheel, for any error in the tube.

    For every error |e| <= d some input within this distance of the nominal one gives what the law
    asks for. It is infinite where that could not be shown for moves up to the limit.

    Args:
        mapping: The model; see ``check_linear_position``.
        yaw: [rad] nominal yaw.
        nominal_input: (4,) [pwm] ubar.
        half_width: (3,) d.
        feedback: [1/s] k, at most 1 / T_s.
        period: [s] T_s.
        limit: [pwm] largest move that is looked at.
    """
    ubar = dense(nominal_input)
    rate = velocity(mapping.still, ubar)[YAW]
    J = jacobian(mapping.over(yaw, rate, period), ubar)
    inverses = _right_inverses(np.linalg.pinv(J), null_vector(J))
    # By how much a yaw off by phi changes the mean velocity of the nominal input and of moves.
    drift, bends = np.zeros(3), np.zeros((len(inverses), 3, 3))
    for weight, time in simpson(period):
        phi = half_width[YAW] * (1.0 - feedback * time)
        there = yaw + rate * time
        # dF/dyaw and -d2F/dyaw2.
        for part, size in (
            (mapping.turned(there + QUARTER), phi),
            (mapping.turned(there), phi**2 / 2),
        ):
            drift += weight * size * np.abs(velocity(part, ubar))
            bends += weight * size * np.abs(jacobian(part, ubar) @ inverses)
    asked = (1.0 + SLACK) * (feedback * half_width + drift)
    room = _least_room(inverses, bends, mapping.still.quadratic[YAW], asked)
    return np.where(np.all(room <= limit), room, np.inf)


def _right_inverses(C: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Returns right inverses (K, 4, 3) of a matrix with pseudo-inverse C and null vector n.

    They are the pseudo-inverse, and for each pair of wheels what brings their moves half way and
    all the way to equal ones along the null vector.
    """
    result, signs, sizes = [C], np.sign(n), np.abs(n)
    for i in range(4):
        for j in range(i):
            if sizes[i] + sizes[j] == 0.0:
                continue
            level = (signs[i] * C[i] + signs[j] * C[j]) / (sizes[i] + sizes[j])
            level[YAW] = 0.0
            result += [C - part * np.outer(n, level) for part in (0.5, 1.0)]
    return np.array(result)


@compiled
def _least_room(
    inverses: np.ndarray, bends: np.ndarray, H: np.ndarray, asked: np.ndarray
) -> np.ndarray:
    """Returns the room (4,) of the right inverse whose largest move is the smallest.

    Each is sound. ``bends`` (K, 3, 3) bounds how much a turn within the tube changes what moves
    of unit velocity give.
    """
    best, least = np.full(4, np.inf), np.inf
    for k in range(len(inverses)):
        blur, sound = asked[:YAW].copy(), True  # A guess that must prove an upper bound.
        for _ in range(PASSES):
            room, z = _room(inverses[k], H, asked, blur)
            for c in range(YAW):
                smaller = bends[k, c, YAW] * z
                for i in range(YAW):
                    smaller += bends[k, c, i] * (asked[i] + blur[i])
                sound = sound and smaller <= blur[c]
                blur[c] = smaller
        largest = max(room[0], room[1], room[2], room[3])
        if sound and largest < least:
            best, least = room, largest
    return best


@compiled
def _room(
    C: np.ndarray, H: np.ndarray, asked: np.ndarray, blur: np.ndarray
) -> tuple[np.ndarray, float]:
    """Returns the room (4,) of moves P y + s z D, [P, D] = C, and the largest z.

    For each quadrant of y and both signs s, z is such that the yaw rate changes by ``asked`` or
    more in the direction s: s (s z + (P y + s z D)' H (P y + s z D)) >= asked for all y there.
    That is quadratic in y, and a quadratic function is at least the smallest of its values at the
    corners of a rectangle, less a quarter of each side squared times the curvature along it where
    that is positive.
    """
    D = C[:, YAW].copy()
    moves, constant, linear = np.empty((4, 4)), np.empty(4), np.empty(4)
    room, largest, square = np.zeros(4), 0.0, _form(D, H, D)
    for quadrant in range(4):
        for corner in range(4):
            move = moves[corner]
            move[:] = 0.0
            for c in range(YAW):
                side = 1.0 if quadrant >> c & 1 else -1.0
                y = side * (asked[c] + blur[c] if corner >> c & 1 else -blur[c])
                for i in range(4):
                    move[i] += C[i, c] * y
            constant[corner], linear[corner] = _form(move, H, move), 2.0 * _form(move, H, D)
        for s in (1.0, -1.0):
            bulge = 0.0
            for c in range(YAW):
                curvature = max(s * _form(C[:, c], H, C[:, c]), 0.0)
                bulge += 0.25 * (asked[c] + 2.0 * blur[c]) ** 2 * curvature
            z = _least_solution(s, constant, linear, square, asked[YAW] + bulge)
            largest = max(largest, z)
            for corner in range(4):
                for i in range(4):
                    room[i] = max(room[i], abs(moves[corner, i] + s * z * D[i]))
    return room, largest


@compiled
def _least_solution(
    s: float, constant: np.ndarray, linear: np.ndarray, square: float, asked: float
) -> float:
    """Returns z >= 0 with s constant + (1 + linear) z + s square z^2 >= asked for all, or inf."""
    z = 0.0
    for corner in range(len(constant)):
        missing, slope = asked - s * constant[corner], 1.0 + linear[corner]
        if missing > 0.0:
            root = np.sqrt(slope**2 + 4.0 * s * square * missing)
            z = max(z, 2.0 * missing / (slope + root))
    z *= 1.0 + SLACK
    for corner in range(len(constant)):
        if not s * (constant[corner] + square * z**2) + (1.0 + linear[corner]) * z >= asked:
            return np.inf
    return z


@compiled
def _form(a: np.ndarray, H: np.ndarray, b: np.ndarray) -> float:
    """Returns a' H b."""
    total = 0.0
    for i in range(4):
        for j in range(4):
            total += a[i] * H[i, j] * b[j]
    return total
