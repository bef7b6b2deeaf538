"""The optimal control problem (4-9) in CasADi, to compare with: multiple shooting and RK4.

The same problem as ``tracking_problem`` states it, with the states as variables beside the
inputs: x_{i+1} = RK4(x_i, u_i) are constraints, and the cost is a plain quadratic form.
"""

import dataclasses as dc
import time
from collections.abc import Callable
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np

from mirte_drake.control.nmpc_solution import NmpcSolution
from mirte_drake.control.tracking_problem import (
    PosedProblem,
    TrackingData,
    TrackingProblem,
    join,
    pose,
    split,
)
from mirte_drake.errors import UserError
from mirte_drake.model.candidate_library import COS, HEADING, SIN
from mirte_drake.model.integration import rk4_step
from mirte_drake.model.sparse_model import SparseModel
from mirte_drake.vectors import POSE, POSE_SIZE

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


@dc.dataclass(frozen=True)
class _Transcription:
    """The nonlinear program, and where in its variables to find what."""

    program: dict[str, Any]  # x, f, g, p of ``casadi.nlpsol``.
    states: np.ndarray  # (N + 1, n) indices of x_0 .. x_N.
    inputs: np.ndarray  # (N, m) indices of u_0 .. u_{N-1}.
    copies: np.ndarray  # (N - 1, m) indices of the copies of u_0 .. u_{N-2}; may be empty.
    moves: np.ndarray  # (N - 1, m) indices in g of u_1 - u_0 ..; all else in g is an equation.
    size: int
    num_constraints: int


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
        step = _step(casadi, problem.model, problem.period)
        self._roll_out = step.mapaccum(problem.horizon)
        self._transcription = _transcribe(casadi, problem, step, lifted=not ipopt)
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
            if not np.all(np.isfinite(guess)):
                raise ValueError("guess not finite")
            posed = pose(self._problem, data)
            z, cost, iterations, message = self._solve(posed, guess)
            # Solvers meet bounds within their tolerance; here they are met exactly.
            z = posed.project(z)
        except (ValueError, RuntimeError) as error:
            message = f"CasADi: {str(error).strip().splitlines()[-1]}"
        if message:
            self._forget()
        x0, inputs = split(self._problem, z)
        states = np.vstack([x0, self._roll_out(x0, inputs.T).full().T])
        return NmpcSolution(
            success=not message,
            message=message or (posed.note if posed else ""),
            states=states,
            inputs=inputs,
            cost=cost,
            iterations=iterations,
            solve_time=time.perf_counter() - start,
            relaxed=posed is not None and posed.relaxed,
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


def _transcribe(
    casadi: ModuleType,
    problem: TrackingProblem,
    step: Callable[..., Any],
    *,
    lifted: bool,
) -> _Transcription:
    """Writes the nonlinear program, variables in the order x_0, u_0, x_1, u_1, ..., x_N.

    Args:
        casadi: The package.
        problem: The problem.
        step: Gives the next state of a state and an input.
        lifted: Whether x_1 .. x_{N-1} are followed by a copy of the input before, so that no
            constraint reaches over stages.
    """
    model, N = problem.model, problem.horizon
    n, m = model.num_states, model.num_inputs
    symbol = casadi.SX.sym
    references, previous = symbol("r", POSE_SIZE, N), symbol("u_previous", m)
    parameters = casadi.vertcat(casadi.vec(references), previous)
    state = symbol("x0", n)
    variables, constraints = [state], []
    cost = 0.0
    states, inputs, copies, moves = [np.arange(n)], [], [], []
    size = {"x": n, "g": 0}

    def new_indices(of: str, length: int) -> np.ndarray:
        size[of] += length
        return size[of] - length + np.arange(length)

    def new_variable(name: str, length: int) -> tuple[Any, np.ndarray]:
        variables.append(symbol(name, length))
        return variables[-1], new_indices("x", length)

    def constrain(expression: object, length: int) -> np.ndarray:
        constraints.append(expression)
        return new_indices("g", length)

    for k in range(N):
        u, indices = new_variable(f"u{k}", m)
        inputs.append(indices)
        successor = step(state, u)
        state, indices = new_variable(f"x{k + 1}", n)
        states.append(indices)
        constrain(successor - state, n)
        move = u - previous
        previous = u
        if lifted and k < N - 1:
            previous, indices = new_variable(f"u{k}_copy", m)
            copies.append(indices)
            constrain(u - previous, m)
        if k > 0:
            moves.append(constrain(move, m))
        error = state[POSE] - references[:, k]
        cost += casadi.bilin(problem.state_weight, error, error)
        cost += casadi.bilin(problem.input_weight, u, u)
        cost += casadi.bilin(problem.rate_weight, move, move)
    cost += casadi.bilin(problem.terminal_weight, error, error)
    program = {
        "x": casadi.vertcat(*variables),
        "f": cost,
        "g": casadi.vertcat(*constraints),
        "p": parameters,
    }
    return _Transcription(
        program=program,
        states=np.array(states),
        inputs=np.array(inputs),
        copies=np.array(copies, dtype=int).reshape(-1, m),
        moves=np.array(moves, dtype=int).reshape(-1, m),
        size=size["x"],
        num_constraints=size["g"],
    )


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


def _step(casadi: ModuleType, model: SparseModel, period: float) -> Any:  # noqa: ANN401
    """Returns the CasADi function of one sample with the input held (RK4)."""
    x, u = casadi.SX.sym("x", model.num_states), casadi.SX.sym("u", model.num_inputs)
    successor = rk4_step(partial(_derivative, casadi, model, u=u), x, period)
    return casadi.Function("step", [x, u], [successor])


def _derivative(casadi: ModuleType, model: SparseModel, x: Any, u: Any) -> Any:  # noqa: ANN401 SX
    """Returns the model's state derivative, each coefficient times its term."""
    values = dict(zip(model.states, casadi.vertsplit(x), strict=True))
    values |= dict(zip(model.inputs, casadi.vertsplit(u), strict=True))
    values |= {SIN: casadi.sin(values[HEADING]), COS: casadi.cos(values[HEADING])}
    rows = []
    for equation in model.equations:
        row = casadi.SX(0)
        for term, coefficient in equation.items():
            product = casadi.SX(coefficient)
            for factor in term:
                product *= values[factor]
            row += product
        rows.append(row)
    return casadi.vertcat(*rows)
