import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mirte_drake.angles import rotation
from mirte_drake.errors import UserError
from mirte_drake.identification.one_step_bound import (
    conformal_bound,
    coverage,
    one_step_error,
    quantile_bound,
    time_blocks,
)
from mirte_drake.identification.recorded_run import RecordedRun
from mirte_drake.identification.validation import body_velocity
from mirte_drake.model.model_file import load_model


def test_one_step_error_is_the_disturbance_of_the_tube():
    model, rng = load_model("extended_kinematic"), np.random.default_rng(0)
    commands, w = rng.uniform(-90, 90, (60, 4)), rng.uniform(-0.1, 0.1, (59, 3))
    pose = np.zeros((60, 3))
    for k in range(59):
        pushed = 0.1 * rotation(pose[k, 2]) @ w[k]
        pose[k + 1] = model.step(pose[k], commands[k], 0.1) + pushed
    run = RecordedRun(0.1 * np.arange(60), pose, np.zeros((60, 3)), commands)
    np.testing.assert_allclose(one_step_error(model, run), w, rtol=0, atol=1e-12)


def test_one_step_error_of_a_dynamic_model_starts_at_the_measured_velocity():
    model, rng = load_model("dynamic"), np.random.default_rng(1)
    commands = rng.uniform(-60, 60, (40, 4))
    states = model.roll_out(np.zeros(6), commands[:-1], 0.1)
    velocity = body_velocity(model, states, commands)
    run = RecordedRun(0.1 * np.arange(40), states[:, :3], velocity, commands)
    np.testing.assert_allclose(one_step_error(model, run), np.zeros((39, 3)), atol=1e-10)


def test_time_blocks_take_turns():
    calibration, held_out = time_blocks(np.arange(120.0)[:, None], period=0.1)
    np.testing.assert_array_equal(calibration[:, 0], [*range(50), *range(100, 120)])
    np.testing.assert_array_equal(held_out[:, 0], range(50, 100))


def test_too_short_to_hold_out():
    with pytest.raises(UserError, match=r"^the recording lasts 5 s: more than 5 s are needed"):
        time_blocks(np.zeros((50, 3)), period=0.1)


def test_conformal_rank():
    samples = np.column_stack([np.arange(1, 20), -np.arange(1, 20)]).astype(float)
    np.testing.assert_array_equal(conformal_bound(samples, 0.95), [19, 19])  # 20 * 0.95 = 19.
    np.testing.assert_array_equal(conformal_bound(samples, 0.9), [18, 18])
    np.testing.assert_array_equal(conformal_bound(samples, 0.91), [19, 19])
    np.testing.assert_array_equal(quantile_bound(samples, 1.0), [19, 19])


def test_conformal_needs_enough_samples():
    with pytest.raises(UserError, match=r"^level 0.95 needs more than 18 calibration samples"):
        conformal_bound(np.ones((18, 3)), 0.95)


@pytest.mark.parametrize("level", [0.5, 0.9, 0.95])
@pytest.mark.parametrize("draw", ["normal", "standard_cauchy", "exponential"])
def test_conformal_covers_a_further_sample_at_its_level(level, draw):
    # 20000 calibrations of 39 samples and one further sample each, one per column.
    samples = getattr(np.random.default_rng(2), draw)(size=(40, 20000))
    bound = conformal_bound(samples[:-1], level)
    assert coverage("conformal", bound, samples[-1:]).coverage.mean() == pytest.approx(
        np.ceil(40 * level) / 40,
        abs=0.012,  # Standard error 0.0035 at most.
    )


def test_quantile_of_few_samples_covers_less_than_its_level():
    samples = np.random.default_rng(3).normal(size=(40, 20000))
    bound = quantile_bound(samples[:-1], 0.95)
    assert coverage("quantile", bound, samples[-1:]).coverage.mean() < 0.94


@given(st.integers(20, 300), st.floats(0.5, 0.95), st.integers(0, 1000))
def test_conformal_is_between_quantile_and_maximum(n, level, seed):
    samples = np.random.default_rng(seed).normal(size=(n, 3))
    conformal = conformal_bound(samples, level)
    assert np.all(quantile_bound(samples, level) <= conformal + 1e-12)
    assert np.all(conformal <= quantile_bound(samples, 1.0))


def test_coverage_by_hand():
    held_out = np.array([[0.5, -0.5], [1.0, -3.0], [-2.0, 0.0], [0.0, 1.0]])
    bound = coverage("name", np.array([1.0, 2.0]), held_out)
    np.testing.assert_array_equal(bound.coverage, [0.75, 0.75])
    assert bound.joint_coverage == 0.5
