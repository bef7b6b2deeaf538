"""The optimal control problem (4-9) of one sample, as arrays: cost, gradient, constraints.

The decision vector is z = [x0; u_0; ...; u_{N-1}], the nominal initial state and the inputs held
over each sample. States follow by zero-order hold (RK4); the problem is

    min  sum_{i=0}^{N-1} |x_{i+1} - r_i|_Q^2 + |u_i|_R^2 + |u_i - u_{i-1}|_Rd^2
         + |x_N - r_{N-1}|_P^2
    s.t. |x_k - x0| <= d_k,   lower_i <= u_i <= upper_i,   |u_i - u_{i-1}| <= rate_limit

with u_{-1} the last nominal input. Costs are summed without the factor 1/2 and the last state
bears stage and terminal cost, as in the published programs.
"""

import dataclasses as dc

import numpy as np

from mirte_drake.angles import unwrap_near
from mirte_drake.model.sparse_model import SparseModel
from mirte_drake.vectors import POSE, YAW


@dc.dataclass(frozen=True)
class TrackingProblem:
    """What stays the same over a run.

    ``aligned`` compares predicted state i + 1 with reference i + 1 instead of reference i. The
    published alignment (False) builds in one sample of lag.
    """

    model: SparseModel
    period: float  # [s] T_s.
    horizon: int  # N_p.
    state_weight: np.ndarray  # (3, 3) Q, on the pose.
    input_weight: np.ndarray  # (4, 4) R.
    rate_weight: np.ndarray  # (4, 4) R_d, on the change per sample.
    terminal_weight: np.ndarray  # (3, 3) P, on the pose.
    rate_limit: np.ndarray  # (4,) [pwm_per_sample]
    aligned: bool = False

    @property
    def size(self) -> int:
        """Length of the decision vector."""
        return self.model.num_states + self.horizon * self.model.num_inputs


@dc.dataclass(frozen=True)
class TrackingData:
    """What changes with each sample; arrays are not to be written to."""

    state: np.ndarray  # (n,) measured state x_k.
    reference: np.ndarray  # (N + 1, 3) poses from sample k on.
    half_width: np.ndarray  # (n,) d_k; zeros fix x0 to the measured state.
    input_lower: np.ndarray  # (N, m) [pwm]
    input_upper: np.ndarray  # (N, m) [pwm]
    previous_input: np.ndarray  # (m,) [pwm] last nominal input.

    def is_finite(self) -> bool:
        """Whether every number is finite."""
        return all(np.all(np.isfinite(getattr(self, f.name))) for f in dc.fields(self))


