import numpy as np
import pytest
from pydrake.math import DiscreteAlgebraicRiccatiEquation
from scipy.linalg import solve_discrete_are

from mirte_drake.control.riccati import is_positive_definite, solve_dare


def random_system(seed: int, n: int, m: int):
    rng = np.random.default_rng(seed)
    root, other = rng.normal(size=(n, n)), rng.normal(size=(m, m))
    Q, R = root @ root.T + 0.1 * np.eye(n), other @ other.T + 0.1 * np.eye(m)
    return rng.normal(size=(n, n)), rng.normal(size=(n, m)), Q, R


@pytest.mark.parametrize(("n", "m"), [(1, 1), (3, 4), (6, 4), (10, 2)])
@pytest.mark.parametrize("seed", range(5))
def test_agrees_with_scipy_and_drake(seed, n, m):
    system = random_system(seed, n, m)
    K, P, residual, stable = solve_dare(*system)
    for expected in (solve_discrete_are(*system), DiscreteAlgebraicRiccatiEquation(*system)):
        np.testing.assert_allclose(P, expected, rtol=1e-7, atol=1e-9 * np.abs(P).max())
    A, B, _, R = system
    np.testing.assert_allclose(K, np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A), atol=1e-8)
    assert stable and residual < 1e-9
    assert np.abs(np.linalg.eigvals(A - B @ K)).max() < 1


def test_scalar_by_hand():
    """P = 1 + P / (1 + P) for A = B = Q = R = 1: the golden ratio."""
    one = np.eye(1)
    K, P, _, _ = solve_dare(one, one, one, one)
    golden = (1 + np.sqrt(5)) / 2
    np.testing.assert_allclose(P, golden)
    np.testing.assert_allclose(K, golden / (1 + golden))


@pytest.mark.parametrize("unreachable", [1.0, 1.5])
def test_mode_that_no_input_reaches_is_not_called_stable(unreachable):
    A, B = np.diag([0.5, unreachable]), np.array([[1.0], [0.0]])
    _, _, residual, stable = solve_dare(A, B, np.eye(2), np.eye(1))
    assert not (stable and residual < 1e-9)


@pytest.mark.parametrize("position", range(4))
def test_what_is_not_finite_is_not_called_stable(position):
    system = [np.eye(3), np.eye(3), np.eye(3), np.eye(3)]
    system[position] = np.full((3, 3), np.nan)
    assert not solve_dare(*system)[3]


def test_positive_definiteness():
    assert is_positive_definite(np.array([[2.0, 1.0], [1.0, 2.0]]))
    assert not is_positive_definite(np.array([[1.0, 2.0], [2.0, 1.0]]))
    assert not is_positive_definite(np.zeros((2, 2)))
    assert not is_positive_definite(np.full((2, 2), np.nan))
