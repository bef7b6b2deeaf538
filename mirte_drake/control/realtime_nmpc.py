"""The optimal control problem (4-9) by sequential quadratic programming in real time.

States are eliminated (condensed): x0 and the inputs remain, and all constraints are linear in
them, so every iterate is feasible and any iterate can be driven with. The Hessian is
Gauss-Newton's, which near the reference is all it takes.
"""

import time
from typing import NamedTuple

import numpy as np

from mirte_drake.control import tracking_kernels
from mirte_drake.control.curvature import convex_hessian
from mirte_drake.control.nmpc_solution import NmpcSolution, solution_at
from mirte_drake.control.quadratic_program import QuadraticProgram
from mirte_drake.control.tracking_problem import (
    PosedProblem,
    TrackingData,
    TrackingProblem,
    data_at_rest,
    pose,
    rate_matrix,
)
from mirte_drake.model.term_table import dense
from mirte_drake.vectors import POSE

CONTRACTION = 0.03  # A Hessian is kept while each step promises less than this of the last one.
SLOW = 0.1  # Steps that promise more than this of the last one converge slowly.
# [m, rad] Where the optimum stays farther than this from a reference, what Gauss-Newton's Hessian
# leaves out, which is proportional to the error, can make a saddle look like a minimum.
FAR = 0.2
# A saddle is left by doubling steps: they may begin this much smaller, and take this many. A valley
# that is flat at its bottom never gets there.
SADDLE, PATIENCE = 1e-4, 40
SMALLEST_STEP = 2.0**-10  # Of the line search.
ROUNDING = 1e-12  # Of a cost, relative.
TINY = 1e-16  # Cost, in terms of the largest weight: 1e-8 m or rad.
RATE_TOLERANCE = 1e-12  # [pwm] Rounding of a move.


class _Linearisation(NamedTuple):
    """States and their sensitivities at a decision vector, and how long they took [s]."""

    z: np.ndarray
    states: np.ndarray
    jacobians: np.ndarray
    duration: float


class _Iterate(NamedTuple):
    """A decision vector and its cost; without jacobians the gradient means nothing."""

    z: np.ndarray
    states: np.ndarray
    jacobians: np.ndarray
    cost: float
    gradient: np.ndarray


