"""The identified model with a body-frame disturbance [m/s, m/s, rad/s], integrated finely."""

import numpy as np

from mirte_drake.angles import rotation
from mirte_drake.model.integration import rk4_step
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.vectors import YAW


def disturbed_successor(
    model: PredictionModel, x: np.ndarray, u: np.ndarray, w: np.ndarray, period: float
) -> np.ndarray:
    """Returns the states (K, 3) after a sample of input u (4,) and each disturbance w (K, 3)."""
    inputs, states = np.tile(u, (len(w), 1)), np.tile(x, (len(w), 1))

    def derivative(x: np.ndarray) -> np.ndarray:
        return model.derivative(x, inputs) + np.einsum("kij,kj->ki", rotation(x[:, YAW]), w)

    for _ in range(10):
        states = rk4_step(derivative, states, period / 10)
    return states
