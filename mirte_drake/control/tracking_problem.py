"""The optimal control problem (4-9) of one sample, as arrays: cost, gradient, constraints.

The decision vector is z = [x0; u_0; ...; u_{N-1}], the nominal initial state and the inputs held
over each sample. States follow by zero-order hold (RK4); the problem is

    min  sum_{i=0}^{N-1} |x_{i+1} - r_i|_Q^2 + |u_i|_R^2 + |u_i - u_{i-1}|_Rd^2
         + |x_N - r_{N-1}|_P^2
    s.t. |x_k - x0| <= d_k,   lower_i <= u_i <= upper_i,   |u_i - u_{i-1}| <= rate_i

with u_{-1} the last nominal input. Costs are summed without the factor 1/2 and the last state
bears stage and terminal cost, as in the published programs.

A solution always exists. rate_i is the rate limit but where bounds contradict it: the bounds keep
the inputs within what the wheels can do, so the rate gives way, by as little as possible and as
late as possible. That is the slack s >= 0 with |u_i - u_{i-1}| <= rate_limit + s_i and the penalty
w |s|_1 as w grows without limit, and of slacks that cost the same the one that spares the first
moves. Since each wheel is a chain of intervals it has a closed form, known before the solve, and
every solver meets the same constraints.
"""

import dataclasses as dc
from typing import NamedTuple

import numpy as np

from mirte_drake.control import tracking_kernels
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.model.term_table import dense
from mirte_drake.vectors import YAW