class RealtimeNmpc:
    """Solves a ``TrackingProblem``, built once and re-parametrised per sample.

    What does not need the measurement can be done before it arrives: see ``prepare``. Each
    ``solve`` gives the same result with and without it, so one object may serve many Contexts.
    """

    def __init__(
        self,
        problem: TrackingProblem,
        *,
        max_iterations: int = 100,
        tolerance: float = 1e-8,
        time_limit: float = 5.0,
    ) -> None:
        """Builds the solver.

        Args:
            problem: The problem.
            max_iterations: Quadratic programs per solve; 1 is the real-time iteration (Diehl,
                Bock, Schloeder 2005), which follows the optimum from sample to sample.
            tolerance: A solve ends when a step promises to lower the cost by less than this part.
            time_limit: [s] After that a solve ends with the best iterate so far; it has at least
                one.
        """
        self._problem, self._tolerance, self._time_limit = problem, tolerance, time_limit
        self._max_iterations = max_iterations
        self._rate_matrix = rate_matrix(problem)
        # Costs are taken relative to the largest weight, so that no tolerance depends on the unit.
        self._scale = max(np.abs(weight).max() for weight in problem.weights)
        self._weights = tuple(weight / self._scale for weight in problem.weights)
        self._num_states = problem.model.num_states
        self._stages = problem.horizon, problem.model.num_inputs
        self._no_jacobians = np.zeros((0, self._num_states, 0))
        self._prepared: _Linearisation | None = None
        self._reset()
        # Compiles here what is not compiled yet: no later solve has to wait for it.
        self.solve(data_at_rest(problem), np.zeros(problem.size))
        solution_at(problem, None, np.zeros(problem.size), start=0.0)
        self._reset()

    def prepare(self, guess: np.ndarray) -> None:
        """Linearises and factorises at the decision vector that the next solve begins from.

        Args:
            guess: (size,) finite.
        """
        guess = dense(guess)
        if not self._is_prepared(guess):
            try:
                self._linearise(guess)
            except ValueError:  # The solve will say so.
                self._reset()

    def _linearise(self, guess: np.ndarray) -> None:
        start = time.perf_counter()
        self._prepared = None  # Until everything holds.
        states, jacobians = self._problem.model.roll_out_jacobians(
            *self._split(guess), self._problem.period
        )
        self._set_hessian(self._gauss_newton_hessian(jacobians))
        duration = time.perf_counter() - start
        self._prepared = _Linearisation(guess.copy(), states, jacobians, duration)

    def solve(self, data: TrackingData, guess: np.ndarray) -> NmpcSolution:
        """Solves the problem of one sample.

        Args:
            data: The sample's problem data.
            guess: (size,) Decision vector to begin from; it need not be feasible.
        """
        start, guess = time.perf_counter(), dense(guess)
        ahead = self._prepared if self._is_prepared(guess) else None
        preparation = ahead.duration if ahead else 0.0
        try:
            posed = pose(self._problem, data, guess)
            if ahead is None:
                self._linearise(guess)
            iterate, iterations, gave_up = self._iterate(posed, start)
            if not np.isfinite(iterate.cost):
                raise ValueError("solution not finite")
        except ValueError as error:
            self._reset()  # Nothing that is not finite may survive.
            return solution_at(self._problem, None, guess, start=start, message=str(error))
        return NmpcSolution(
            success=True,
            message="; ".join(filter(None, (posed.note, gave_up))),
            states=iterate.states,
            inputs=self._split(iterate.z)[1],
            cost=iterate.cost * self._scale,
            iterations=iterations,
            solve_time=preparation + time.perf_counter() - start,
            preparation_time=preparation,
            relaxed=posed.relaxed,
            early=bool(gave_up),
        )

    def _is_prepared(self, guess: np.ndarray) -> bool:
        return self._prepared is not None and bool((guess == self._prepared.z).all())

    def _iterate(self, posed: PosedProblem, start: float) -> tuple[_Iterate, int, str]:
        """Returns the last iterate, how many there were, and why it is not the optimum."""
        assert self._prepared is not None
        z, states, jacobians, _ = self._prepared
        iterate = self._weigh(posed, z, states, jacobians)
        # The active sets may be those of another Context.
        self._without_rates.forget()
        self._with_rates.forget()
        step, promise, multipliers = self._solve_qp(posed, iterate)
        iterate = self._advance(posed, iterate, step)
        if self._max_iterations == 1:
            return iterate, 1, ""
        self._prepared, last_promise, second_order = None, 0.0, False
        for iteration in range(2, self._max_iterations + 1):
            if time.perf_counter() - start > self._time_limit:
                return iterate, iteration - 1, f"time limit of {self._time_limit:g} s reached"
            second_order |= iteration > 3 and promise > SLOW * last_promise
            try:
                if second_order:
                    self._set_hessian(self._full_hessian(posed, iterate, multipliers))
                elif promise > CONTRACTION * last_promise:
                    self._set_hessian(self._gauss_newton_hessian(iterate.jacobians))
                last_promise = promise
                step, promise, multipliers = self._solve_qp(posed, iterate)
            except ValueError as error:
                self._reset()
                return iterate, iteration - 1, str(error)
            patient = second_order and iteration < PATIENCE
            tolerance = self._tolerance * (SADDLE if patient else 1.0)
            last_cost = iterate.cost
            iterate = self._advance(posed, iterate, step)
            converged = promise <= tolerance * last_cost + TINY
            converged |= iterate.cost >= last_cost * (1.0 - ROUNDING)
            if converged and (second_order or not self._is_far(posed, iterate)):
                return iterate, iteration, ""
            second_order |= converged
        return iterate, iteration, f"not converged in {self._max_iterations} iterations"

    def _is_far(self, posed: PosedProblem, iterate: _Iterate) -> bool:
        return np.abs(iterate.states[1:, POSE] - posed.references).max() > FAR

    def _advance(self, posed: PosedProblem, iterate: _Iterate, step: np.ndarray) -> _Iterate:
        """Returns the iterate a step further, or nearer where the whole step costs more."""
        end = self._evaluate(posed, iterate.z + step)
        if end.cost <= iterate.cost * (1.0 + ROUNDING) + TINY:
            return end
        base, fraction = self._evaluate(posed, iterate.z), 1.0
        while end.cost > base.cost and fraction > SMALLEST_STEP:
            fraction *= 0.5
            end = self._evaluate(posed, 0.5 * (base.z + end.z))
        return end if end.cost <= base.cost else base

    def _evaluate(self, posed: PosedProblem, z: np.ndarray) -> _Iterate:
        """Returns the iterate at the decision vector near z that meets every constraint."""
        return self._roll_out(posed, posed.project(z))

    def _roll_out(self, posed: PosedProblem, z: np.ndarray) -> _Iterate:
        model, (x0, inputs) = self._problem.model, self._split(z)
        if self._max_iterations == 1:
            states, jacobians = model.roll_out(x0, inputs, self._problem.period), self._no_jacobians
        else:
            states, jacobians = model.roll_out_jacobians(x0, inputs, self._problem.period)
        return self._weigh(posed, z, states, jacobians)

    def _split(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return z[: self._num_states], z[self._num_states :].reshape(self._stages)

    def _weigh(
        self, posed: PosedProblem, z: np.ndarray, states: np.ndarray, jacobians: np.ndarray
    ) -> _Iterate:
        cost, gradient = tracking_kernels.cost_and_gradient(
            states,
            jacobians,
            self._split(z)[1],
            posed.references,
            posed.data.previous_input,
            *self._weights,
        )
        return _Iterate(z, states, jacobians, cost, gradient)

    def _solve_qp(
        self, posed: PosedProblem, iterate: _Iterate
    ) -> tuple[np.ndarray, float, np.ndarray]:
        """Returns the step, by how much it lowers the quadratic model, and the multipliers.

        Rates take most of the work and are seldom active: a solution without them that meets
        them is the solution.

        Raises:
            ValueError: when the quadratic program is not solved.
        """
        z, size, m = iterate.z, len(iterate.z), self._stages[1]
        bounds = posed.least[:size] - z, posed.most[:size] - z
        step, promise, multipliers = self._without_rates.solve(iterate.gradient, *bounds)
        if tracking_kernels.meets_rates(z + step, posed.least, posed.most, m, RATE_TOLERANCE):
            return step, promise, multipliers
        values = np.concatenate([z, self._rate_matrix @ z])
        self._with_rates.set_hessian(self._hessian)
        return self._with_rates.solve(iterate.gradient, posed.least - values, posed.most - values)

    def _set_hessian(self, hessian: np.ndarray) -> None:
        self._hessian = hessian
        self._without_rates.set_hessian(hessian)

    def _gauss_newton_hessian(self, jacobians: np.ndarray) -> np.ndarray:
        return tracking_kernels.condense(jacobians, *self._weights)

    def _full_hessian(
        self, posed: PosedProblem, iterate: _Iterate, multipliers: np.ndarray
    ) -> np.ndarray:
        rows = np.flatnonzero(multipliers)
        constraints = np.vstack([np.eye(len(iterate.z)), self._rate_matrix])
        return convex_hessian(
            lambda z: self._roll_out(posed, z).gradient,
            iterate.z,
            constraints[rows],
            multipliers[rows],
        )

    def _reset(self) -> None:
        self._prepared = None
        self._hessian = np.eye(self._problem.size)
        self._without_rates = QuadraticProgram(np.zeros((0, self._problem.size)))
        self._with_rates = QuadraticProgram(self._rate_matrix)
