"""What every solver of the optimal control problem returns."""

import dataclasses as dc

import numpy as np


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