@dc.dataclass(frozen=True)
class TrackingProblem:
    """What stays the same over a run.

    ``aligned`` compares predicted state i + 1 with reference i + 1 instead of reference i. The
    published alignment (False) builds in one sample of lag.
    """

    model: PredictionModel
    period: float  # [s] T_s.
    horizon: int  # N_p.
    state_weight: np.ndarray  # (3, 3) Q, on the pose.
    input_weight: np.ndarray  # (4, 4) R.
    rate_weight: np.ndarray  # (4, 4) R_d, on the change per sample.
    terminal_weight: np.ndarray  # (3, 3) P, on the pose.
    rate_limit: np.ndarray  # (4,) [pwm_per_sample]
    aligned: bool = False

    def __post_init__(self) -> None:
        """Brings the arrays into the form that compiled code takes.

        Raises:
            ValueError: when one has the wrong shape; compiled code does not look.
        """
        m = self.model.num_inputs
        shapes = {"input_weight": (m, m), "rate_weight": (m, m), "rate_limit": (m,)}
        for field in dc.fields(self):
            if field.type is np.ndarray:
                array, shape = dense(getattr(self, field.name)), shapes.get(field.name, (3, 3))
                if array.shape != shape:
                    raise ValueError(f"{field.name}: must have shape {shape}, got {array.shape}")
                object.__setattr__(self, field.name, array)

    @property
    def size(self) -> int:
        """Length of the decision vector."""
        return self.model.num_states + self.horizon * self.model.num_inputs

    @property
    def weights(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Q, R, R_d and P."""
        return self.state_weight, self.input_weight, self.rate_weight, self.terminal_weight


# Of the fields of TrackingData.
DIMENSIONS = {
    "state": 1,
    "reference": 2,
    "half_width": 1,
    "input_lower": 2,
    "input_upper": 2,
    "previous_input": 1,
}


@dc.dataclass(frozen=True)
class TrackingData:
    """What changes with each sample, all finite; arrays are not to be written to."""

    state: np.ndarray  # (n,) measured state x_k.
    reference: np.ndarray  # (N + 1, 3) poses from sample k on.
    half_width: np.ndarray  # (n,) d_k; zeros fix x0 to the measured state.
    input_lower: np.ndarray  # (N, m) [pwm]
    input_upper: np.ndarray  # (N, m) [pwm]
    previous_input: np.ndarray  # (m,) [pwm] last nominal input.

    def __post_init__(self) -> None:
        """Brings the arrays into the form that compiled code takes.

        Raises:
            ValueError: when one has not the dimensions that it must have.
        """
        for name, dimensions in DIMENSIONS.items():
            array = dense(getattr(self, name))
            if array.ndim != dimensions:
                raise ValueError(f"problem data: {name} must have {dimensions} dimensions")
            object.__setattr__(self, name, array)

    def is_finite(self) -> bool:
        """Whether every number is finite."""
        return all(map(tracking_kernels.all_finite, vars(self).values()))


def split(problem: TrackingProblem, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the initial state (n,) and the inputs (N, m) of a decision vector."""
    n = problem.model.num_states
    return z[:n], z[n:].reshape(problem.horizon, problem.model.num_inputs)


def join(x0: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Returns the decision vector of an initial state and inputs."""
    return np.concatenate([x0, inputs.ravel()])


def data_at_rest(problem: TrackingProblem) -> TrackingData:
    """Returns the data of a robot at rest at the origin, where it shall stay."""
    n, m, N = problem.model.num_states, problem.model.num_inputs, problem.horizon
    zeros = np.zeros((N, m))
    return TrackingData(np.zeros(n), np.zeros((N + 1, 3)), np.zeros(n), zeros, zeros, np.zeros(m))


class PosedProblem(NamedTuple):
    """The problem of one sample, ready to be solved; see ``pose``."""

    data: TrackingData
    references: np.ndarray  # (N, 3) poses that x_1, ..., x_N are compared with, yaw unwrapped.
    lowest: np.ndarray  # (N, m) [pwm] the inputs from which all later bounds can be met.
    highest: np.ndarray  # (N, m) [pwm]
    rate: np.ndarray  # (N, m) [pwm_per_sample] bound on |u_i - u_{i-1}|.
    relaxed: bool  # Whether a rate is above the limit.
    least: np.ndarray  # (n + 2 N m,) bounds on [z; D z], (4-10) and (4-20).
    most: np.ndarray

    @property
    def note(self) -> str:
        """What was given up, or nothing."""
        return f"bounds ask for a move of {self.rate.max():.4g} pwm" if self.relaxed else ""

    def project(self, z: np.ndarray) -> np.ndarray:
        """Returns the decision vector near z that meets every constraint exactly."""
        return tracking_kernels.project_all(
            z,
            self.least,
            self.most,
            self.data.previous_input,
            self.lowest,
            self.highest,
            self.rate,
        )


def pose(
    problem: TrackingProblem, data: TrackingData, guess: np.ndarray | None = None
) -> PosedProblem:
    """Returns what has to be solved: references and constraints that every horizon can meet.

    Each stage's input bounds are narrowed to the inputs from which the later stages' bounds can
    be reached, which takes no solution away. A rate that contradicts the bounds is raised to just
    what they ask for. The first move is limited against the last nominal input.

    Deviation: in the source tightened bounds may contradict the rate limit, and then no input is
    feasible. And instead of wrapping each yaw error, the unwrapped window of references is shifted
    by whole turns to begin nearest to the measured yaw: the same while errors stay below half a
    turn, and smooth, which the solvers need.

    Args:
        problem: The problem.
        data: The sample's problem data.
        guess: Decision vector that a solver begins from; only checked.

    Raises:
        ValueError: when a shape does not fit, a number is not finite, a half-width negative, or a
            lower bound above its upper one.
    """
    if guess is not None and not tracking_kernels.all_finite(guess):
        raise ValueError("guess not finite")
    sound, *posed = tracking_kernels.pose(
        data.state,
        data.reference,
        data.half_width,
        data.input_lower,
        data.input_upper,
        data.previous_input,
        problem.rate_limit,
        problem.model.num_states,
        problem.horizon,
        int(problem.aligned),
    )
    if not sound:
        raise ValueError(_unsound(problem, data))
    return PosedProblem(data, *posed)


def _unsound(problem: TrackingProblem, data: TrackingData) -> str:
    """Returns why no solver can work with these data."""
    n, m, N = problem.model.num_states, problem.model.num_inputs, problem.horizon
    fitting = ((n,), (N + 1, 3), (n,), (N, m), (N, m), (m,))
    shapes = tuple(array.shape for array in vars(data).values())
    if shapes != fitting:
        return f"problem data: shapes must be {fitting}, got {shapes}"
    if not data.is_finite():
        return "measurement or problem data not finite"
    if (data.half_width < 0).any():
        return f"half_width {data.half_width.tolist()} is negative"
    stage, wheel = np.argwhere(data.input_lower > data.input_upper)[0]
    return (
        f"input_lower {data.input_lower[stage, wheel]:g} is above input_upper "
        f"{data.input_upper[stage, wheel]:g} (stage {stage}, wheel {wheel})"
    )


def rate_matrix(problem: TrackingProblem) -> np.ndarray:
    """Returns D (N m, size) with D z = [u_0; u_1 - u_0; ...; u_{N-1} - u_{N-2}]."""
    n, m, N = problem.model.num_states, problem.model.num_inputs, problem.horizon
    differences = np.eye(N) - np.eye(N, k=-1)
    return np.hstack([np.zeros((N * m, n)), np.kron(differences, np.eye(m))])


def shift(problem: TrackingProblem, initial_state: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Returns a plan moved on by one sample, the last input repeated, as decision vector.

    Args:
        problem: The problem.
        initial_state: (n,) the state after the plan's first sample.
        inputs: (N, m) the plan's inputs.
    """
    assert len(inputs) == problem.horizon
    return join(initial_state, np.vstack([inputs[1:], inputs[-1:]]))


def cost_and_gradient(
    problem: TrackingProblem, data: TrackingData, z: np.ndarray
) -> tuple[float, np.ndarray]:
    """Returns the cost (4-9) and its gradient (size,), by one backward (adjoint) sweep."""
    x0, inputs = split(problem, z)
    states, jacobians = problem.model.roll_out_jacobians(x0, inputs, problem.period)
    return tracking_kernels.cost_and_gradient(
        states,
        jacobians,
        inputs,
        tracking_kernels.stage_references(
            data.reference, data.state[YAW], int(problem.aligned), problem.horizon
        ),
        data.previous_input,
        *problem.weights,
    )


def gauss_newton_hessian(problem: TrackingProblem, z: np.ndarray) -> np.ndarray:
    """Returns the Gauss-Newton Hessian (size, size) of the cost; positive definite."""
    _, jacobians = problem.model.roll_out_jacobians(*split(problem, z), problem.period)
    return tracking_kernels.condense(jacobians, *problem.weights)
