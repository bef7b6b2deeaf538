import numpy as np

from mirte_drake.control.lagged_axis import observer_gains
from mirte_drake.control.state_observer import correct, predict
from mirte_drake.model.lagged_model import LaggedModel, LaggedParameters

MODEL = LaggedModel(
    "robot", LaggedParameters(axis_gain=np.array([1, 0.5, 0.8]), lag=np.array([0.3, 0.15, 0.2]))
).effective()
GAINS = observer_gains(
    MODEL.parameters.lag, 0.1, np.full(3, 0.001), np.tile([0.0003, 0.01, 0.005], (3, 1))
)


def test_correction_by_hand():
    state = np.array([1.0, 2.0, np.pi / 2, 0.1, 0.2, 0.3])
    gains = np.array([[0.5, 2.0, 1.0], [0.6, 3.0, 2.0], [0.7, 4.0, 3.0]])
    # 0.01 m farther along the world's y is forward; along its x to the right.
    pose = np.array([1.02, 2.01, np.pi / 2 + 2 * np.pi])
    corrected, bias = correct(state, np.zeros(3), pose, gains)
    np.testing.assert_allclose(
        corrected, [1.0 + 0.6 * 0.02, 2.0 + 0.5 * 0.01, np.pi / 2, 0.12, 0.2 - 0.06, 0.3]
    )
    np.testing.assert_allclose(bias, [0.01, -0.04, 0.0], atol=1e-15)


def test_prediction_settles_at_the_steady_velocity_and_the_bias():
    w, bias, state = np.array([20.0, 30.0, 10.0, 25.0]), np.array([0.02, -0.01, 0.05]), np.zeros(6)
    for _ in range(60):
        state = predict(MODEL, state, bias, w, 0.1)
    np.testing.assert_allclose(state[3:], MODEL.steady_velocity(w) + bias, rtol=1e-7)
    np.testing.assert_array_equal(
        predict(MODEL, state, np.zeros(3), w, 0.1), MODEL.step(state, w, 0.1)
    )


def test_observer_finds_velocity_and_bias_of_a_turning_robot():
    w, bias = np.array([10.0, 40.0, 40.0, 10.0]), np.array([0.05, -0.03, 0.1])
    true, state, guess = np.array([0.3, 0.2, 3.0, 0.1, 0.1, -0.2]), np.zeros(6), np.zeros(3)
    state[:3] = true[:3]
    for _ in range(100):
        state, guess = correct(state, guess, true[:3], GAINS)
        true = predict(MODEL, true, bias, w, 0.1)
        state = predict(MODEL, state, guess, w, 0.1)
    np.testing.assert_allclose(guess, bias, atol=2e-3)
    np.testing.assert_allclose(state, true, atol=2e-3)
