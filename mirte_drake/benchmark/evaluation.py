"""What a solution is worth, computed alike for every solver."""

import numpy as np

from mirte_drake.control.nmpc_solution import NmpcSolution
from mirte_drake.control.tracking_problem import (
    TrackingData,
    TrackingProblem,
    cost_and_gradient,
    join,
    pose,
)


def rate_limits(problem: TrackingProblem, data: TrackingData) -> np.ndarray:
    """Returns the largest moves (N, m) [pwm] of a sample's inputs, from stage to stage."""
    return pose(problem, data).rate


def true_cost(problem: TrackingProblem, data: TrackingData, solution: NmpcSolution) -> float:
    """Returns the cost (4-9) of a solution's inputs, its states rolled out."""
    z = join(solution.initial_state, solution.inputs)
    return cost_and_gradient(problem, data, z)[0]


def rate_violation(problem: TrackingProblem, data: TrackingData, solution: NmpcSolution) -> float:
    """Returns by how much [pwm] a solution exceeds its rate limits, or 0."""
    moves = np.abs(np.diff(solution.inputs, axis=0, prepend=data.previous_input[None]))
    return float(max(0.0, np.max(moves - rate_limits(problem, data))))