def reachable_bounds(
    problem: TrackingProblem, lower: np.ndarray, upper: np.ndarray, previous_input: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns input bounds (N, m), widened where the rate limit keeps the input outside them.

    Deviation: the source lets the tightened bounds move faster than the rate limit, and then no
    input is feasible. Here the rate limit wins: a stage's bound reaches as far as full moves from
    the last input towards it lead.

    Args:
        problem: The problem.
        lower: (N, m) [pwm]
        upper: (N, m) [pwm]
        previous_input: (m,) [pwm]
    """
    reach = problem.rate_limit * np.arange(1, problem.horizon + 1)[:, None]
    return np.minimum(lower, previous_input + reach), np.maximum(upper, previous_input - reach)


def split(problem: TrackingProblem, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the initial state (n,) and the inputs (N, m) of a decision vector."""
    n = problem.model.num_states
    return z[:n], z[n:].reshape(problem.horizon, problem.model.num_inputs)


def join(x0: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Returns the decision vector of an initial state and inputs."""
    return np.concatenate([x0, inputs.ravel()])


def bounds(data: TrackingData) -> tuple[np.ndarray, np.ndarray]:
    """Returns lower and upper bounds on the decision vector (4-10), (4-20)."""
    return (
        join(data.state - data.half_width, data.input_lower),
        join(data.state + data.half_width, data.input_upper),
    )


def rate_matrix(problem: TrackingProblem) -> np.ndarray:
    """Returns D (N m, size) with D z = [u_0; u_1 - u_0; ...; u_{N-1} - u_{N-2}]."""
    n, m, N = problem.model.num_states, problem.model.num_inputs, problem.horizon
    differences = np.eye(N) - np.eye(N, k=-1)
    return np.hstack([np.zeros((N * m, n)), np.kron(differences, np.eye(m))])


def rate_bounds(problem: TrackingProblem, data: TrackingData) -> tuple[np.ndarray, np.ndarray]:
    """Returns the bounds (N m,) on D z; the first move is limited against the last input."""
    limit = np.tile(problem.rate_limit, problem.horizon)
    offset = np.zeros_like(limit)
    offset[: problem.model.num_inputs] = data.previous_input
    return offset - limit, offset + limit


def stage_references(problem: TrackingProblem, data: TrackingData) -> np.ndarray:
    """Returns the pose (N, 3) that each predicted state x_1 .. x_N is compared with.

    Deviation: instead of wrapping each yaw error, the unwrapped window is shifted by whole turns
    to begin nearest to the measured yaw. The same while errors stay below half a turn, and
    smooth, which the solvers need.
    """
    first = int(problem.aligned)
    reference = data.reference[first : first + problem.horizon].copy()
    yaw = np.unwrap(data.reference[:, YAW])
    shift = unwrap_near(yaw[0], data.state[YAW]) - yaw[0]
    reference[:, YAW] = yaw[first : first + problem.horizon] + shift
    return reference


def cost_and_gradient(
    problem: TrackingProblem, data: TrackingData, z: np.ndarray
) -> tuple[float, np.ndarray]:
    """Returns the cost (4-9) and its gradient (size,), by one backward (adjoint) sweep."""
    model = problem.model
    x0, inputs = split(problem, z)
    states = model.roll_out(x0, inputs, problem.period)
    Phi, Gamma = model.step_jacobians(states[:-1], inputs, problem.period)

    error = states[1:, POSE] - stage_references(problem, data)
    moves = np.diff(inputs, axis=0, prepend=data.previous_input[None])
    weighted_error = error @ problem.state_weight
    weighted_error[-1] += problem.terminal_weight @ error[-1]
    weighted_inputs = inputs @ problem.input_weight
    weighted_moves = moves @ problem.rate_weight
    value = (
        np.vdot(error, weighted_error)
        + np.vdot(inputs, weighted_inputs)
        + np.vdot(moves, weighted_moves)
    )

    by_inputs = weighted_inputs + weighted_moves
    by_inputs[:-1] -= weighted_moves[1:]
    adjoint = np.zeros(model.num_states)
    for i in reversed(range(problem.horizon)):
        adjoint[POSE] += weighted_error[i]
        by_inputs[i] += adjoint @ Gamma[i]
        adjoint = adjoint @ Phi[i]
    return float(value), 2.0 * join(adjoint, by_inputs)


def gauss_newton_hessian(problem: TrackingProblem, data: TrackingData, z: np.ndarray) -> np.ndarray:
    """Returns the Gauss-Newton Hessian (size, size) of the cost; positive definite."""
    n, m = problem.model.num_states, problem.model.num_inputs
    x0, inputs = split(problem, z)
    states = problem.model.roll_out(x0, inputs, problem.period)
    Phi, Gamma = problem.model.step_jacobians(states[:-1], inputs, problem.period)
    D = rate_matrix(problem)
    hessian = D.T @ np.kron(np.eye(problem.horizon), problem.rate_weight) @ D
    hessian[n:, n:] += np.kron(np.eye(problem.horizon), problem.input_weight)
    sensitivity = np.zeros((n, problem.size))
    sensitivity[:, :n] = np.eye(n)
    for i in range(problem.horizon):
        sensitivity = Phi[i] @ sensitivity
        sensitivity[:, n + i * m : n + (i + 1) * m] += Gamma[i]
        last = i == problem.horizon - 1
        weight = problem.state_weight + (problem.terminal_weight if last else 0.0)
        hessian += sensitivity[POSE].T @ weight @ sensitivity[POSE]
    return 2.0 * hessian
