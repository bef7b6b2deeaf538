"""What a solution is worth, computed alike for every solver."""

from collections.abc import Sequence

import numpy as np

from mirte_drake.control.nmpc_solution import NmpcSolution
from mirte_drake.control.tracking_problem import (
    TrackingData,
    TrackingProblem,
    cost_and_gradient,
    join,
    pose,
)

# A solution may exceed its rate constraints by this much and still serve as the optimum [pwm].
FEASIBLE = 1e-9


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


def evaluate(
    problem: TrackingProblem, data: Sequence[TrackingData], solutions: Sequence[NmpcSolution]
) -> tuple[np.ndarray, np.ndarray]:
    """Returns costs and rate violations [pwm], both (R, P), NaN where a solve failed.

    Args:
        problem: The problem.
        data: (P,) Of the samples.
        solutions: (R P,) R rounds over the samples.
    """
    values = np.full((2, len(solutions)), np.nan)
    for index, solution in enumerate(solutions):
        if solution.success:
            sample = data[index % len(data)]
            values[0, index] = true_cost(problem, sample, solution)
            values[1, index] = rate_violation(problem, sample, solution)
    cost, violation = values.reshape(2, -1, len(data))
    return cost, violation


def lowest_cost(cost: np.ndarray, violation: np.ndarray) -> np.ndarray:
    """Returns the lowest cost (P,) within the rates over rounds (R, P), else infinity."""
    return np.min(np.where(violation <= FEASIBLE, cost, np.inf), axis=0)
