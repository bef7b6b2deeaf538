import dataclasses as dc

import numpy as np
import pytest

from mirte_drake.control.reference_paths import integrate_body_velocity
from mirte_drake.errors import UserError
from mirte_drake.identification.fit_robot import (
    STARTS,
    Structure,
    fit_robot,
    fit_steps,
    robot_file,
)
from mirte_drake.identification.held_out import held_out_text
from mirte_drake.identification.recorded_run import RecordedRun, load_recorded_run
from mirte_drake.identification.robot_validation import simulate_robot, validate_robot
from mirte_drake.model.drivetrain import DrivetrainParameters
from mirte_drake.model.dynamic_model import DynamicParameters
from mirte_drake.model.robot_file import load_robot_file

SIMPLE = Structure("robot", "robot")
BY_WHEEL = Structure("wheel", "robot")
KNOWN = DynamicParameters(
    yaw_inertia=0.5,
    motor_damping=15.0,
    breakaway=1.0,
    stribeck_speed=0.08,
    roller_friction=3.0,
    roller_speed=0.06,
    drivetrain=DrivetrainParameters(
        gain=np.tile([0.17, 0.19, 0.18, 0.2], (2, 1)), friction=np.full((2, 4), 1.5)
    ),
)


def recording(parameters=KNOWN, rows=300, seed=2) -> RecordedRun:
    """What odometry would record of a robot under commands that change every 0.3 s."""
    rng = np.random.default_rng(seed)
    blank = RecordedRun(
        time=0.1 * np.arange(rows),
        pose=np.zeros((rows, 3)),
        body_velocity=np.zeros((rows, 3)),
        wheel_command=np.round(np.repeat(rng.uniform(-70, 70, (rows // 3 + 1, 4)), 3, axis=0))[
            :rows
        ],
        source="known robot",
    )
    states, velocity = simulate_robot(parameters, blank)
    return dc.replace(blank, pose=states[:, :3], body_velocity=velocity)


def test_recovers_a_known_robot():
    run = recording()
    steps = []
    fit = fit_robot(run, (SIMPLE, BY_WHEEL), on_step=lambda: steps.append(1))
    assert fit.structure == BY_WHEEL
    assert fit.held_out_errors[BY_WHEEL] < 0.1 * fit.held_out_errors[SIMPLE]
    assert len(steps) == fit_steps((SIMPLE, BY_WHEEL)) == 2 * 9 + STARTS - 1
    found, gain = fit.parameters, fit.parameters.drivetrain.gain
    np.testing.assert_allclose(gain, KNOWN.drivetrain.gain, rtol=0.01)
    np.testing.assert_allclose(found.drivetrain.friction, 1.5, rtol=0.06)
    for name in ("yaw_inertia", "motor_damping", "roller_friction"):
        assert getattr(found, name) == pytest.approx(getattr(KNOWN, name), rel=0.04)
    # Another recording of that robot is foretold.
    other = validate_robot("found", found, recording(seed=9))
    np.testing.assert_array_less(other.velocity_rmse, [0.003, 0.003, 0.01])


def test_fit_is_deterministic():
    run = recording(rows=90)
    first, second = (fit_robot(run, (SIMPLE,), seed=4) for _ in range(2))
    assert first.held_out_errors == second.held_out_errors
    np.testing.assert_equal(vars(first.parameters.drivetrain), vars(second.parameters.drivetrain))


def test_simulation_agrees_with_its_own_means():
    # Poses made of the mean velocities are the simulated ones.
    states, velocity = simulate_robot(KNOWN, recording(rows=100))
    poses = integrate_body_velocity(velocity[1:], states[0, :3], 0.1)
    np.testing.assert_allclose(poses, states[:, :3], atol=0.02)
    np.testing.assert_allclose(poses[:, 2], states[:, 2], atol=1e-3)


def test_simulation_begins_as_the_recording():
    run = recording(rows=60)
    velocity = run.body_velocity.copy()
    velocity[0] = [0.3, -0.1, 0.2]
    run = dc.replace(run, pose=run.pose + np.array([1.0, 2.0, 0.5]), body_velocity=velocity)
    states, means = simulate_robot(KNOWN, run)
    np.testing.assert_array_equal(states[0, :6], [*run.pose[0], 0.3, -0.1, 0.2])
    np.testing.assert_array_equal(means[0], velocity[0])


def test_delay_is_simulated():
    run = recording(rows=60)
    delayed = dc.replace(KNOWN, drivetrain=dc.replace(KNOWN.drivetrain, delay=0.1))
    later = dc.replace(
        run, wheel_command=np.vstack([run.wheel_command[:1], run.wheel_command[:-1]])
    )
    np.testing.assert_allclose(
        simulate_robot(delayed, run)[0], simulate_robot(KNOWN, later)[0], atol=1e-12
    )


def test_uneven_samples_are_simulated_as_stamped():
    run = recording(rows=40)
    time = run.time.copy()
    time[1::2] += 0.05
    coarse = simulate_robot(KNOWN, dc.replace(run, time=time))[0]
    commands = np.repeat(run.wheel_command[:-1], np.tile([3, 1], 20)[:39], axis=0)
    fine = RecordedRun(
        time=0.05 * np.arange(len(commands) + 1),
        pose=np.zeros((len(commands) + 1, 3)),
        body_velocity=np.zeros((len(commands) + 1, 3)),
        wheel_command=np.vstack([commands, commands[-1:]]),
    )
    np.testing.assert_allclose(coarse[-1], simulate_robot(KNOWN, fine)[0][-1], atol=1e-9)


def test_validation_measures_the_distance_to_the_recording():
    run = recording(rows=60)
    exact = validate_robot("known", KNOWN, run)
    np.testing.assert_array_equal(exact.velocity_rmse, 0.0)
    shifted = dc.replace(run, body_velocity=run.body_velocity + np.array([0.0, 0.1, 0.0]))
    off = validate_robot("known", KNOWN, shifted)
    assert off.velocity_rmse[1] == pytest.approx(0.1, rel=0.2)


def test_text_marks_what_was_chosen():
    fit = fit_robot(recording(rows=90), (SIMPLE,))
    assert (
        held_out_text(fit.structure, fit.held_out_errors)
        .splitlines()[1]
        .startswith("gain by robot, friction by robot")
    )
    assert held_out_text(fit.structure, fit.held_out_errors).splitlines()[1].endswith("*")


def test_file_tells_where_the_numbers_come_from():
    run = recording(rows=90)
    fit = fit_robot(run, (SIMPLE,))
    score = validate_robot("known", fit.parameters, run)
    content = robot_file(fit, run, {"known": score}, seed=7, date="2025-01-02")
    assert content.parameters is fit.parameters
    assert content.identification.source == "fitted to known robot, 90 samples"
    assert content.identification.settings["starts"] == f"{STARTS}, seed 7"
    assert content.scores["known vx [m/s]"] == pytest.approx(score.velocity_rmse[0], abs=1e-4)


def test_rejects_a_wheel_that_never_changes():
    run = recording(rows=60)
    command = run.wheel_command.copy()
    command[:, 1] = 20.0
    with pytest.raises(UserError, match="front_right"):
        fit_robot(dc.replace(run, wheel_command=command))


def test_rejects_a_robot_that_does_not_move():
    run = recording(rows=60)
    with pytest.raises(UserError, match="known robot: the robot does not move"):
        fit_robot(dc.replace(run, body_velocity=np.zeros_like(run.body_velocity)))


@pytest.mark.parametrize("name", ["validation_turn_rect", "validation_const_rect"])
def test_fitted_robot_foretells_the_validation_runs(recordings, name):
    run = load_recorded_run(recordings / f"{name}.csv")
    content = load_robot_file("fitted")
    result = validate_robot("fitted", content.parameters, run)
    vx, _, yaw_rate = result.velocity_rmse
    assert vx <= 0.06 and yaw_rate <= 0.09
    np.testing.assert_array_less(result.pose_rmse, 0.2)
    for quantity, value in (("vx [m/s]", vx), ("yaw rate [rad/s]", yaw_rate)):
        assert content.scores[f"{name} {quantity}"] == pytest.approx(value, abs=1e-4)


@pytest.mark.slow
def test_fitted_robot_is_what_the_fit_gives(recordings):
    run = load_recorded_run(recordings / "training_data.csv")
    content = load_robot_file("fitted")
    assert content.identification.data_sha256 == run.sha256
    fit = fit_robot(run)
    assert str(fit.structure) == content.identification.settings["structure"]
    expected = validate_robot("file", content.parameters, run)
    actual = validate_robot("fit", fit.parameters, run)
    np.testing.assert_allclose(actual.velocity_rmse, expected.velocity_rmse, rtol=0.01)
    np.testing.assert_allclose(
        fit.parameters.drivetrain.gain, content.parameters.drivetrain.gain, rtol=0.02
    )
