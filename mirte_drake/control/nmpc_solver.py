"""The solvers of the optimal control problem by name."""

from typing import Protocol

import numpy as np

from mirte_drake.control.nmpc_program import BY_PROGRAM, NmpcProgram
from mirte_drake.control.nmpc_solution import NmpcSolution
from mirte_drake.control.realtime_nmpc import RealtimeNmpc
from mirte_drake.control.tracking_problem import TrackingData, TrackingProblem

# Optimality tolerance of each; one real-time iteration has none.
TOLERANCES = {"realtime": 0.0, "converged": 1e-8, "snopt": 1e-6, "ipopt": 1e-6}
SOLVERS = tuple(TOLERANCES)


class NmpcSolver(Protocol):
    """What solves a ``TrackingProblem``, sample by sample."""

    def solve(self, data: TrackingData, guess: np.ndarray) -> NmpcSolution:
        """Solves the problem of one sample, beginning from a decision vector (size,)."""

    def prepare(self, guess: np.ndarray) -> None:
        """Does what can be done for the next solve before its measurement arrives."""


def make_nmpc_solver(
    problem: TrackingProblem,
    solver: str,
    *,
    tolerance: float | None = None,
    time_limit: float = 5.0,
) -> NmpcSolver:
    """Returns a solver.

    Args:
        problem: The problem.
        solver: "realtime" for one iteration per sample, "converged", "snopt" or "ipopt".
        tolerance: Optimality tolerance; None: that of ``TOLERANCES``.
        time_limit: [s] After it "realtime" and "converged" return the best iterate, the others
            fail.

    Raises:
        ValueError: for an unknown solver.
    """
    if solver not in SOLVERS:
        raise ValueError(f"solver: must be one of {', '.join(SOLVERS)}, got {solver!r}")
    tolerance = TOLERANCES[solver] if tolerance is None else tolerance
    if solver in BY_PROGRAM:
        return NmpcProgram(problem, solver=solver, tolerance=tolerance, time_limit=time_limit)
    most = 1 if solver == "realtime" else 100
    return RealtimeNmpc(problem, max_iterations=most, tolerance=tolerance, time_limit=time_limit)
