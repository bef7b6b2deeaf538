"""The optimal control problem (4-9) as a MathematicalProgram for SNOPT and IPOPT."""

import dataclasses as dc
import time

import numpy as np
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, ExtractValue
from pydrake.solvers import (
    IpoptSolver,
    MathematicalProgram,
    MathematicalProgramResult,
    SnoptSolver,
    SolverOptions,
)

from mirte_drake.control.tracking_problem import (
    TrackingData,
    TrackingProblem,
    bounds,
    cost_and_gradient,
    gauss_newton_hessian,
    join,
    rate_bounds,
    rate_matrix,
    split,
)

SOLVERS = ("snopt", "ipopt")


@dc.dataclass(frozen=True)
class NmpcSolution:
    """What one solve gave; ``success`` tells whether the rest may be used."""

    success: bool
    message: str  # Empty on success, else the reason.
    initial_state: np.ndarray  # (n,) xhat_k.
    inputs: np.ndarray  # (N, m) [pwm]
    cost: float
    iterations: int  # Evaluations of cost and gradient.
    solve_time: float  # [s] wall clock.


class NmpcProgram:
    """The program of one ``TrackingProblem``, built once and re-parametrised per sample.

    Each ``solve`` overwrites everything that affects its result, so one object may serve many
    Contexts, one after the other.
    """

    def __init__(
        self,
        problem: TrackingProblem,
        *,
        solver: str = "snopt",
        tolerance: float = 1e-6,
        time_limit: float = 5.0,
    ) -> None:
        """Builds the program.

        Args:
            problem: The problem.
            solver: "snopt" or "ipopt".
            tolerance: Optimality tolerance of the solver.
            time_limit: [s] A solve that takes longer has failed.

        Raises:
            ValueError: for an unknown solver.
        """
        if solver not in SOLVERS:
            raise ValueError(f"solver: must be one of {', '.join(SOLVERS)}, got {solver!r}")
        self._problem, self._time_limit, self._deadline = problem, time_limit, np.inf
        self._time_limit_message = f"time limit of {time_limit} s exceeded"
        self._data: TrackingData | None = None
        self._scaling = np.eye(problem.size)
        self._evaluations = 0
        self._interrupted = False
        self._rate_matrix = rate_matrix(problem)
        self._program = MathematicalProgram()
        y = self._program.NewContinuousVariables(problem.size, "y")
        rows = problem.size + len(self._rate_matrix)
        unlimited = np.full(rows, np.inf)
        self._constraint = self._program.AddLinearConstraint(
            np.zeros((rows, y.size)), -unlimited, unlimited, y
        )
        self._program.AddCost(self._evaluate, vars=y)
        self._solver = SnoptSolver() if solver == "snopt" else IpoptSolver()
        self._options = _options(solver, self._solver.solver_id(), tolerance, y.size)

    def solve(self, data: TrackingData, guess: np.ndarray) -> NmpcSolution:
        """Solves the problem of one sample.

        Args:
            data: The sample's problem data.
            guess: (size,) Decision vector to begin from; moved into the bounds.
        """
        start = time.perf_counter()
        self._interrupted = False
        self._evaluations, self._deadline = 0, start + self._time_limit
        lower, upper = bounds(data)
        message, z, value = "measurement or problem data not finite", guess, np.nan
        if data.is_finite() and np.all(np.isfinite(guess)):
            try:
                result = self._solve(data, np.clip(guess, lower, upper), lower, upper)
            except (ValueError, RuntimeError) as error:  # LinAlgError is a ValueError.
                if self._interrupted:  # SNOPT makes a failed solve of Ctrl-C.
                    raise KeyboardInterrupt from None
                message = f"solver broke off: {error}"
            else:
                z, value = self._scaling @ result.get_x_val(), result.get_optimal_cost()
                message = "" if result.is_success() else _reason(result)
                if not np.all(np.isfinite(z)):
                    message = message or "solution not finite"
        solve_time = time.perf_counter() - start
        if solve_time > self._time_limit:
            message = self._time_limit_message
        # Solvers meet bounds within their tolerance; the tube and the input set ask for exactly.
        x0, inputs = split(self._problem, np.clip(z, lower, upper))
        return NmpcSolution(not message, message, x0, inputs, value, self._evaluations, solve_time)

    def _solve(
        self, data: TrackingData, guess: np.ndarray, lower: np.ndarray, upper: np.ndarray
    ) -> MathematicalProgramResult:
        """Solves in scaled variables y, with z = L y and L L' the inverse Gauss-Newton Hessian.

        The cost is then nearly |y|^2 / 2, and the quasi-Newton solvers need ten evaluations where
        they took two hundred in z.
        """
        self._data = data
        factor = np.linalg.cholesky(gauss_newton_hessian(self._problem, data, guess))
        self._scaling = np.linalg.inv(factor).T
        if not np.all(np.isfinite(self._scaling)):  # Drake ends the process on such coefficients.
            raise ValueError("problem too badly scaled")
        rate_lower, rate_upper = rate_bounds(self._problem, data)
        self._constraint.evaluator().UpdateCoefficients(
            np.vstack([self._scaling, self._rate_matrix @ self._scaling]),
            np.concatenate([lower, rate_lower]),
            np.concatenate([upper, rate_upper]),
        )
        return self._solver.Solve(self._program, factor.T @ guess, self._options)

    def _evaluate(self, y: np.ndarray) -> object:
        try:
            return self._cost(y)
        except KeyboardInterrupt:
            self._interrupted = True
            raise

    def _cost(self, y: np.ndarray) -> object:
        self._evaluations += 1
        # The solvers' own limits are looked at too rarely (SNOPT) or once per iteration (IPOPT).
        if time.perf_counter() > self._deadline:
            raise RuntimeError(self._time_limit_message)
        assert self._data is not None
        if y.dtype == object:
            z = self._scaling @ ExtractValue(y).ravel()
            value, gradient = cost_and_gradient(self._problem, self._data, z)
            return AutoDiffXd(value, gradient @ self._scaling @ ExtractGradient(y))
        return cost_and_gradient(self._problem, self._data, self._scaling @ y)[0]


def shift(problem: TrackingProblem, initial_state: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Returns a plan moved on by one sample, the last input repeated, as decision vector.

    Args:
        problem: The problem.
        initial_state: (n,) the state after the plan's first sample.
        inputs: (N, m) the plan's inputs.
    """
    assert len(inputs) == problem.horizon
    return join(initial_state, np.vstack([inputs[1:], inputs[-1:]]))


def _options(solver: str, solver_id: object, tolerance: float, size: int) -> SolverOptions:
    options = SolverOptions()
    if solver == "snopt":
        settings: dict[str, object] = {"Major optimality tolerance": tolerance}
    else:
        settings = {
            "tol": tolerance,
            "acceptable_tol": tolerance,  # A loose one returns bad points as success.
            "limited_memory_max_history": size,
            "print_level": 0,
        }
    for name, value in settings.items():
        options.SetOption(solver_id, name, value)
    return options


def _reason(result: MathematicalProgramResult) -> str:
    return f"{result.get_solver_id().name()}: {result.get_solution_result().name}"
