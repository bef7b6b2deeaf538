import dataclasses as dc

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mirte_drake.geometry import body_velocity
from mirte_drake.model.lagged_model import BODY_VELOCITY, LaggedModel, LaggedParameters

PARAMETERS = LaggedParameters(
    axis_gain=np.array([1.0, 0.4, 0.8]),
    wheel_gain=np.array([[0.18, 0.17, 0.16, 0.15], [0.14, 0.15, 0.16, 0.17]]),
    deadband=8.0,
    lag=np.array([0.3, 0.15, 0.2]),
    delay=1,
)
MODEL = LaggedModel("lagged", PARAMETERS)
X = np.array([0.3, -0.2, 0.7, 0.25, -0.1, 0.8])
U = np.array([40.0, -30.0, 20.0, -55.0])


def test_deadband_direction_and_axis_shape_the_steady_velocity():
    u = np.array([18.0, -18.0, 8.0, -7.0])
    speeds = [10 * 0.18, -10 * 0.15, 0.0, 0.0]
    np.testing.assert_allclose(
        MODEL.steady_velocity(u), PARAMETERS.axis_gain * body_velocity(np.array(speeds)), rtol=1e-14
    )


def test_effective_commands_make_the_model_linear():
    effective = MODEL.effective()
    w = MODEL.effective_command(U)
    np.testing.assert_allclose(effective.steady_velocity(w), MODEL.steady_velocity(U), rtol=1e-14)
    np.testing.assert_allclose(effective.steady_velocity(-w), -effective.steady_velocity(w))
    np.testing.assert_allclose(effective.step(X, w, 0.1), MODEL.step(X, U, 0.1), rtol=1e-14)
    np.testing.assert_array_equal(effective.effective_command(U), U)


def test_commands_for_effective_ones_pass_the_deadband_without_a_jump():
    w = np.array([30.0, -20.0, 12.0, -9.0])
    np.testing.assert_allclose(MODEL.effective_command(MODEL.command_for(w)), w, rtol=1e-14)
    # Front left drives forward with 0.18 of a mean of 0.16 rad/s per pwm.
    assert MODEL.command_for(w)[0] == pytest.approx(30.0 * 0.16 / 0.18 + 8.0)
    small = np.linspace(-1.0, 1.0, 201)[:, None] * np.ones(4)
    assert np.max(np.abs(np.diff(MODEL.command_for(small), axis=0))) < 0.01 * 2 / 0.87
    assert np.all(MODEL.command_for(np.zeros(4)) == 0.0)


def test_velocity_settles_at_the_steady_one_and_pose_moves_along_the_heading():
    end = MODEL.step(X, U, 5.0)
    np.testing.assert_allclose(end[BODY_VELOCITY], MODEL.steady_velocity(U), atol=1e-7)
    coasting = np.array([0.0, 0.0, np.pi / 2, 0.1, 0.0, 0.0])
    # 0.1 m/s dies away with 0.3 s: heading left, it goes 0.03 (1 - exp(-1/3)) m in 0.1 s along y.
    end = MODEL.step(coasting, np.zeros(4), 0.1)
    np.testing.assert_allclose(end[:2], [0.0, 0.03 * (1 - np.exp(-1 / 3))], atol=1e-6)


@pytest.mark.parametrize(("dt", "tolerance"), [(0.02, 1e-9), (0.1, 1e-6)])
def test_step_is_the_solution_of_the_differential_equation(dt, tolerance):
    solution = solve_ivp(lambda _, x: MODEL.derivative(x, U), (0.0, dt), X, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(MODEL.step(X, U, dt), solution.y[:, -1], rtol=0, atol=tolerance)


def differences(f, x, h=1e-6):
    return np.stack([(f(x + h * e) - f(x - h * e)) / (2 * h) for e in np.eye(len(x))], axis=-1)


@pytest.mark.parametrize("model", [MODEL, MODEL.effective()])
def test_jacobians_are_those_of_finite_differences(model):
    for u in (U, np.array([3.0, 60.0, -20.0, -4.0])):
        by_state = differences(lambda x, u=u: model.step(x, u, 0.1), X)
        by_input = differences(lambda u: model.step(X, u, 0.1), u)
        np.testing.assert_allclose(
            model.step_jacobians(X, u, 0.1), np.hstack([by_state, by_input]), atol=1e-9
        )
        f, A, B = model.linearise(X, u)
        np.testing.assert_array_equal(f, model.derivative(X, u))
        np.testing.assert_allclose(
            A, differences(lambda x, u=u: model.derivative(x, u), X), atol=1e-8
        )
        np.testing.assert_allclose(B, differences(lambda u: model.derivative(X, u), u), atol=1e-8)
        np.testing.assert_allclose(
            model.steady_velocity_jacobian(u), differences(model.steady_velocity, u), atol=1e-9
        )


def test_roll_outs_and_batches_repeat_the_step():
    inputs = np.random.default_rng(0).uniform(-60, 60, (5, 4))
    states, jacobians = MODEL.roll_out_jacobians(X, inputs, 0.1)
    np.testing.assert_array_equal(MODEL.roll_out(X, inputs, 0.1), states)
    np.testing.assert_array_equal(MODEL.step(states[:-1], inputs, 0.1), states[1:])
    np.testing.assert_array_equal(MODEL.step_jacobians(states[:-1], inputs, 0.1), jacobians)
    np.testing.assert_array_equal(MODEL.step(states[:-1], inputs, np.full((5, 1), 0.1)), states[1:])
    batch = MODEL.derivative(states[:-1].reshape(5, 1, 6), inputs.reshape(5, 1, 4))
    np.testing.assert_allclose(batch[2, 0], MODEL.derivative(states[2], inputs[2]), rtol=1e-14)


def test_delay_is_in_no_step():
    late = LaggedModel("late", dc.replace(PARAMETERS, delay=5))
    assert late.delay == 5 and MODEL.delay == 1
    np.testing.assert_array_equal(late.step(X, U, 0.1), MODEL.step(X, U, 0.1))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("axis_gain", np.array([1.0, 0.0, 1.0])),
        ("wheel_gain", np.ones(4)),
        ("wheel_gain", np.full((2, 4), np.nan)),
        ("deadband", -1.0),
        ("lag", np.array([0.1, 0.0, 0.1])),
        ("delay", -1),
    ],
)
def test_rejects_bad_parameters(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        LaggedModel("bad", dc.replace(PARAMETERS, **{field: value}))
