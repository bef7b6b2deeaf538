import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mirte_drake.model.integration import rk4_step, rk4_step_jacobians
from mirte_drake.model.model_file import load_model, model_names

U = np.array([60.0, -35.0, 80.0, 20.0])


def test_exponential_by_hand():
    actual = rk4_step(lambda x: -2.0 * x, np.array([3.0]), 0.1)
    np.testing.assert_allclose(actual, [3.0 * (1 - 0.2 + 0.02 - 0.008 / 6 + 0.0016 / 24)])


def test_error_falls_with_the_fourth_power_of_the_step():
    def final_error(steps: int) -> float:
        x = np.array([1.0])
        for _ in range(steps):
            x = rk4_step(lambda state: -(state**2), x, 1.0 / steps)
        return abs(x[0] - 0.5)

    assert 14.0 < final_error(10) / final_error(20) < 18.0


@pytest.mark.parametrize("name", model_names())
def test_step_equals_an_adaptive_integrator(name):
    model = load_model(name)
    x = np.array([0.3, -0.2, 0.7, 0.2, -0.1, 0.4])[: model.num_states]
    exact = solve_ivp(lambda _, s: model.derivative(s, U), (0, 0.1), x, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(model.step(x, U, 0.1), exact.y[:, -1], rtol=0, atol=1e-6)


@pytest.mark.parametrize("name", model_names())
def test_jacobians_are_those_of_the_step(name):
    model = load_model(name)
    n, m = model.num_states, model.num_inputs
    x = np.array([0.3, -0.2, 0.7, 0.2, -0.1, 0.4])[:n]
    Phi, Gamma = rk4_step_jacobians(lambda s: model.linearise(s, U), x, 0.1)

    def step(x, u):
        return rk4_step(lambda s: model.derivative(s, u), x, 0.1)

    h = 1e-5
    by_x = [(step(x + e, U) - step(x - e, U)) / (2 * h) for e in h * np.eye(n)]
    by_u = [(step(x, U + e) - step(x, U - e)) / (2 * h) for e in h * np.eye(m)]
    np.testing.assert_allclose(Phi, np.transpose(by_x), rtol=0, atol=1e-9)
    np.testing.assert_allclose(Gamma, np.transpose(by_u), rtol=0, atol=1e-9)


def test_jacobians_of_a_linear_system_by_hand():
    A, B, dt = np.array([[0.0, 1.0], [-2.0, -3.0]]), np.array([[0.0], [1.0]]), 0.2
    Phi, Gamma = rk4_step_jacobians(lambda x: (A @ x, A, B), np.array([1.0, 2.0]), dt)
    powers = [np.linalg.matrix_power(dt * A, k) for k in range(5)]
    expected = powers[0] + powers[1] + powers[2] / 2 + powers[3] / 6 + powers[4] / 24
    forced = dt * (powers[0] + powers[1] / 2 + powers[2] / 6 + powers[3] / 24) @ B
    np.testing.assert_allclose(Phi, expected)
    np.testing.assert_allclose(Gamma, forced)
