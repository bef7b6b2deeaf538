"""The optimal control problem (4-9) in CasADi, to compare with: multiple shooting and RK4.

The same problem as ``tracking_problem`` states it, with the states as variables beside the
inputs: x_{i+1} = RK4(x_i, u_i) are constraints, and the cost is a plain quadratic form.
"""

import time
from types import ModuleType

import numpy as np

from mirte_drake.benchmark.casadi_transcription import step_function, transcribe
from mirte_drake.control.nmpc_solution import NmpcSolution, solution_at
from mirte_drake.control.tracking_problem import (
    PosedProblem,
    TrackingData,
    TrackingProblem,
    join,
    pose,
    split,
)
from mirte_drake.errors import UserError
from mirte_drake.model.sparse_model import SparseModel

METHODS = ("casadi_ipopt", "casadi_sqp_hpipm")
CASADI_HINT = "needs the package casadi: pip install mirte-drake[benchmark]"

# Each option below was kept because the solver is slower or fails without it. Nothing is
# compiled: that is what `pip install casadi` gives.
IPOPT_OPTIONS = {
    "print_time": False,
    "ipopt.sb": "yes",
    "ipopt.print_level": 0,
    "ipopt.tol": 1e-8,
    "ipopt.bound_relax_factor": 0.0,  # The bounds as they are, at no cost.
    "ipopt.mu_init": 1e-4,  # The default 0.1 gives away the warm start: 7 iterations, not 4.
    "ipopt.warm_start_init_point": "yes",
    "ipopt.warm_start_bound_push": 1e-8,
    "ipopt.warm_start_bound_frac": 1e-8,
    "ipopt.warm_start_slack_bound_push": 1e-8,
    "ipopt.warm_start_slack_bound_frac": 1e-8,
    "ipopt.warm_start_mult_bound_push": 1e-8,
    "ipopt.mumps_permuting_scaling": 0,  # Scaling and ordering cost more than they gain in a
    "ipopt.mumps_scaling": 0,  # small and well scaled problem.
    "ipopt.mumps_pivot_order": 0,
}
SQP_OPTIONS = {
    "print_time": False,
    "print_header": False,
    "print_iteration": False,
    "print_status": False,
    "error_on_fail": False,
}
HPIPM_OPTIONS = {
    "error_on_fail": False,  # The step of a QP solved roughly is used all the same.
    "inf": 1e4,  # HPIPM has no free variables; its default 1e8 conditions them badly.
    "hpipm": {"mode": "speed", "mu0": 1.0},  # At 0.01 far-off references fail.
}


