import itertools

import numpy as np
import pytest

from mirte_drake.benchmark import scaling as module
from mirte_drake.benchmark.problems import drive_ideally
from mirte_drake.benchmark.scaling import crossover, growth_exponent, horizon_scaling
from mirte_drake.control.nmpc_program import NmpcProgram
from mirte_drake.control.plan import SolveStatus

SIZES = (10, 20, 50, 100)


@pytest.mark.parametrize("power", [1.0, 3.0])
def test_growth_exponent_of_a_power_law(power):
    times = 2e-4 * np.array(SIZES) ** power
    assert growth_exponent(SIZES, times) == pytest.approx(power)
    times[2:] = np.nan
    assert growth_exponent(SIZES, times) == pytest.approx(power)


def test_growth_exponent_of_too_little_is_unknown():
    assert np.isnan(growth_exponent(SIZES, np.array([1.0, np.nan, np.nan, np.nan])))


def test_crossover_of_two_power_laws_is_where_they_meet():
    sizes = np.array(SIZES, dtype=float)
    cubic, linear = 1e-6 * sizes**3, 9e-4 * sizes  # Equal at 30.
    assert crossover(SIZES, cubic, linear) == pytest.approx(30.0)
    assert crossover(SIZES, linear, cubic) == 10.0
    assert crossover(SIZES, cubic, 100 * cubic) == np.inf


def test_crossover_where_one_was_given_up():
    one = np.array([1.0, 4.0, np.nan, np.nan])
    assert crossover(SIZES, one, np.array([2.0, 5.0, 6.0, 7.0])) == 50.0
    assert crossover(SIZES, one, np.array([2.0, 5.0, np.nan, np.nan])) == np.inf


@pytest.mark.parametrize(("model", "horizon"), [("extended_kinematic", 4), ("dynamic", 5)])
def test_an_ideal_run_tracks_with_any_model_and_horizon(make_problem, make_data, model, horizon):
    problem = make_problem(model, horizon=horizon)
    typical = make_data(make_problem(horizon=horizon), 1)
    poses = np.linspace([0.0, 0.0, 0.0], [0.3, 0.1, 0.0], 30)
    samples = list(drive_ideally(problem, NmpcProgram(problem), typical, poses, 20))
    assert len(samples) == 20
    n = problem.model.num_states
    for before, sample in itertools.pairwise(samples):
        assert sample.plan.status is SolveStatus.SOLVED
        assert sample.data.reference.shape == (horizon + 1, 3)
        assert sample.data.state.shape == sample.data.half_width.shape == (n,)
        # The measured state lies in the tube about the predicted one.
        error = np.abs(sample.data.state - before.plan.nominal_next)
        assert np.all(error <= sample.data.half_width + 1e-15)
        np.testing.assert_array_equal(sample.data.previous_input, before.plan.nominal_input)
        np.testing.assert_array_equal(sample.guess[n:-4], before.plan.inputs[1:].ravel())
    lag = samples[-1].pose[:2] - samples[-1].data.reference[0][:2]
    assert np.linalg.norm(lag) < 0.05


def test_a_slow_solver_is_not_tried_on_larger_problems(problem, make_data, monkeypatch):
    monkeypatch.setattr(module, "SLOW", 0.0)
    poses = np.linspace([0.0, 0.0, 0.0], [0.3, 0.1, 0.0], 30)
    steps = []
    result = horizon_scaling(
        problem,
        ["snopt"],
        make_data(problem, 1),
        poses,
        horizons=(2, 3),
        count=2,
        on_step=lambda: steps.append(1),
    )
    assert result.sizes == (2, 3) and len(steps) == 2
    first, second = result.solve_time["snopt"]
    assert first > 0 and np.isnan(second)
