"""The nominal plan of one sample, and what replaces it when a solve fails."""

import dataclasses as dc
import enum

import numpy as np

from mirte_drake.control.nmpc_solution import NmpcSolution
from mirte_drake.control.reference_paths import slew
from mirte_drake.control.tracking_problem import (
    TrackingData,
    TrackingProblem,
    data_at_rest,
    shift,
    split,
)
from mirte_drake.vectors import POSE_SIZE

MAX_SHIFTS = 3


class SolveStatus(enum.IntEnum):
    """Where the plan of a sample comes from."""

    SOLVED = 0  # From the solver.
    SHIFTED = 1  # The solve failed: the previous plan, moved on by one sample.
    STOPPING = 2  # More than MAX_SHIFTS in a row failed: the wheels ramp to zero.
    RELAXED = 3  # From the solver; a move is faster than the rate limit, as the bounds ask.
    EARLY = 4  # From the solver, before it reached the optimum: its best iterate.
    RELAXED_EARLY = 5  # Both.

    @property
    def failed(self) -> bool:
        """Whether the plan is not of the solver."""
        return self in (SolveStatus.SHIFTED, SolveStatus.STOPPING)

    @property
    def relaxed(self) -> bool:
        """Whether a move is faster than the rate limit."""
        return self in (SolveStatus.RELAXED, SolveStatus.RELAXED_EARLY)

    @property
    def early(self) -> bool:
        """Whether the solver ended before the optimum."""
        return self in (SolveStatus.EARLY, SolveStatus.RELAXED_EARLY)


@dc.dataclass(frozen=True)
class Plan:
    """Nominal states and inputs over the horizon, with the problem they answer.

    Arrays are not to be written to.
    """

    sample: int  # Number of the solve, from 0; -1 before the first.
    status: SolveStatus
    message: str  # Why the solve failed or what it gave up, or empty.
    states: np.ndarray  # (N + 1, n) xhat_k, xbar_{k+1}, ...
    inputs: np.ndarray  # (N, m) [pwm]
    data: TrackingData  # What was solved.
    failures: int = 0  # Failed solves in a row.
    cost: float = np.nan
    iterations: int = 0
    solve_time: float = 0.0  # [s] preparation included.
    preparation_time: float = 0.0  # [s] of it, spent before the measurement arrived.
    # (3,) [m, m, rad] r_k of the sample; ``data`` begins later where the plan does.
    reference: np.ndarray = dc.field(default_factory=lambda: np.zeros(POSE_SIZE))

    def __deepcopy__(self, memo: dict) -> "Plan":
        """Returns itself: Drake copies the state at every update, and a plan never changes."""
        return self

    @property
    def nominal_state(self) -> np.ndarray:
        """Optimised nominal initial state xhat_k (n,)."""
        return self.states[0]

    @property
    def nominal_next(self) -> np.ndarray:
        """Nominal successor xbar_{k+1} (n,)."""
        return self.states[1]

    @property
    def nominal_input(self) -> np.ndarray:
        """Nominal input ubar_k (m,) [pwm]."""
        return self.inputs[0]


def idle_plan(problem: TrackingProblem) -> Plan:
    """Returns the plan before the first solve: at the origin, wheels at rest."""
    data = data_at_rest(problem)
    states = np.zeros((problem.horizon + 1, problem.model.num_states))
    return Plan(-1, SolveStatus.STOPPING, "no solve yet", states, data.input_lower, data)


def warm_start(problem: TrackingProblem, previous: Plan, state: np.ndarray) -> np.ndarray:
    """Returns the decision vector that the next solve begins from: the plan moved on."""
    if previous.status is SolveStatus.STOPPING:
        return shift(problem, state, previous.inputs)
    return shift(problem, previous.nominal_next, previous.inputs)


def next_plan(
    problem: TrackingProblem,
    previous: Plan,
    data: TrackingData,
    solution: NmpcSolution,
    applied_input: np.ndarray,
) -> Plan:
    """Returns the plan of a sample: the solution, or its documented fallback.

    After a failed solve the previous plan is moved on by one sample, at most ``MAX_SHIFTS``
    times in a row. From then on the wheels ramp to zero within the rate limit, from the last
    applied input, and the nominal state follows the measurement, so that the ancillary law adds
    nothing. The first solve that succeeds ends the fallback. The tube goes on growing as if the
    ancillary law acted; it centres the box anew at the next solve.

    Args:
        problem: The problem.
        previous: The plan of the sample before.
        data: The sample's problem data.
        solution: What the solver gave.
        applied_input: (m,) [pwm] what the wheels were last told.
    """
    failures = 0 if solution.success else previous.failures + 1
    states = None
    if solution.success:
        status, states, inputs = _status(solution), solution.states, solution.inputs
    elif failures <= MAX_SHIFTS and previous.status is not SolveStatus.STOPPING:
        status = SolveStatus.SHIFTED
        x0, inputs = split(problem, warm_start(problem, previous, data.state))
    else:
        status = SolveStatus.STOPPING
        measured = np.all(np.isfinite(data.state))
        x0 = data.state if measured else previous.nominal_next
        # Once begun, the ramp goes on from itself: what is applied may be rounded up again.
        begun = previous.status is SolveStatus.STOPPING and previous.sample >= 0
        inputs = _ramp_to_zero(problem, previous.nominal_input if begun else applied_input)
    if states is None:
        states = problem.model.roll_out(x0, inputs, problem.period)
    return Plan(
        previous.sample + 1,
        status,
        solution.message,
        states,
        inputs,
        data,
        failures,
        solution.cost,
        solution.iterations,
        solution.solve_time,
        solution.preparation_time,
    )


def _status(solution: NmpcSolution) -> SolveStatus:
    if solution.relaxed:
        return SolveStatus.RELAXED_EARLY if solution.early else SolveStatus.RELAXED
    return SolveStatus.EARLY if solution.early else SolveStatus.SOLVED


def _ramp_to_zero(problem: TrackingProblem, applied_input: np.ndarray) -> np.ndarray:
    command = np.nan_to_num(applied_input, nan=0.0, posinf=0.0, neginf=0.0)
    inputs = np.empty((problem.horizon, problem.model.num_inputs))
    for i in range(problem.horizon):
        command = slew(command, np.zeros_like(command), problem.rate_limit)
        inputs[i] = command
    return inputs
