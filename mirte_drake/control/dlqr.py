"""The ancillary law: linearisation, forward Euler and the discrete LQR, (4-11) to (4-16)."""

import dataclasses as dc

import numpy as np

from mirte_drake.control.riccati import solve_dare
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.model.term_table import dense
from mirte_drake.vectors import POSE, POSE_SIZE, YAW

TRIFLE = 1e-6  # Of the smallest weight on the pose: keeps a weight on all states definite.
LARGEST_RESIDUAL = 1e-9  # Of the Riccati equation, relative to P.


@dc.dataclass(frozen=True)
class DlqrDesign:
    """Gain and closed loop at one linearisation point; arrays are not to be written to."""

    yaw: float  # [rad] of the linearisation point.
    gain: np.ndarray  # (m, n) K_k [pwm per state unit].
    closed_loop: np.ndarray  # (n, n) A_k - B_k K_k.


def discretise_euler(A: np.ndarray, B: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns A_k = I + T_s A and B_k = T_s B, forward Euler (4-12)."""
    return np.eye(len(A)) + period * A, period * B


def solve_dlqr(
    A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the infinite-horizon gain K (4-14) and Riccati matrix P (4-13).

    Every result is checked: its residual in (4-13), and that A - B K is stable.

    Args:
        A: (n, n) discrete-time system.
        B: (n, m)
        Q: (n, n) state weight, positive definite.
        R: (m, m) input weight, positive definite.

    Raises:
        ValueError: when a matrix is not finite, a weight is not symmetric and positive definite,
            or (A, B) cannot be stabilised.
    """
    A, B, Q, R = dense(A), dense(B), dense(Q), dense(R)
    K, P, residual, sound = solve_dare(A, B, Q, R)
    if sound and residual <= LARGEST_RESIDUAL:
        return K, P
    if not all(np.all(np.isfinite(matrix)) for matrix in (A, B, Q, R)):
        raise ValueError("DLQR: a matrix is not finite")
    for name, weight in (("Q", Q), ("R", R)):
        if np.any(weight != weight.T) or np.linalg.eigvalsh(weight)[0] <= 0:
            raise ValueError(f"DLQR: {name} must be symmetric and positive definite")
    check_stabilisable(A, B)
    raise ValueError(f"DLQR: no accurate solution: relative residual {residual:.3g}")


def check_stabilisable(A: np.ndarray, B: np.ndarray, tolerance: float = 1e-9) -> None:
    """Checks by the Popov-Belevitch-Hautus test that every unstable mode can be moved.

    It names what ``solve_dlqr`` only finds to be unsolvable.

    Raises:
        ValueError: naming the mode that no input reaches.
    """
    n = len(A)
    for eigenvalue in np.linalg.eigvals(A):
        if abs(eigenvalue) < 1.0 - tolerance:
            continue
        pencil = np.hstack([eigenvalue * np.eye(n) - A, B])
        if np.linalg.svd(pencil, compute_uv=False)[-1] < tolerance:
            raise ValueError(
                f"DLQR: the pair (A, B) cannot be stabilised: no input reaches the mode with "
                f"eigenvalue {eigenvalue:.6g}"
            )


def design_dlqr(
    model: PredictionModel,
    x: np.ndarray,
    u: np.ndarray,
    period: float,
    Q: np.ndarray,
    R: np.ndarray,
) -> DlqrDesign:
    """Returns the DLQR at a nominal state (n,) and input (m,).

    Raises:
        ValueError: as ``solve_dlqr``.
    """
    _, A, B = model.linearise(x, u)
    A_k, B_k = discretise_euler(A, B, period)
    K, _ = solve_dlqr(A_k, B_k, Q, R)
    return DlqrDesign(float(x[YAW]), K, A_k - B_k @ K)


def steady_input(model: PredictionModel, velocity: np.ndarray) -> np.ndarray:
    """Returns an input (m,) that drives at a velocity (3,) at yaw 0.

    Newton's method with the pseudo-inverse; velocity [m/s, m/s, rad/s].

    Raises:
        ValueError: when the model cannot drive so.
    """
    x, u = np.zeros(model.num_states), np.zeros(model.num_inputs)
    for _ in range(20):
        f, _, B = model.linearise(x, u)
        error = velocity - f[POSE]
        if np.max(np.abs(error)) < 1e-12:
            return u
        if not np.all(np.isfinite(error)):
            break
        u = u + np.linalg.pinv(B[POSE]) @ error
    raise ValueError(f"{model.name}: no input drives at {velocity.tolist()}")


def straight_line_terminal_weight(
    model: PredictionModel, period: float, Q: np.ndarray, R: np.ndarray, speed: float = 0.1
) -> np.ndarray:
    """Returns the Riccati matrix P (n, n) of steady forward driving at yaw 0 (section 4-2).

    Near the published P, which it does not reproduce: where that was linearised is not known.

    Of a model with more states it is the cost of an error of the pose alone, if the other states'
    are at best: P_pp - P_pv P_vv^-1 P_vp. These states bear no cost of their own but a trifle.
    """
    n = model.num_states
    if n == POSE_SIZE:
        u = steady_input(model, np.array([speed, 0.0, 0.0]))
        _, A, B = model.linearise(np.zeros(n), u)
        return solve_dlqr(*discretise_euler(A, B, period), Q, R)[1]
    jacobian = model.step_jacobians(np.zeros(n), np.zeros(model.num_inputs), period)
    weight = np.diag(np.full(n, TRIFLE * np.min(np.diag(Q))))
    weight[POSE, POSE] = Q
    _, P = solve_dlqr(jacobian[:, :n], jacobian[:, n:], weight, R)
    beside = slice(POSE_SIZE, n)
    rest = P[POSE, POSE] - P[POSE, beside] @ np.linalg.solve(P[beside, beside], P[beside, POSE])
    return 0.5 * (rest + rest.T)
