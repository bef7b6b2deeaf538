import numpy as np
import pytest

from mirte_drake.identification.differentiation import (
    TvrConfig,
    _solve_normal_equations,
    integrate,
    integrate_adjoint,
    objective_gradient,
    smoothed_derivative,
    tvr_derivative,
)

DT = 0.1


def steps(samples, seed=0, noise=0.002):
    """Samples of a position whose velocity jumps every 20 samples, and that velocity."""
    rng = np.random.default_rng(seed)
    velocity = np.repeat(rng.normal(size=samples // 20 + 1), 20)[:samples]
    position = np.concatenate([[0.0], np.cumsum(velocity[1:] + velocity[:-1]) / 2 * DT])
    return position + noise * rng.normal(size=samples), velocity


def objective(u, data, config):
    slope = np.diff(u) / DT
    fit = integrate(u, DT) - data
    variation = np.sum(np.sqrt(slope**2 + config.epsilon)) * DT
    return 0.5 * fit @ fit + config.alpha * variation


def test_integration_is_the_trapezoid_rule():
    u = np.array([1.0, 3.0, 2.0])
    np.testing.assert_allclose(integrate(u, DT), [0.2, 0.45], atol=1e-15)


def test_the_adjoint_is_the_adjoint():
    rng = np.random.default_rng(1)
    u, w = rng.normal(size=31), rng.normal(size=30)
    assert integrate(u, DT) @ w == pytest.approx(u @ integrate_adjoint(w, DT), rel=1e-12)


def test_the_gradient_is_that_of_the_objective():
    rng = np.random.default_rng(2)
    u, data, config = rng.normal(size=21), rng.normal(size=20), TvrConfig(epsilon=1e-2)
    gradient = objective_gradient(u, data, DT, config)
    for i in range(len(u)):
        step = 1e-6 * np.eye(len(u))[i]
        difference = objective(u + step, data, config) - objective(u - step, data, config)
        assert gradient[i] == pytest.approx(difference / 2e-6, rel=1e-5, abs=1e-8)


def test_the_banded_solve_equals_the_dense_one():
    rng = np.random.default_rng(3)
    n = 40
    weight, rhs = rng.uniform(0.01, 5, n), rng.normal(size=n + 1)
    A = np.array([integrate(e, DT) for e in np.eye(n + 1)]).T
    D = np.diff(np.eye(n + 1), axis=0)
    dense = np.linalg.solve(A.T @ A + D.T @ np.diag(weight) @ D, rhs)
    np.testing.assert_allclose(_solve_normal_equations(weight, rhs, DT), dense, rtol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_converged_mode_reaches_the_minimum(seed):
    x, _ = steps(300, seed)
    u = tvr_derivative(x[:, None], DT)[:, 0]
    config, data = TvrConfig(), x[1:] - x[0]
    scale = np.linalg.norm(objective_gradient(np.zeros_like(u), data, DT, config))
    assert np.linalg.norm(objective_gradient(u, data, DT, config)) <= 1e-9 * scale
    best = objective(u, data, config)
    rng = np.random.default_rng(seed)
    for size in (1e-3, 1e-2, 1e-1):
        assert objective(u + size * rng.normal(size=len(u)), data, config) > best


def test_lagged_diffusivity_creeps_to_the_same_minimum():
    x, _ = steps(60, noise=0.01)
    config = TvrConfig(alpha=0.001, epsilon=1e-3)
    data = x[1:] - x[0]
    u = np.zeros(len(x))
    for _ in range(400):
        weight = config.alpha / np.sqrt((np.diff(u) / DT) ** 2 + config.epsilon) / DT
        u = u - _solve_normal_equations(weight, objective_gradient(u, data, DT, config), DT)
    np.testing.assert_allclose(tvr_derivative(x[:, None], DT, config=config)[:, 0], u, atol=1e-6)


def test_values_belong_to_their_rows():
    """Converged values are aligned; published ones lag by one sample, as in the source."""
    x, velocity = steps(400, noise=0.0)
    config = TvrConfig(alpha=1e-5)

    def shift(u):
        errors = [np.mean((u[5:-5] - np.roll(velocity, k)[5:-5]) ** 2) for k in (-2, -1, 0, 1, 2)]
        return int(np.argmin(errors)) - 2

    assert shift(tvr_derivative(x[:, None], DT, config=config)[:, 0]) == 0
    assert shift(tvr_derivative(x[:, None], DT, "published", config)[:, 0]) == 1


def test_tvr_beats_differences_on_jumps_with_noise():
    x, velocity = steps(2000, noise=0.01)
    rough = np.gradient(x, DT)
    tvr = tvr_derivative(x[:, None], DT)[:, 0]
    smooth = smoothed_derivative(x[:, None], DT)[:, 0]
    error = {name: np.sqrt(np.mean((u - velocity) ** 2)) for name, u in
             {"rough": rough, "tvr": tvr, "smooth": smooth}.items()}  # fmt: skip
    assert error["tvr"] < error["smooth"] and error["tvr"] < error["rough"]


@pytest.mark.parametrize("data", [np.zeros(50), np.arange(50.0), 1e6 * np.arange(50.0) ** 2])
def test_plain_data_are_no_trouble(data):
    u = tvr_derivative(data[:, None], DT)[:, 0]
    assert np.all(np.isfinite(u))
    np.testing.assert_allclose(integrate(u, DT), data[1:] - data[0], rtol=1e-2, atol=0.3)


def test_smoothed_differences_are_exact_on_a_parabola():
    t = DT * np.arange(30)
    np.testing.assert_allclose(
        smoothed_derivative((t**2 - t)[:, None], DT)[:, 0], 2 * t - 1, atol=1e-10
    )


def test_unknown_mode_is_named():
    with pytest.raises(ValueError, match=r"converged, published.*'exact'"):
        tvr_derivative(np.zeros((30, 1)), DT, "exact")


def test_too_few_steps_are_reported():
    x, _ = steps(300)
    with pytest.raises(ValueError, match="no minimiser within 2 steps"):
        tvr_derivative(x[:, None], DT, config=TvrConfig(max_iterations=2))
