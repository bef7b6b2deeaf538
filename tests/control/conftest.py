from collections.abc import Callable

import numpy as np
import pytest

from mirte_drake.control.tracking_problem import TrackingData, TrackingProblem
from mirte_drake.model.model_file import load_model
from mirte_drake.model.sparse_model import SparseModel


@pytest.fixture(scope="session")
def model() -> SparseModel:
    return load_model("extended_kinematic")


@pytest.fixture(scope="session")
def problem(model) -> TrackingProblem:
    """The study's problem, with its published terminal weight."""
    terminal_weight = [
        [3511.06992126953, 233.248480516098, -90.1364787673133],
        [233.248480516098, 7447.46289178297, -30.9808550672083],
        [-90.1364787673133, -30.9808550672083, 1411.99502643508],
    ]
    return TrackingProblem(
        model=model,
        period=0.1,
        horizon=10,
        state_weight=1000 * np.eye(3),
        input_weight=0.001 * np.eye(4),
        rate_weight=0.001 * np.eye(4),
        terminal_weight=np.array(terminal_weight),
        rate_limit=np.full(4, 30.0),
    )


@pytest.fixture(scope="session")
def make_data() -> Callable[..., TrackingData]:
    """Makes the data of a sample near a straight path, changed as asked for."""

    def make(**changes: np.ndarray) -> TrackingData:
        values = {
            "state": np.array([0.01, -0.02, 0.03]),
            "reference": np.linspace([0.0, 0.0, 0.0], [0.2, 0.05, 0.1], 11),
            "half_width": np.full(3, 0.005),
            "input_lower": np.full((10, 4), -90.0),
            "input_upper": np.full((10, 4), 90.0),
            "previous_input": np.array([5.0, -3.0, 8.0, 1.0]),
        }
        return TrackingData(**(values | changes))

    return make
