import dataclasses as dc

import numpy as np
import pytest

from mirte_drake.errors import UserError
from mirte_drake.identification.fit_lagged import (
    Structure,
    fit_lagged,
    fit_steps,
    lagged_model_file,
    mean_velocities,
)
from mirte_drake.identification.held_out import held_out_text
from mirte_drake.identification.recorded_run import RecordedRun, load_recorded_run
from mirte_drake.identification.synthetic_recording import SyntheticRecordingConfig, recording_of
from mirte_drake.identification.validation import delayed, validate_model
from mirte_drake.model.lagged_model import LaggedModel, LaggedParameters
from mirte_drake.model.model_file import load_model, load_model_file

KNOWN = LaggedParameters(
    axis_gain=np.array([1.0, 0.5, 0.8]),
    wheel_gain=np.tile([0.17, 0.19, 0.18, 0.2], (2, 1)),
    deadband=6.0,
    lag=np.array([0.3, 0.15, 0.2]),
    delay=1,
)
FEW = (Structure("robot", 1), Structure("wheel", 0), Structure("wheel", 1))


def recording(rows=400, **config) -> RecordedRun:
    commands = np.random.default_rng(1).uniform(-70, 70, (rows // 4, 4)).round()
    commands = np.repeat(commands, 4, axis=0)
    model, late = LaggedModel("known", KNOWN), np.roll(commands, KNOWN.delay, axis=0)
    late[: KNOWN.delay] = commands[0]
    run = recording_of(model, late, SyntheticRecordingConfig(**config))
    return dc.replace(run, wheel_command=commands)


def test_recovers_a_known_model_and_its_structure():
    steps = []
    fit = fit_lagged(recording(), FEW, on_step=lambda: steps.append(1))
    assert fit.structure == Structure("wheel", 1)
    assert len(steps) == fit_steps(FEW)
    found = fit.parameters
    assert found.delay == 1
    np.testing.assert_allclose(found.wheel_gain, KNOWN.wheel_gain, rtol=0.01)
    np.testing.assert_allclose(found.axis_gain, KNOWN.axis_gain, rtol=0.01)
    np.testing.assert_allclose(found.lag, KNOWN.lag, rtol=0.02)
    assert found.deadband == pytest.approx(KNOWN.deadband, abs=0.1)
    assert np.all(fit.velocity_rmse < [2e-3, 2e-3, 5e-3])
    assert held_out_text(fit.structure, fit.held_out_errors).count("*") == 1


def test_mean_velocities_are_those_of_the_step():
    run, model = recording(rows=40, quantised=False), LaggedModel("known", KNOWN)
    np.testing.assert_allclose(mean_velocities(model, run), run.body_velocity, atol=5e-5)


def test_delay_moves_the_commands_of_a_validation():
    run, model = recording(quantised=False), LaggedModel("known", KNOWN)
    assert np.all(validate_model(model, run).pose_rmse < 5e-4)
    early = LaggedModel("early", dc.replace(KNOWN, delay=0))
    assert np.all(validate_model(early, run).pose_rmse > 1e-2)
    np.testing.assert_array_equal(delayed(run, 2).wheel_command[2:], run.wheel_command[:-2])
    np.testing.assert_array_equal(delayed(run, 2).wheel_command[:2], run.wheel_command[[0, 0]])
    assert delayed(run, 0) == run


def test_file_says_how_it_was_chosen():
    run = recording(rows=100)
    fit = fit_lagged(run, FEW[:1])
    content = lagged_model_file(fit, run, date="2026-01-01")
    assert content.lagged is fit.parameters and content.name == "lagged"
    assert content.identification.settings["structure"] == "gain by robot, delay 1"
    assert content.identification.data_sha256 == run.sha256
    assert set(content.training_scores) == {"vx_rmse", "vy_rmse", "yaw_rate_rmse"}


def test_a_robot_that_never_moves_sideways_is_an_error():
    run = recording(rows=100)
    still = run.body_velocity * [1, 0, 1]
    with pytest.raises(UserError, match="sideways"):
        fit_lagged(dc.replace(run, body_velocity=still), FEW[:1])


@pytest.mark.slow
def test_the_shipped_model_is_the_fit_of_the_training_recording(recordings):
    run = load_recorded_run(recordings / "training_data.csv")
    shipped = load_model_file("lagged")
    fit = fit_lagged(run)
    assert shipped.identification.data_sha256 == run.sha256
    assert shipped.identification.settings["structure"] == str(fit.structure)
    np.testing.assert_allclose(shipped.lagged.lag, fit.parameters.lag, rtol=1e-3)
    np.testing.assert_allclose(shipped.lagged.axis_gain, fit.parameters.axis_gain, rtol=1e-3)
    np.testing.assert_allclose(shipped.lagged.wheel_gain, fit.parameters.wheel_gain, rtol=1e-3)
    assert shipped.lagged.deadband == pytest.approx(fit.parameters.deadband, rel=1e-3)


def test_the_shipped_model_predicts_velocity_better_than_the_published_ones(recordings):
    """Forward and turning on the run that turns; RMSE of the others is in test_validation."""
    run = load_recorded_run(recordings / "validation_turn_rect.csv")
    ours = validate_model(load_model("lagged"), run).velocity_rmse
    for name in ("kinematic", "extended_kinematic", "dynamic"):
        published = validate_model(load_model(name), run).velocity_rmse
        assert np.all(ours[[0, 2]] < 0.55 * published[[0, 2]])
