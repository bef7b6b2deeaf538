import dataclasses as dc
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from mirte_drake.errors import UserError
from mirte_drake.identification.disturbance_bound import (
    VelocityCorrection,
    disturbance_text,
    estimate_disturbance,
    fit_correction,
    published_bound,
)
from mirte_drake.identification.recorded_run import RecordedRun, load_recorded_run
from mirte_drake.identification.synthetic_recording import (
    SyntheticRecordingConfig,
    synthetic_recording,
)
from mirte_drake.model.model_file import load_model

TRAINING = Path(__file__).parents[2].parent / "shared/data/training_data.csv"
MODEL = load_model("extended_kinematic")
NOISE = np.array([0.02, 0.01, 0.05])


@pytest.fixture(scope="module")
def recorded():
    if not TRAINING.exists():
        pytest.skip(f"the recordings are not part of the project and not at {TRAINING}")
    return estimate_disturbance(MODEL, load_recorded_run(TRAINING))


@pytest.fixture(scope="module")
def synthetic():
    run = synthetic_recording(MODEL, SyntheticRecordingConfig(velocity_noise=NOISE), seed=1)
    return estimate_disturbance(MODEL, run)


def printed(values, digits) -> list[float]:
    return [round(float(value), digits) for value in values]


def white_velocities(samples=4000) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(samples, 3))


def made_run(velocity, commands) -> RecordedRun:
    time = 0.1 * np.arange(len(velocity))
    return RecordedRun(time, np.zeros((len(velocity), 3)), velocity, commands)


# The published figures, to their printed digits.


def test_published_correction(recorded):
    correction = recorded.published.correction
    np.testing.assert_array_equal(correction.delay_samples, [3, 2, 2])
    assert printed(correction.lag_pole, 3) == [0.752, 0.894, 0.742]
    assert printed(correction.gain, 3) == [1.079, 1.124, 1.027]
    assert printed(correction.bias, 4) == [-0.0048, 0.0021, 0.0017]


def test_published_regression(recorded):
    published = recorded.published
    assert printed(published.a, 4) == [0.0354, 0.0269, 0.0884]
    assert printed(published.b, 6) == [3.4e-5, 1.8e-5, 1e-6]
    assert printed(published.w_max(), 4) == [0.0364, 0.0275, 0.0884]
    assert printed(published.w_max(300.0), 3) == [0.046, 0.032, 0.089]


def test_published_value_is_no_bound(recorded):
    published = recorded.published
    size = np.abs(published.residual)
    assert len(size) == 320
    assert printed(published.share_outside, 2) == [0.38, 0.46, 0.35]
    assert printed(size.max(axis=0), 2) == [0.28, 0.11, 0.67]
    q95 = np.quantile(size, 0.95, axis=0)
    assert [*printed(q95[::2], 2), *printed(q95[1:2], 3)] == [0.10, 0.27, 0.064]


def test_residuals_of_the_recording_are_correlated_in_time(recorded):
    w = recorded.published.residual
    correlation = [np.corrcoef(column[:-1], column[1:])[0, 1] for column in w.T]
    assert np.all(np.abs(np.array(correlation) - 0.8) < 0.15)


def test_one_step_bounds_of_the_recording(recorded):
    published, quantile, conformal, joint, maximum = recorded.one_step
    assert np.all(published.coverage < 0.8)
    assert np.all(np.abs(quantile.coverage - 0.95) < 0.03)
    assert np.all(np.abs(conformal.coverage - 0.95) < 0.03)
    assert np.all(maximum.coverage > 0.99)
    assert conformal.joint_coverage < np.min(conformal.coverage)
    assert conformal.joint_coverage < joint.joint_coverage
    assert abs(joint.joint_coverage - 0.95) < 0.03


def test_text_says_that_the_published_value_is_no_bound(recorded):
    text = disturbance_text(recorded)
    assert "w_max is not a bound" in text
    (shares,) = [line for line in text.splitlines() if "outside w_max" in line]
    assert shares.split()[-3:] == ["38%", "46%", "35%"]
    assert "The controller's 30 PWM per sample are 300 PWM/s" in text


# Known answers.


def test_correction_by_hand():
    correction = VelocityCorrection(
        np.array([1, 0, 2]), np.array([0.5, 0.0, 0.8]), np.array([2.0, 1.0, 3.0]), np.arange(3.0)
    )
    pulse = np.zeros((4, 3))
    pulse[0] = 1.0
    expected = [[0, 2, 2], [1, 1, 2], [0.5, 1, 2 + 0.6], [0.25, 1, 2 + 0.48]]
    np.testing.assert_allclose(correction.corrected(pulse), expected, rtol=0, atol=1e-15)


