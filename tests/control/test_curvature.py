import numpy as np
import pytest

from mirte_drake.control.curvature import convex_hessian

NONE = np.zeros((0, 3)), np.zeros(0)
CONVEX = np.array([[3.0, 1.0, 0.0], [1.0, 2.0, 0.5], [0.0, 0.5, 1.0]])


def quadratic(hessian):
    return lambda z: hessian @ z - np.array([1.0, 2.0, 3.0])


def test_convex_hessian_is_found_as_it_is():
    found = convex_hessian(quadratic(CONVEX), np.array([0.3, -0.2, 0.1]), *NONE)
    np.testing.assert_allclose(found, CONVEX, atol=1e-8)


def test_negative_curvature_is_turned_positive():
    found = convex_hessian(quadratic(np.diag([2.0, -3.0, 1.0])), np.zeros(3), *NONE)
    np.testing.assert_allclose(found, np.diag([2.0, 3.0, 1.0]), atol=1e-8)


@pytest.mark.parametrize(("multiplier", "kept"), [(1.0, True), (-1.0, False)])
def test_an_active_constraint_hides_negative_curvature_while_it_holds(multiplier, kept):
    """Descent leads along +y at the origin, by 2: an upper bound on y holds it back."""
    saddle = np.array([[1.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    normal = np.array([[0.0, 1.0, 0.0]])
    found = convex_hessian(quadratic(saddle), np.zeros(3), normal, np.array([multiplier]))
    assert np.linalg.eigvalsh(found)[0] > 0
    # With y held, Newton's step in x and z is the exact one.
    assert np.allclose(found[np.ix_([0, 2], [0, 2])], np.eye(2), atol=1e-2) == kept
