import numpy as np
import pytest

from mirte_drake.control.lagged_axis import (
    axis_model,
    feedback_gains,
    observer_gains,
    observer_model,
)
from mirte_drake.model.lagged_model import BODY_VELOCITY, LaggedModel, LaggedParameters

LAG, T = 0.25, 0.1


def test_axis_by_hand():
    A, B = axis_model(LAG, T)
    a = np.exp(-0.4)
    np.testing.assert_allclose(A, [[1.0, 0.25 * (1 - a)], [0.0, a]])
    np.testing.assert_allclose(B, [[0.1 - 0.25 * (1 - a)], [1 - a]])
    # A velocity that is asked for and had goes on.
    np.testing.assert_allclose(A @ [0.0, 0.3] + B[:, 0] * 0.3, [0.03, 0.3])


def test_axis_is_the_lagged_model_at_rest():
    model = LaggedModel("one lag", LaggedParameters(lag=np.full(3, LAG)))
    jacobian = model.step_jacobians(np.zeros(6), np.zeros(4), T)
    A, B = axis_model(LAG, T)
    G = model.steady_velocity_jacobian(np.zeros(4))
    for axis in range(3):
        rows = [axis, BODY_VELOCITY.start + axis]
        np.testing.assert_allclose(jacobian[np.ix_(rows, rows)], A, atol=1e-6)
        np.testing.assert_allclose(jacobian[rows, 6:], B * G[axis], rtol=1e-4)


def test_feedback_is_stable_and_faster_with_more_weight():
    weights = np.array([1.0, 9.0, 25.0])
    gains = feedback_gains(np.full(3, LAG), T, weights, np.full(3, 0.1), np.ones(3))
    assert np.all(np.diff(gains[:, 0]) > 0.5)
    A, B = axis_model(LAG, T)
    for K in gains:
        assert np.max(np.abs(np.linalg.eigvals(A - B * K))) < 0.92


def test_observer_gains_are_the_stationary_kalman_filter():
    noise, drive = np.array([0.001]), np.array([[0.0003, 0.01, 0.005]])
    (L,) = observer_gains(np.array([LAG]), T, noise, drive)
    A, C, P = observer_model(LAG, T), np.array([[1.0, 0.0, 0.0]]), np.eye(3)
    for _ in range(500):  # The filter's own recursion, of the covariance of the prediction.
        kalman = P @ C.T / (C @ P @ C.T + noise**2)
        P = A @ (P - kalman @ C @ P) @ A.T + np.diag(drive[0] ** 2)
    np.testing.assert_allclose(L, kalman[:, 0], rtol=1e-8)
    assert np.max(np.abs(np.linalg.eigvals(A - A @ np.outer(L, C)))) < 1.0


def test_a_noisier_measurement_counts_less():
    drive = np.tile([0.0003, 0.01, 0.005], (2, 1))
    gains = observer_gains(np.full(2, LAG), T, np.array([0.001, 0.01]), drive)
    assert np.all(gains[1] < gains[0])


def test_weights_must_be_positive():
    with pytest.raises(ValueError, match="positive definite"):
        feedback_gains(np.full(1, LAG), T, np.zeros(1), np.ones(1), np.ones(1))
