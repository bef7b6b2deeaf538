"""What every solver of the optimal control problem returns."""

import dataclasses as dc
import time

import numpy as np

from mirte_drake.control.tracking_problem import PosedProblem, TrackingProblem, split


@dc.dataclass(frozen=True)
class NmpcSolution:
    """What one solve gave; ``success`` tells whether the rest may be used."""

    success: bool
    # Empty, or why it failed, or what was given up: the rate of a move, or the optimum.
    message: str
    states: np.ndarray  # (N + 1, n) xhat_k, xbar_{k+1}, ...
    inputs: np.ndarray  # (N, m) [pwm]
    cost: float
    # Quadratic programs, or of MathematicalProgram the evaluations of cost and gradient.
    iterations: int
    solve_time: float  # [s] wall clock, preparation included.
    preparation_time: float = 0.0  # [s] of it, spent before the measurement arrived.
    relaxed: bool = False  # Bounds asked for a faster move than the rate limit allows.
    early: bool = False  # Ended before the optimum, with the best iterate.

    @property
    def initial_state(self) -> np.ndarray:
        """Optimised nominal initial state xhat_k (n,)."""
        return self.states[0]


def solution_at(
    problem: TrackingProblem,
    posed: PosedProblem | None,
    z: np.ndarray,
    *,
    start: float,
    cost: float = np.nan,
    iterations: int = 0,
    message: str = "",
) -> NmpcSolution:
    """Returns the solution with the decision vector z; its states are rolled out here.

    Args:
        problem: The problem.
        posed: The sample's; None where it could not be posed.
        z: (size,)
        start: [s] of ``time.perf_counter`` when the solve began.
        cost: At z.
        iterations: So many were done.
        message: Why the solve failed, or empty.
    """
    x0, inputs = split(problem, z)
    states = problem.model.roll_out(x0, inputs, problem.period)
    if not np.all(np.isfinite(states)):
        message = message or "solution not finite"
    return NmpcSolution(
        success=not message,
        message=message or (posed.note if posed else ""),
        states=states,
        inputs=inputs,
        cost=cost,
        iterations=iterations,
        solve_time=time.perf_counter() - start,
        relaxed=posed is not None and posed.relaxed,
    )