def test_known_delay_and_lag_are_recovered():
    truth = VelocityCorrection(
        np.array([0, 3, 7]), np.array([0.3, 0.6, 0.8]), np.ones(3), np.zeros(3)
    )
    velocity = white_velocities()
    fit = fit_correction(velocity, truth.corrected(velocity))
    np.testing.assert_array_equal(fit.delay_samples, truth.delay_samples)
    np.testing.assert_allclose(fit.lag_pole, truth.lag_pole, rtol=0, atol=1e-12)
    np.testing.assert_allclose(fit.gain, 1.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(fit.bias, 0.0, rtol=0, atol=1e-12)


def test_known_gain_and_bias_are_recovered():
    truth = VelocityCorrection(
        np.array([0, 2, 5]), np.zeros(3), np.array([1.0, 1.1, 2.0]), np.array([0.02, -0.03, 0.1])
    )
    velocity = white_velocities()
    fit = fit_correction(velocity, truth.corrected(velocity))
    np.testing.assert_array_equal(fit.delay_samples, truth.delay_samples)
    np.testing.assert_allclose(fit.lag_pole, 0.0, rtol=0, atol=1e-3)
    np.testing.assert_allclose(fit.gain, truth.gain, rtol=0, atol=1e-3)
    np.testing.assert_allclose(fit.bias, truth.bias, rtol=0, atol=1e-4)


def test_all_four_are_recovered_nearly():
    truth = VelocityCorrection(
        np.array([1, 0, 4]),
        np.array([0.2, 0.6, 0.7]),
        np.array([1.1, 0.9, 1.05]),
        np.array([0.02, -0.03, 0.01]),
    )
    velocity = white_velocities()
    fit = fit_correction(velocity, truth.corrected(velocity))
    np.testing.assert_array_equal(fit.delay_samples, truth.delay_samples)
    # The procedure fits the pole as if the gain were 1, and the gain with that pole.
    np.testing.assert_allclose(fit.lag_pole, truth.lag_pole, rtol=0, atol=0.06)
    np.testing.assert_allclose(fit.gain, truth.gain, rtol=0, atol=0.06)
    np.testing.assert_allclose(fit.bias, truth.bias, rtol=0, atol=0.003)


def test_slow_lag_of_a_smooth_velocity_is_partly_taken_for_delay():
    velocity = lfilter([1.0], [1.0, -0.9], white_velocities(), axis=0)
    truth = VelocityCorrection(np.zeros(3, dtype=int), np.full(3, 0.9), np.ones(3), np.zeros(3))
    delay = fit_correction(velocity, truth.corrected(velocity)).delay_samples
    assert np.all(np.abs(delay - 4.2) < 1.5)  # Where the cross-correlation in theory is largest.


def test_dependence_on_the_input_rate_is_recovered():
    rng, velocity = np.random.default_rng(5), white_velocities()
    commands = rng.uniform(-50, 50, (len(velocity), 4))
    rate = np.max(np.abs(np.diff(commands, axis=0, prepend=commands[:1])), axis=1) / 0.1
    a, b = np.array([0.03, 0.0, 0.1]), np.array([1e-5, 5e-5, 0.0])
    sign = rng.choice([-1.0, 1.0], velocity.shape)
    published = published_bound(
        velocity, made_run(velocity + sign * (a + np.outer(rate, b)), commands)
    )
    np.testing.assert_array_equal(published.correction.delay_samples, [0, 0, 0])
    np.testing.assert_allclose(published.a, a, rtol=0, atol=0.004)
    np.testing.assert_allclose(published.b, b, rtol=0, atol=5e-6)
    np.testing.assert_allclose(published.w_max(), published.a + 30 * published.b)


def test_falling_dependence_on_the_input_rate_counts_as_none():
    velocity, rng = white_velocities(1000), np.random.default_rng(6)
    commands = rng.uniform(-50, 50, (1000, 4))
    rate = np.max(np.abs(np.diff(commands, axis=0, prepend=commands[:1])), axis=1) / 0.1
    w = rng.choice([-1.0, 1.0], (1000, 3)) * (0.2 - 1e-4 * rate)[:, None]
    published = published_bound(velocity, made_run(velocity + w, commands))
    np.testing.assert_array_equal(published.b, np.zeros(3))
    np.testing.assert_allclose(published.a, np.abs(published.residual).mean(axis=0))


def test_one_step_bounds_of_known_noise(synthetic):
    _, quantile, conformal, joint, maximum = synthetic.one_step
    for bound in (quantile, conformal):
        np.testing.assert_allclose(bound.w, 1.96 * NOISE, rtol=0.15)
        assert np.all(np.abs(bound.coverage - 0.95) < 0.04)  # Standard error 0.013.
    assert np.all(maximum.w > 2.5 * NOISE)
    assert abs(joint.joint_coverage - 0.95) < 0.04


def test_exact_integration_changes_little(recorded):
    exact = estimate_disturbance(MODEL, load_recorded_run(TRAINING), integrator="zoh")
    np.testing.assert_allclose(exact.published.w_max(), recorded.published.w_max(), rtol=0.05)
    for one, other in zip(exact.one_step[1:], recorded.one_step[1:], strict=True):
        np.testing.assert_array_equal(one.w, other.w)


def test_text_has_every_bound(synthetic):
    text = disturbance_text(synthetic)
    for bound in synthetic.one_step:
        rows = [line.split() for line in text.splitlines()]
        (row,) = [row for row in rows if row[0] == bound.name and len(row) == 4]
        np.testing.assert_allclose([float(w) for w in row[1:]], bound.w, rtol=0, atol=5.1e-5)
    assert max(map(len, text.splitlines()[1:])) <= 80


# Errors.


def test_rejects_a_recording_without_motion():
    run = synthetic_recording(MODEL)
    still = dc.replace(run, wheel_command=np.zeros_like(run.wheel_command))
    with pytest.raises(UserError, match=r"^vx: the model's velocity is constant: record a drive"):
        estimate_disturbance(MODEL, still)


def test_rejects_a_short_recording():
    run = synthetic_recording(MODEL)
    short = RecordedRun(
        run.time[:40], run.pose[:40], run.body_velocity[:40], run.wheel_command[:40]
    )
    with pytest.raises(UserError, match=r"^the recording lasts 3\.9 s"):
        estimate_disturbance(MODEL, short)


@pytest.mark.parametrize("level", [0.0, 1.0, np.nan])
def test_rejects_bad_level(level):
    with pytest.raises(ValueError, match=r"^level: "):
        estimate_disturbance(MODEL, synthetic_recording(MODEL), level=level)


def test_rejects_unknown_integrator():
    with pytest.raises(ValueError, match=r"^integrator: "):
        estimate_disturbance(MODEL, synthetic_recording(MODEL), integrator="euler")
