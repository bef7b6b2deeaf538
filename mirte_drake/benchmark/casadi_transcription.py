"""The optimal control problem (4-9) as a CasADi program: multiple shooting and RK4.

x_{i+1} = RK4(x_i, u_i) are constraints, and the cost is a plain quadratic form.
"""

import dataclasses as dc
from collections.abc import Callable
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np

from mirte_drake.control.tracking_problem import TrackingProblem
from mirte_drake.model.candidate_library import COS, HEADING, SIN
from mirte_drake.model.integration import rk4_step
from mirte_drake.model.sparse_model import SparseModel
from mirte_drake.vectors import POSE, POSE_SIZE


@dc.dataclass(frozen=True)
class Transcription:
    """The nonlinear program, and where in its variables to find what."""

    program: dict[str, Any]  # x, f, g, p of ``casadi.nlpsol``.
    states: np.ndarray  # (N + 1, n) indices of x_0 .. x_N.
    inputs: np.ndarray  # (N, m) indices of u_0 .. u_{N-1}.
    copies: np.ndarray  # (N - 1, m) indices of the copies of u_0 .. u_{N-2}; may be empty.
    moves: np.ndarray  # (N - 1, m) indices in g of u_1 - u_0 ..; all else in g is an equation.
    size: int
    num_constraints: int


def transcribe(
    casadi: ModuleType,
    problem: TrackingProblem,
    step: Callable[..., Any],
    *,
    lifted: bool,
) -> Transcription:
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
    return Transcription(
        program=program,
        states=np.array(states),
        inputs=np.array(inputs),
        copies=np.array(copies, dtype=int).reshape(-1, m),
        moves=np.array(moves, dtype=int).reshape(-1, m),
        size=size["x"],
        num_constraints=size["g"],
    )


def step_function(casadi: ModuleType, model: SparseModel, period: float) -> Any:  # noqa: ANN401
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
