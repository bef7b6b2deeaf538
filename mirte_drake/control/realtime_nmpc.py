"""The optimal control problem (4-9) by sequential quadratic programming in real time.

States are eliminated (condensed): x0 and the inputs remain, and all constraints are linear in
them, so every iterate is feasible and any iterate can be driven with. The Hessian is
Gauss-Newton's. A dual active-set solver (DAQP) solves each quadratic program.
"""

import time
from typing import NamedTuple

import daqp
import numpy as np

from mirte_drake.control import tracking_kernels
from mirte_drake.control.nmpc_solution import NmpcSolution
from mirte_drake.control.tracking_problem import (
    PosedProblem,
    TrackingData,
    TrackingProblem,
    pose,
    rate_matrix,
    split,
)

CONTRACTION = 0.03  # A Hessian is kept while each step promises less than this of the last one.
SMALLEST_STEP = 2.0**-10  # Of the line search.
ROUNDING = 1e-12  # Of the cost, relative and absolute.
PRIMAL_TOLERANCE = 1e-9  # [m, rad, pwm] Of a constraint in the quadratic programs.
SOLVED = 1  # DAQP's exit flag.


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
        self._inactive = np.zeros(problem.size + len(self._rate_matrix), dtype=np.int32)
        self._no_jacobians = np.zeros((0, problem.model.num_states, 0))
        self._reset()

    def prepare(self, guess: np.ndarray) -> None:
        """Linearises and factorises at the decision vector that the next solve begins from.

        Args:
            guess: (size,) finite.
        """
        if self._prepared is not None and (guess == self._prepared.z).all():
            return
        start = time.perf_counter()
        self._prepared = None  # Until everything holds.
        states, jacobians = self._problem.model.roll_out_jacobians(
            *split(self._problem, guess), self._problem.period
        )
        self._set_hessian(jacobians)
        duration = time.perf_counter() - start
        self._prepared = _Linearisation(guess.copy(), states, jacobians, duration)

    def solve(self, data: TrackingData, guess: np.ndarray) -> NmpcSolution:
        """Solves the problem of one sample.

        Args:
            data: The sample's problem data.
            guess: (size,) Decision vector to begin from; it need not be feasible.
        """
        start = time.perf_counter()
        try:
            if not tracking_kernels.all_finite(guess):
                raise ValueError("guess not finite")
            posed = pose(self._problem, data)
            iterate, iterations, gave_up = self._iterate(posed, guess, start)
            if not np.isfinite(iterate.cost):
                raise ValueError("solution not finite")
        except ValueError as error:
            self._reset()  # Nothing that is not finite may survive.
            return self._failure(str(error), guess, time.perf_counter() - start)
        return NmpcSolution(
            success=True,
            message="; ".join(filter(None, (posed.note, gave_up))),
            states=iterate.states,
            inputs=split(self._problem, iterate.z)[1],
            cost=iterate.cost,
            iterations=iterations,
            solve_time=time.perf_counter() - start,
            relaxed=posed.relaxed,
            early=bool(gave_up),
        )

    def _iterate(
        self, posed: PosedProblem, guess: np.ndarray, start: float
    ) -> tuple[_Iterate, int, str]:
        """Returns the last iterate, how many there were, and why it is not the optimum."""
        self.prepare(guess)
        assert self._prepared is not None
        z, states, jacobians, _ = self._prepared
        iterate = self._weigh(posed, z, states, jacobians)
        # A solve does not inherit the active set of the one before, which may be another Context's.
        step, promise = self._solve_qp(posed, iterate, self._inactive)
        iterate = self._advance(posed, iterate, step)
        if self._max_iterations == 1:
            return iterate, 1, ""
        self._prepared, last_promise = None, 0.0
        for iteration in range(2, self._max_iterations + 1):
            if time.perf_counter() - start > self._time_limit:
                return iterate, iteration - 1, f"time limit of {self._time_limit:g} s reached"
            if promise > CONTRACTION * last_promise:
                self._set_hessian(iterate.jacobians)
            last_promise = promise
            step, promise = self._solve_qp(posed, iterate)
            converged = promise <= self._tolerance * iterate.cost + ROUNDING
            iterate = self._advance(posed, iterate, step)
            if converged:
                return iterate, iteration, ""
        return iterate, iteration, f"not converged in {self._max_iterations} iterations"

    def _advance(self, posed: PosedProblem, iterate: _Iterate, step: np.ndarray) -> _Iterate:
        """Returns the iterate a step further, or nearer where the whole step costs more."""
        end = self._evaluate(posed, iterate.z + step)
        if end.cost <= iterate.cost * (1.0 + ROUNDING) + ROUNDING:
            return end
        base, fraction = self._evaluate(posed, iterate.z), 1.0
        while end.cost > base.cost and fraction > SMALLEST_STEP:
            fraction *= 0.5
            end = self._evaluate(posed, 0.5 * (base.z + end.z))
        return end if end.cost <= base.cost else base

    def _evaluate(self, posed: PosedProblem, z: np.ndarray) -> _Iterate:
        """Returns the iterate at the decision vector near z that meets every constraint."""
        z = posed.project(z)
        model, (x0, inputs) = self._problem.model, split(self._problem, z)
        if self._max_iterations == 1:
            states, jacobians = model.roll_out(x0, inputs, self._problem.period), self._no_jacobians
        else:
            states, jacobians = model.roll_out_jacobians(x0, inputs, self._problem.period)
        return self._weigh(posed, z, states, jacobians)

    def _weigh(
        self, posed: PosedProblem, z: np.ndarray, states: np.ndarray, jacobians: np.ndarray
    ) -> _Iterate:
        cost, gradient = tracking_kernels.cost_and_gradient(
            states,
            jacobians,
            split(self._problem, z)[1],
            posed.references,
            posed.data.previous_input,
            *self._problem.weights,
        )
        return _Iterate(z, states, jacobians, cost, gradient)

    def _solve_qp(
        self, posed: PosedProblem, iterate: _Iterate, active: np.ndarray | None = None
    ) -> tuple[np.ndarray, float]:
        """Returns the step, and by how much it lowers the quadratic model of the cost.

        Args:
            posed: The problem.
            iterate: Where the step begins.
            active: Constraints that the solver begins with; None: those of its last program.

        Raises:
            ValueError: when the quadratic program is not solved.
        """
        values = np.concatenate([iterate.z, self._rate_matrix @ iterate.z])
        flag = self._qp.update(
            f=iterate.gradient,
            bupper=posed.most - values,
            blower=posed.least - values,
            sense=active,
        )
        if flag == 0:
            step, value, flag, _ = self._qp.solve()
        if flag != SOLVED:
            raise ValueError(f"quadratic program not solved: DAQP's exit flag is {flag}")
        return step, -value

    def _set_hessian(self, jacobians: np.ndarray) -> None:
        hessian = tracking_kernels.condense(jacobians, *self._problem.weights)
        if self._qp.update(H=hessian) != 0:
            raise ValueError("Gauss-Newton Hessian is not positive definite")

    def _reset(self) -> None:
        size, rows = self._problem.size, len(self._inactive)
        self._prepared: _Linearisation | None = None
        self._qp = daqp.Model()
        self._qp.setup(
            np.eye(size), np.zeros(size), self._rate_matrix, np.full(rows, 1e30), np.full(rows, -1e30)
        )
        self._qp.settings = {"primal_tol": PRIMAL_TOLERANCE}

    def _failure(self, reason: str, guess: np.ndarray, solve_time: float) -> NmpcSolution:
        x0, inputs = split(self._problem, guess)
        states = self._problem.model.roll_out(x0, inputs, self._problem.period)
        return NmpcSolution(False, reason, states, inputs, np.nan, 0, solve_time)
