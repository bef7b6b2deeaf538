import dataclasses as dc

import numpy as np
import pytest

from mirte_drake.control.tracking_problem import TrackingData, TrackingProblem
from mirte_drake.model.model_file import load_model
from mirte_drake.scenario_file import load_scenario
from mirte_drake.systems.nominal_nmpc import make_tracking_problem


@pytest.fixture(scope="session")
def problem() -> TrackingProblem:
    """The study's problem."""
    config = load_scenario("rectangle").nominal_nmpc
    return make_tracking_problem(config, load_model("extended_kinematic"), 0.1)


@pytest.fixture(scope="session")
def make_problem(problem):
    """Makes the study's problem with another model or another alignment."""

    def make(model: str = "extended_kinematic", **changes: object) -> TrackingProblem:
        return dc.replace(problem, model=load_model(model), **changes)

    return make


@pytest.fixture(scope="session")
def make_data():
    """Makes random data of a feasible sample, bounds differing by stage."""

    def make(problem: TrackingProblem, seed: int) -> TrackingData:
        rng = np.random.default_rng(seed)
        n, m, N = problem.model.num_states, problem.model.num_inputs, problem.horizon
        start = rng.uniform([-1.0, -1.0, -3.0], [1.0, 1.0, 3.0])
        velocity = rng.uniform([-0.2, -0.2, -0.3], [0.2, 0.2, 0.3])
        state, half_width = np.zeros(n), np.zeros(n)
        state[:3] = start + rng.uniform(-0.05, 0.05, 3)
        half_width[:3] = rng.uniform(0.0, 0.02, 3) * (seed % 3 > 0)
        upper = rng.uniform(30.0, 90.0, (N, m))
        return TrackingData(
            state=state,
            reference=start + problem.period * np.arange(N + 1)[:, None] * velocity,
            half_width=half_width,
            input_lower=-upper,
            input_upper=upper[::-1],
            previous_input=rng.uniform(-40.0, 40.0, m),
        )

    return make
