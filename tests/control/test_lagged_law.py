import numpy as np

from mirte_drake.control.lagged_law import tracking_error, wanted_velocity
from mirte_drake.model.lagged_model import LaggedModel, LaggedParameters

GAINS = np.array([[2.0, 0.5], [3.0, 0.4], [4.0, 0.3]])


def test_errors_are_those_of_the_robots_own_frame():
    nominal = np.array([1.0, 2.0, np.pi / 2, 0.3, 0.0, 0.1])
    # 0.1 m farther along the world's y, which is forward, and 0.05 m/s too fast.
    state = nominal + np.array([0.0, 0.1, 0.0, 0.05, 0.0, 0.2])
    expected = [[0.1, 0.05], [0.0, 0.0], [0.0, 0.2]]
    np.testing.assert_allclose(tracking_error(state, nominal), expected, atol=1e-15)


def test_a_robot_that_is_turned_but_moves_as_the_nominal_one_has_no_velocity_error():
    nominal = np.array([0.0, 0.0, 0.4, 0.3, 0.1, 0.2])
    e = 0.3
    turned = [np.cos(e) * 0.3 + np.sin(e) * 0.1, -np.sin(e) * 0.3 + np.cos(e) * 0.1, 0.2]
    error = tracking_error(np.array([0.0, 0.0, 0.4 + e + 4 * np.pi, *turned]), nominal)
    np.testing.assert_allclose(error, [[0, 0], [0, 0], [e, 0]], atol=1e-12)
    # And it is asked for the velocity that goes on so.
    wanted = wanted_velocity(error, np.array([0.3, 0.1, 0.2]), np.zeros(3), 0 * GAINS)
    np.testing.assert_allclose(wanted, turned, atol=1e-15)


def test_wanted_velocity_by_hand():
    error = np.array([[0.1, 0.2], [0.0, 0.0], [0.0, -0.1]])
    bias = np.array([0.01, 0.02, 0.03])
    wanted = wanted_velocity(error, np.array([0.3, 0.0, 0.0]), bias, GAINS)
    np.testing.assert_allclose(wanted, [0.3 - 0.2 - 0.1 - 0.01, -0.02, 0.03 - 0.03], atol=1e-15)


def test_errors_follow_the_linear_axes_when_nothing_turns():
    """The law's own loop: with one lag on all axes and any yaw, A - B K exactly."""
    from mirte_drake.control.lagged_axis import axis_model

    model = LaggedModel("one lag", LaggedParameters(lag=np.full(3, 0.2))).effective()
    G = model.steady_velocity_jacobian(np.zeros(4))
    w = np.array([20.0, 25.0, 20.0, 25.0])
    w -= np.linalg.pinv(G[2:]) @ (G[2:] @ w)  # Nothing turns.
    nominal = np.array([0.0, 0.0, 0.7, 0.3, -0.1, 0.0])
    state = nominal + np.array([0.02, -0.01, 0.0, 0.03, 0.04, 0.0])
    error = tracking_error(state, nominal)
    wanted = wanted_velocity(error, G @ w, np.zeros(3), GAINS)
    after = model.step(state, np.linalg.pinv(G) @ wanted, 0.1)
    following = tracking_error(after, model.step(nominal, w, 0.1))
    A, B = axis_model(0.2, 0.1)
    for axis in range(2):
        np.testing.assert_allclose(following[axis], (A - B * GAINS[axis]) @ error[axis], atol=1e-4)
