"""A dynamic system as a table: coefficients times candidate terms."""

from collections.abc import Mapping, Sequence

import numpy as np

from mirte_drake.model import term_table
from mirte_drake.model.candidate_library import (
    HEADING,
    CandidateLibrary,
    Polynomial,
    parse_term,
    substitute,
)
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.model.term_table import dense
from mirte_drake.vectors import POSE_SIZE


class SparseModel(PredictionModel):
    """Derivative, zero-order-hold step and Jacobians of xdot = coefficients @ theta(x, u).

    All methods work over leading batch axes. ``derivative`` takes float, AutoDiffXd and
    Expression; the others float.

    Attributes:
        name: Name of the model.
        states: State names; the first three are x, y, theta [m, m, rad].
        inputs: Input names, u1..u4 [PWM percent].
        equations: One polynomial per state derivative.
    """

    def __init__(
        self,
        name: str,
        states: Sequence[str],
        inputs: Sequence[str],
        derivatives: Mapping[str, Mapping[str, float]],
        auxiliaries: Mapping[str, Mapping[str, float]] | None = None,
    ) -> None:
        """Builds the model from its table.

        Args:
            name: Name of the model.
            states: State names; the first three must be x, y, theta.
            inputs: Input names.
            derivatives: For each state, coefficients by term name.
            auxiliaries: Abbreviations that terms may use, for example the body velocity
                vx = cos(theta)*x_dot + sin(theta)*y_dot; each by the same kind of table.

        Raises:
            ValueError: when names do not fit together or a coefficient is not finite.
        """
        self.name, self.states, self.inputs = name, tuple(states), tuple(inputs)
        if self.states[:POSE_SIZE] != ("x", "y", HEADING):
            raise ValueError(f"states must begin with x, y, {HEADING}, got {list(states)}")
        if set(derivatives) != set(states):
            raise ValueError(f"derivatives must be given for {list(states)}: {list(derivatives)}")
        variables = (*self.states, *self.inputs)
        every_name = [*variables, *(auxiliaries or {})]
        twice = sorted({name for name in every_name if every_name.count(name) > 1})
        if twice:
            raise ValueError(f"names of states, inputs and auxiliaries stand twice: {twice}")
        auxiliary_tables = {
            key: _parse_table(key, table, variables) for key, table in (auxiliaries or {}).items()
        }
        names = (*variables, *auxiliary_tables)
        self.equations: tuple[Polynomial, ...] = tuple(
            substitute(_parse_table(state, derivatives[state], names), auxiliary_tables)
            for state in self.states
        )
        terms = sorted({term for f in self.equations for term in f})
        matrix = [[f.get(term, 0.0) for term in terms] for f in self.equations]
        self._coefficients = np.array(matrix).reshape(len(self.equations), len(terms))
        self._library = CandidateLibrary(variables, terms)
        self._table = term_table.tabulate(self.equations, self.states, self.inputs)

    def derivative(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Returns xdot (..., n) at states x (..., n) and inputs u (..., m), of any scalar type."""
        if np.result_type(x, u).hasobject:
            return self._library.evaluate(np.concatenate([x, u], axis=-1)) @ self._coefficients.T
        return term_table.derivative(self._table, *_rows(x, u)).reshape(np.shape(x))

    def linearise(self, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns f, df/dx and df/du, of shapes (..., n), (..., n, n), (..., n, m); (4-11)."""
        f, jacobian = term_table.linearise(self._table, *_rows(x, u))
        jacobian = jacobian.reshape(*np.shape(x), -1)
        n = self.num_states
        return f.reshape(np.shape(x)), jacobian[..., :n], jacobian[..., n:]

    def step(self, x: np.ndarray, u: np.ndarray, dt: float | np.ndarray) -> np.ndarray:
        """Returns the state (..., n) after ``dt`` [s], a number or (..., 1), with u held (RK4)."""
        durations = np.array(np.broadcast_to(dt, (*np.shape(x)[:-1], 1)), dtype=float)
        end = term_table.step(self._table, *_rows(x, u), durations.reshape(-1))
        return end.reshape(np.shape(x))

    def step_jacobians(self, x: np.ndarray, u: np.ndarray, dt: float) -> np.ndarray:
        """Returns the Jacobian (..., n, n + m) of ``step`` by x and u."""
        jacobians = term_table.step_jacobians(self._table, *_rows(x, u), dt)
        return jacobians.reshape(*np.shape(x), -1)

    def roll_out(self, x: np.ndarray, inputs: np.ndarray, dt: float) -> np.ndarray:
        """Returns the states (N + 1, n) under held inputs (N, m), beginning with x (n,)."""
        return term_table.roll_out(self._table, dense(x), dense(inputs), dt)

    def roll_out_jacobians(
        self, x: np.ndarray, inputs: np.ndarray, dt: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns ``roll_out`` and the Jacobian (N, n, n + m) of each of its steps."""
        return term_table.roll_out_jacobians(self._table, dense(x), dense(inputs), dt)


def _rows(x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns states and inputs with one batch axis."""
    x, u = dense(x), dense(u)
    return x.reshape(-1, x.shape[-1]), u.reshape(-1, u.shape[-1])


def _parse_table(name: str, table: Mapping[str, float], variables: Sequence[str]) -> Polynomial:
    polynomial: Polynomial = {}
    for text, coefficient in table.items():
        term = parse_term(text, variables)
        if term in polynomial:
            raise ValueError(f"{name}: term {text!r} stands twice")
        if not np.isfinite(coefficient):
            raise ValueError(f"{name}: coefficient of {text!r} must be finite, got {coefficient}")
        polynomial[term] = float(coefficient)
    return polynomial
