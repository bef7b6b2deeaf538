import dataclasses as dc
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mirte_drake.angles import rotation
from mirte_drake.errors import UserError
from mirte_drake.identification.recorded_run import RecordedRun, load_recorded_run
from mirte_drake.identification.validation import (
    body_velocity,
    matlab_grids,
    measured_states,
    rmse,
    validate_model,
)
from mirte_drake.model.model_file import load_model
from mirte_drake.model.sparse_model import SparseModel

DATA = Path(__file__).parents[2].parent / "shared/data"
RECORDINGS = {
    "changing": DATA / "validation_turn_rect.csv",
    "constant": DATA / "validation_const_rect.csv",
}
needs_recordings = pytest.mark.skipif(
    not all(path.exists() for path in RECORDINGS.values()),
    reason=f"the recordings are not part of the project and not in {DATA}",
)

# Tables 3-4 and 3-5: RMSE of x, y, theta | vx, vy, yaw rate [m, m, rad | m/s, m/s, rad/s].
PUBLISHED = {
    ("changing", "kinematic"): [0.45, 0.78, 0.43, 0.12, 0.01, 0.17],
    ("changing", "extended_kinematic"): [0.31, 0.36, 0.05, 0.12, 0.02, 0.17],
    ("changing", "dynamic"): [0.45, 0.51, 0.51, 0.10, 0.04, 0.22],
    ("constant", "kinematic"): [0.58, 0.31, 0.55, 0.11, 0.05, 0.10],
    ("constant", "extended_kinematic"): [0.52, 0.18, 0.28, 0.11, 0.05, 0.07],
    ("constant", "dynamic"): [0.22, 0.18, 0.30, 0.11, 0.07, 0.06],
}
# The same with exact integration: pose only.
EXACT = {
    ("changing", "kinematic"): [0.545, 0.802, 0.549],
    ("changing", "extended_kinematic"): [0.287, 0.360, 0.070],
    ("changing", "dynamic"): [0.456, 0.512, 0.516],
    ("constant", "kinematic"): [0.590, 0.303, 0.552],
    ("constant", "extended_kinematic"): [0.480, 0.184, 0.275],
    ("constant", "dynamic"): [0.219, 0.191, 0.299],
}
MODELS = ("kinematic", "extended_kinematic", "dynamic")


@pytest.fixture(scope="module")
def generated_run():
    """A run of random held inputs on uneven samples; pose and velocity are noise."""
    rng = np.random.default_rng(3)
    time = np.r_[0.0, np.cumsum(rng.uniform(0.08, 0.2, 19))]
    return RecordedRun(
        time=time,
        pose=rng.normal(size=(20, 3)),
        body_velocity=rng.normal(scale=0.2, size=(20, 3)),
        wheel_command=rng.uniform(-60, 60, size=(20, 4)),
        source="generated",
    )


@needs_recordings
@pytest.mark.parametrize(("recording", "name"), PUBLISHED)
def test_ode45_gives_every_published_digit(recording, name):
    run = load_recorded_run(RECORDINGS[recording])
    result = validate_model(load_model(name), run, integrator="ode45")
    actual = np.r_[result.pose_rmse, result.velocity_rmse]
    assert actual.round(2).tolist() == PUBLISHED[recording, name]


@needs_recordings
@pytest.mark.parametrize(("recording", "name"), EXACT)
def test_zoh_gives_the_exact_pose_errors(recording, name):
    run = load_recorded_run(RECORDINGS[recording])
    result = validate_model(load_model(name), run)
    assert result.pose_rmse.round(3).tolist() == EXACT[recording, name]
    assert (result.model, result.integrator) == (name, "zoh")


@pytest.mark.parametrize("name", MODELS)
def test_zoh_is_the_exact_solution(generated_run, name):
    run, model = generated_run, load_model(name)
    result = validate_model(model, run)
    x = measured_states(model, run)[0]
    for k, (start, end) in enumerate(zip(run.time[:-1], run.time[1:], strict=True)):
        u = run.wheel_command[k]
        np.testing.assert_allclose(result.states[k], x, rtol=0, atol=2e-7)
        x = solve_ivp(
            lambda _t, state, u=u: model.derivative(state, u), (start, end), x, rtol=1e-11,
            atol=1e-12,
        ).y[:, -1]  # fmt: skip
    np.testing.assert_allclose(result.pose[-1], x[:3], rtol=0, atol=2e-7)


