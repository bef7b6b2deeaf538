"""A dynamic system as a table: coefficients times candidate terms."""

from collections.abc import Mapping, Sequence

import numpy as np

from mirte_drake.model.candidate_library import (
    COS,
    HEADING,
    SIN,
    CandidateLibrary,
    Polynomial,
    differentiate,
    parse_term,
    substitute,
)
from mirte_drake.model.integration import rk4_step, rk4_step_jacobians
from mirte_drake.vectors import POSE_SIZE, YAW


class SparseModel:
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
        jacobian = [differentiate(f, v) for f in self.equations for v in variables]
        self._value_library, self._value_matrix = _tabulate(variables, self.equations)
        self._full_library, self._full_matrix = _tabulate(variables, [*self.equations, *jacobian])
        self._velocity_depends_on_heading_only = self._check_heading_only()

    @property
    def num_states(self) -> int:
        """Number of states n."""
        return len(self.states)

    @property
    def num_inputs(self) -> int:
        """Number of inputs m."""
        return len(self.inputs)

    def derivative(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Returns xdot (..., n) at states x (..., n) and inputs u (..., m)."""
        return self._value_library.evaluate(_join(x, u)) @ self._value_matrix.T

    def linearise(self, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns f, df/dx and df/du, of shapes (..., n), (..., n, n), (..., n, m); (4-11)."""
        n, m = self.num_states, self.num_inputs
        table = self._full_library.evaluate(_join(x, u)) @ self._full_matrix.T
        jacobian = table[..., n:].reshape(*table.shape[:-1], n, n + m)
        return table[..., :n], jacobian[..., :n], jacobian[..., n:]

    def step(self, x: np.ndarray, u: np.ndarray, dt: float | np.ndarray) -> np.ndarray:
        """Returns the state (..., n) after ``dt`` [s], a number or (..., 1), with u held (RK4)."""
        return rk4_step(lambda state: self.derivative(state, u), x, dt)

    def step_jacobians(
        self, x: np.ndarray, u: np.ndarray, dt: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns the Jacobians (..., n, n) and (..., n, m) of ``step`` by x and u."""
        return rk4_step_jacobians(lambda state: self.linearise(state, u), x, dt)

    def roll_out(self, x: np.ndarray, inputs: np.ndarray, dt: float) -> np.ndarray:
        """Returns the states (N + 1, n) under held inputs (N, m), beginning with x (n,).

        Where the velocity depends on yaw and input alone, and the yaw rate on the input alone,
        yaw is linear in time over a sample and RK4 is Simpson's rule: the whole horizon is two
        cumulative sums and no loop. Other models are stepped.
        """
        states = np.empty((len(inputs) + 1, self.num_states))
        states[0] = x
        if not self._velocity_depends_on_heading_only:
            for k, u in enumerate(inputs):
                states[k + 1] = self.step(states[k], u, dt)
            return states
        nodes = np.zeros((3, len(inputs), self.num_states))
        yaw_rate = self.derivative(nodes[0], inputs)[:, YAW]
        yaw_end = x[YAW] + dt * np.cumsum(yaw_rate)
        nodes[:, :, YAW] = yaw_end - dt * np.array([[1.0], [0.5], [0.0]]) * yaw_rate
        start, middle, end = self.derivative(nodes, np.broadcast_to(inputs, (3, *inputs.shape)))
        states[1:] = x + dt / 6 * np.cumsum(start + 4 * middle + end, axis=0)
        return states

    def _check_heading_only(self) -> bool:
        states = {*self.states, SIN, COS}
        used = [{factor for term in f for factor in term} & states for f in self.equations]
        return self.num_states == POSE_SIZE and not used[YAW] and all(u <= {SIN, COS} for u in used)


def _join(x: np.ndarray, u: np.ndarray) -> np.ndarray:
    return np.concatenate([x, u], axis=-1)


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


def _tabulate(
    variables: Sequence[str], polynomials: Sequence[Polynomial]
) -> tuple[CandidateLibrary, np.ndarray]:
    """Returns the library of all terms that occur, and the coefficients (polynomials, terms)."""
    terms = sorted({term for p in polynomials for term in p})
    matrix = np.array([[p.get(term, 0.0) for term in terms] for p in polynomials])
    return CandidateLibrary(variables, terms), matrix.reshape(len(polynomials), len(terms))
