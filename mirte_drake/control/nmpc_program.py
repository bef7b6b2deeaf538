"""The optimal control problem (4-9) as a MathematicalProgram for SNOPT and IPOPT."""

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

from mirte_drake.control.nmpc_solution import NmpcSolution, solution_at
from mirte_drake.control.tracking_problem import (
    PosedProblem,
    TrackingData,
    TrackingProblem,
    cost_and_gradient,
    data_at_rest,
    gauss_newton_hessian,
    pose,
    rate_matrix,
    split,
)
from mirte_drake.model.term_table import dense

BY_PROGRAM = ("snopt", "ipopt")


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
        """
        assert solver in BY_PROGRAM
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
        # Compiles here what is not compiled yet: no solve has to wait for it.
        at_rest, z = data_at_rest(problem), np.zeros(problem.size)
        gauss_newton_hessian(problem, pose(problem, at_rest).project(z))
        cost_and_gradient(problem, at_rest, z)
        problem.model.roll_out(*split(problem, z), problem.period)

    def prepare(self, guess: np.ndarray) -> None:
        """These solvers have nothing to prepare."""

    def solve(self, data: TrackingData, guess: np.ndarray) -> NmpcSolution:
        """Solves the problem of one sample.

        Args:
            data: The sample's problem data.
            guess: (size,) Decision vector to begin from; moved into the bounds.
        """
        start = time.perf_counter()
        self._interrupted = False
        self._evaluations, self._deadline = 0, start + self._time_limit
        guess = dense(guess)
        z, posed, value, message = guess, None, np.nan, ""
        try:
            posed = pose(self._problem, data, guess)
            result = self._solve(posed, guess)
        except (ValueError, RuntimeError) as error:  # LinAlgError is a ValueError.
            if self._interrupted:  # SNOPT makes a failed solve of Ctrl-C.
                raise KeyboardInterrupt from None
            message = str(error)
        else:
            value, message = result.get_optimal_cost(), _reason(result)
            # Solvers meet bounds within their tolerance; the tube and the input set exactly.
            z = posed.project(self._scaling @ result.get_x_val())
        if time.perf_counter() - start > self._time_limit:
            message = self._time_limit_message
        return solution_at(
            self._problem,
            posed,
            z,
            start=start,
            cost=value,
            iterations=self._evaluations,
            message=message,
        )

    def _solve(self, posed: PosedProblem, guess: np.ndarray) -> MathematicalProgramResult:
        """Solves in scaled variables y, with z = L y and L L' the inverse Gauss-Newton Hessian.

        The cost is then nearly |y|^2 / 2, and the quasi-Newton solvers need ten evaluations where
        they took two hundred in z.
        """
        self._data = posed.data
        guess = posed.project(guess)
        factor = np.linalg.cholesky(gauss_newton_hessian(self._problem, guess))
        self._scaling = np.linalg.inv(factor).T
        if not np.all(np.isfinite(self._scaling)):  # Drake ends the process on such coefficients.
            raise ValueError("problem too badly scaled")
        self._constraint.evaluator().UpdateCoefficients(
            np.vstack([self._scaling, self._rate_matrix @ self._scaling]),
            posed.least,
            posed.most,
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
    """Returns why a solve failed, or nothing."""
    if result.is_success():
        return ""
    return f"{result.get_solver_id().name()}: {result.get_solution_result().name}"