class CasadiNmpc:
    """Solves a ``TrackingProblem`` with CasADi, nothing compiled.

    "casadi_ipopt" is IPOPT with the exact Hessian. "casadi_sqp_hpipm" is CasADi's ``sqpmethod``,
    exact Hessian, with HPIPM for its QPs. HPIPM wants constraints within a stage, so that one
    carries the input of the stage before as further states.

    Unlike the controller's solvers it begins from the multipliers of its last solve, as such a
    controller would: solve the problems of a run in order.
    """

    def __init__(
        self, problem: TrackingProblem, method: str, *, tolerance: float | None = None
    ) -> None:
        """Builds the nonlinear program.

        Args:
            problem: The problem.
            method: "casadi_ipopt" or "casadi_sqp_hpipm".
            tolerance: Of the solver; None: 1e-8 for IPOPT, 1e-6 for the SQP method, which both
                put the cost within about 1e-9 of the optimum.

        Raises:
            UserError: when CasADi is not installed.
            ValueError: for an unknown method, or a model that is no SparseModel.
        """
        if method not in METHODS:
            raise ValueError(f"method: must be one of {', '.join(METHODS)}, got {method!r}")
        casadi = _import_casadi()
        if not isinstance(problem.model, SparseModel):
            raise ValueError(f"{problem.model.name}: CasADi needs a model of terms, a SparseModel")
        self._problem = problem
        ipopt = method == "casadi_ipopt"
        step = step_function(casadi, problem.model, problem.period)
        self._roll_out = step.mapaccum(problem.horizon)
        self._transcription = transcribe(casadi, problem, step, lifted=not ipopt)
        options = IPOPT_OPTIONS if ipopt else SQP_OPTIONS | _stages(problem)
        if tolerance is not None:
            names = ("ipopt.tol",) if ipopt else ("tol_pr", "tol_du")
            options = options | dict.fromkeys(names, tolerance)
        self._solver = casadi.nlpsol(
            method, "ipopt" if ipopt else "sqpmethod", self._transcription.program, options
        )
        self._forget()

    def solve(self, data: TrackingData, guess: np.ndarray) -> NmpcSolution:
        """Solves the problem of one sample.

        Args:
            data: The sample's problem data.
            guess: (size,) Decision vector to begin from.

        Returns:
            The solution; its iterations are those of IPOPT, or QPs solved.
        """
        start = time.perf_counter()
        z, posed, cost, iterations = guess, None, np.nan, 0
        try:
            posed = pose(self._problem, data, guess)
            z, cost, iterations, message = self._solve(posed, guess)
            # Solvers meet bounds within their tolerance; here they are met exactly.
            z = posed.project(z)
        except (ValueError, RuntimeError) as error:
            message = f"CasADi: {str(error).strip().splitlines()[-1]}"
        if message:
            self._forget()
        return solution_at(
            self._problem,
            posed,
            z,
            start=start,
            cost=cost,
            iterations=iterations,
            message=message,
        )

    def prepare(self, guess: np.ndarray) -> None:
        """These solvers have nothing to prepare."""

    def _forget(self) -> None:
        self._bound_multipliers = np.zeros(self._transcription.size)
        self._multipliers = np.zeros(self._transcription.num_constraints)

    def _solve(self, posed: PosedProblem, guess: np.ndarray) -> tuple[np.ndarray, float, int, str]:
        """Returns decision vector, cost, iterations, and what went wrong."""
        at = self._transcription
        data, rates = posed.data, posed.rate
        lower, upper = self._variable_bounds(data, rates[0])
        limit = np.zeros(at.num_constraints)
        limit[at.moves] = rates[1:]
        result = self._solver(
            x0=self._initial_point(guess),
            p=np.concatenate([posed.references.ravel(), data.previous_input]),
            lbx=lower,
            ubx=upper,
            lbg=-limit,
            ubg=limit,
            lam_x0=self._bound_multipliers,
            lam_g0=self._multipliers,
        )
        stats = self._solver.stats()
        message = "" if stats["success"] else f"CasADi: {stats['return_status']}"
        self._bound_multipliers = result["lam_x"].full().ravel()
        self._multipliers = result["lam_g"].full().ravel()
        variables = result["x"].full().ravel()
        z = join(variables[at.states[0]], variables[at.inputs])
        return z, float(result["f"]), stats["iter_count"], message

    def _variable_bounds(
        self, data: TrackingData, first_move: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns bounds (size,) on all variables; the limit (m,) of the first move is one."""
        at = self._transcription
        lower, upper = np.full(at.size, -np.inf), np.full(at.size, np.inf)
        lower[at.states[0]] = data.state - data.half_width
        upper[at.states[0]] = data.state + data.half_width
        lower[at.inputs], upper[at.inputs] = data.input_lower, data.input_upper
        first = at.inputs[0]
        lower[first] = np.maximum(lower[first], data.previous_input - first_move)
        upper[first] = np.minimum(upper[first], data.previous_input + first_move)
        return lower, upper

    def _initial_point(self, guess: np.ndarray) -> np.ndarray:
        at = self._transcription
        x0, inputs = split(self._problem, guess)
        point = np.empty(at.size)
        point[at.states[0]] = x0
        point[at.states[1:]] = self._roll_out(x0, inputs.T).full().T
        point[at.inputs] = inputs
        point[at.copies] = inputs[: len(at.copies)]
        return point


def _import_casadi() -> ModuleType:
    try:
        import casadi  # Optional, and slow to load: only for those who compare.
    except ImportError:
        raise UserError(CASADI_HINT) from None
    return casadi


def _stages(problem: TrackingProblem) -> dict[str, object]:
    """Returns the options that tell HPIPM the sizes of every stage of the lifted program."""
    n, m, N = problem.model.num_states, problem.model.num_inputs, problem.horizon
    sizes = {
        "N": N,
        "nx": [n, *[n + m] * (N - 1), n],
        "nu": [*[m] * N, 0],
        "ng": [0, *[m] * (N - 1), 0],  # The rate constraints.
    }
    return {"qpsol": "hpipm", "qpsol_options": HPIPM_OPTIONS | sizes}
