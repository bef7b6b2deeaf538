"""The solvers of the optimal control problem (4-9) by name."""

from typing import Protocol

import numpy as np

from mirte_drake.control.nmpc_program import SOLVERS, NmpcProgram, NmpcSolution
from mirte_drake.control.tracking_problem import TrackingData, TrackingProblem

__all__ = ["SOLVERS", "NmpcSolution", "NmpcSolver", "make_nmpc_solver"]


class NmpcSolver(Protocol):
    """Whatever solves the problem of one sample."""

    def solve(self, data: TrackingData, guess: np.ndarray) -> NmpcSolution:
        """Solves the problem of one sample, beginning from a decision vector (size,)."""


def make_nmpc_solver(
    problem: TrackingProblem, solver: str, *, tolerance: float = 1e-6, time_limit: float = 5.0
) -> NmpcSolver:
    """Returns the solver of a name out of ``SOLVERS``.

    Raises:
        ValueError: for an unknown name.
    """
    return NmpcProgram(problem, solver=solver, tolerance=tolerance, time_limit=time_limit)
