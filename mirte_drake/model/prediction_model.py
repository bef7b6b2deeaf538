"""What a controller can predict with: a model with Jacobians, its input held over a sample."""

import abc

import numpy as np

from mirte_drake.model.integration import rk4_step, rk4_step_jacobians


class PredictionModel(abc.ABC):
    """A dynamic system whose first three states are the pose; RK4 gives what is not overridden.

    All methods take float arrays, and but for the roll-outs work over leading batch axes.

    Attributes:
        name: Name of the model.
        states: Names of the states.
        inputs: Names of the inputs.
        delay: [samples] From command to input; who predicts takes the commands so much later.
    """

    name: str
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    delay: int = 0

    @property
    def num_states(self) -> int:
        """Number of states n."""
        return len(self.states)

    @property
    def num_inputs(self) -> int:
        """Number of inputs m."""
        return len(self.inputs)

    @abc.abstractmethod
    def derivative(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Returns xdot (..., n) at states x (..., n) and inputs u (..., m)."""

    @abc.abstractmethod
    def linearise(self, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns f, df/dx and df/du, of shapes (..., n), (..., n, n), (..., n, m); (4-11)."""

    def step(self, x: np.ndarray, u: np.ndarray, dt: float | np.ndarray) -> np.ndarray:
        """Returns the state (..., n) after ``dt`` [s], a number or (..., 1), with u held (RK4)."""
        return rk4_step(lambda state: self.derivative(state, u), x, dt)

    def step_jacobians(self, x: np.ndarray, u: np.ndarray, dt: float) -> np.ndarray:
        """Returns the Jacobian (..., n, n + m) of ``step`` by x and u."""
        return np.concatenate(
            rk4_step_jacobians(lambda state: self.linearise(state, u), x, dt), axis=-1
        )

    def roll_out(self, x: np.ndarray, inputs: np.ndarray, dt: float) -> np.ndarray:
        """Returns the states (N + 1, n) under held inputs (N, m), beginning with x (n,)."""
        states = np.empty((len(inputs) + 1, self.num_states))
        states[0] = x
        for k, u in enumerate(inputs):
            states[k + 1] = self.step(states[k], u, dt)
        return states

    def roll_out_jacobians(
        self, x: np.ndarray, inputs: np.ndarray, dt: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns ``roll_out`` and the Jacobian (N, n, n + m) of each of its steps."""
        states = self.roll_out(x, inputs, dt)
        return states, self.step_jacobians(states[:-1], inputs, dt)
