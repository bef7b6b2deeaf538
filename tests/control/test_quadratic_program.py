import numpy as np
import pytest
from scipy.optimize import minimize

from mirte_drake.control.quadratic_program import QuadraticProgram

A = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, -1.0]])


def random_problem(seed: int):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3))
    return root @ root.T + 0.1 * np.eye(3), 5 * rng.normal(size=3), rng.uniform(0.1, 1.0, 5)


def solved(program, hessian, gradient, bound):
    program.set_hessian(hessian)
    return program.solve(gradient, -bound, bound)


@pytest.mark.parametrize("seed", range(10))
def test_agrees_with_scipy(seed):
    hessian, gradient, bound = random_problem(seed)
    z, decrease, multipliers = solved(QuadraticProgram(A), hessian, gradient, bound)
    rows = np.vstack([np.eye(3), A])
    expected = minimize(
        lambda z: 0.5 * z @ hessian @ z + gradient @ z,
        np.zeros(3),
        constraints={"type": "ineq", "fun": lambda z: np.r_[bound - rows @ z, bound + rows @ z]},
        options={"ftol": 1e-14},
    )
    np.testing.assert_allclose(z, expected.x, atol=1e-5)
    assert decrease == pytest.approx(-expected.fun, rel=1e-7)
    # Stationarity, upper bounds with positive multipliers.
    np.testing.assert_allclose(hessian @ z + gradient + rows.T @ multipliers, 0, atol=1e-8)
    np.testing.assert_allclose(np.abs(rows @ z)[multipliers != 0], bound[multipliers != 0])


def test_what_was_solved_before_is_forgotten():
    program, fresh = QuadraticProgram(A), [QuadraticProgram(A) for _ in range(6)]
    for seed, other in enumerate(fresh):
        problem = random_problem(seed)
        program.forget()
        for one, expected in zip(solved(program, *problem), solved(other, *problem), strict=True):
            np.testing.assert_array_equal(one, expected)


def test_contradictory_bounds_have_no_solution():
    program = QuadraticProgram(A)
    upper = np.array([1.0, 1.0, 1.0, -3.0, 1.0])
    with pytest.raises(ValueError, match="not solved: DAQP's exit flag is -1"):
        program.solve(np.ones(3), -np.array([1.0, 1, 1, 4, 1]), upper)


def test_hessian_that_is_not_positive_definite():
    with pytest.raises(ValueError, match="not positive definite"):
        QuadraticProgram(A).set_hessian(-np.eye(3))