@pytest.mark.parametrize("name", MODELS)
def test_both_integrators_agree_where_the_input_never_changes(generated_run, name):
    count = 40
    run = dc.replace(
        generated_run,
        time=np.linspace(0.0, 3.9, count),
        pose=np.zeros((count, 3)),
        body_velocity=np.zeros((count, 3)),
        wheel_command=np.tile([30.0, 20.0, 25.0, 10.0], (count, 1)),
    )
    zoh, matlab = (validate_model(load_model(name), run, integrator=i) for i in ("zoh", "ode45"))
    np.testing.assert_allclose(matlab.states, zoh.states, rtol=0, atol=1e-3)
    np.testing.assert_allclose(matlab.body_velocity, zoh.body_velocity, rtol=0, atol=1e-3)


@pytest.mark.parametrize("name", MODELS)
def test_a_run_of_the_model_itself_has_no_error(generated_run, name):
    model = load_model(name)
    first = validate_model(model, generated_run)
    own = dc.replace(generated_run, pose=first.pose, body_velocity=first.body_velocity)
    result = validate_model(model, own)
    # The dynamic model begins with the velocity of the first row, the others have none.
    np.testing.assert_allclose(result.pose_rmse, 0, atol=1e-12)
    np.testing.assert_allclose(result.velocity_rmse, 0, atol=1e-12)


def test_the_dynamic_model_begins_with_the_measured_velocity(generated_run):
    run = generated_run
    state = measured_states(load_model("dynamic"), run)[0]
    np.testing.assert_array_equal(state[:3], run.pose[0])
    yaw, (vx, vy, yaw_rate) = run.pose[0, 2], run.body_velocity[0]
    world = [np.cos(yaw) * vx - np.sin(yaw) * vy, np.sin(yaw) * vx + np.cos(yaw) * vy, yaw_rate]
    np.testing.assert_allclose(state[3:], world, rtol=1e-14)


def test_other_states_begin_at_zero(generated_run):
    lag = SparseModel(
        "lag", ["x", "y", "theta", "w"], ["u1", "u2", "u3", "u4"],
        {"x": {"w": 1.0}, "y": {}, "theta": {}, "w": {"w": -5.0, "u1": 0.01}},
    )  # fmt: skip
    assert not measured_states(lag, generated_run)[:, 3].any()
    assert validate_model(lag, generated_run).states.shape == (20, 4)


def test_body_velocity_is_seen_from_the_body(generated_run):
    model = load_model("dynamic")
    states = np.random.default_rng(0).normal(size=(5, 6))
    v = body_velocity(model, states, np.zeros((5, 4)))
    world = np.einsum("kij,kj->ki", rotation(states[:, 2]), v)
    np.testing.assert_allclose(world, states[:, 3:], atol=1e-14)


def test_rmse_by_hand_and_unwrapped():
    measured = np.zeros((4, 3))
    predicted = np.array(
        [[1.0, 0, 2 * np.pi], [-1, 0, 2 * np.pi], [1, 2, 2 * np.pi], [1, 0, 2 * np.pi]]
    )
    np.testing.assert_allclose(rmse(predicted, measured), [1.0, 1.0, 2 * np.pi])


def test_matlab_grids():
    linspace, colon = matlab_grids(0.7, 8)
    # 0:0.1:0.7 counts 0, .1, .2, .3 up and .4 .. .7 down, so .6 is 0.7 - 0.1.
    np.testing.assert_allclose(colon, linspace, rtol=1e-15)
    assert colon[6] == 0.7 - linspace[1]
    assert (linspace[0], colon[0], linspace[-1], colon[-1]) == (0.0, 0.0, 0.7, 0.7)
    assert matlab_grids(12.0, 121)[1][60] == 6.0


def test_says_what_is_wrong(generated_run):
    model = load_model("kinematic")
    with pytest.raises(ValueError, match="integrator: must be one of zoh, ode45"):
        validate_model(model, generated_run, integrator="euler")
    three = dc.replace(generated_run, wheel_command=generated_run.wheel_command[:, :3])
    with pytest.raises(UserError, match="has 4 inputs, the recording 3"):
        validate_model(model, three)
    unstable = SparseModel(
        "unstable", ["x", "y", "theta"], ["u1", "u2", "u3", "u4"],
        {"x": {"x*x": 1.0}, "y": {}, "theta": {}},
    )  # fmt: skip
    run = dc.replace(generated_run, pose=generated_run.pose + 10.0)
    for integrator in ("zoh", "ode45"):
        with pytest.raises(UserError, match=r"unstable.*generated"):
            validate_model(unstable, run, integrator=integrator)
