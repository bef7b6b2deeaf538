"""The curvature of a cost that a Gauss-Newton Hessian leaves out."""

from collections.abc import Callable

import numpy as np

DIFFERENCE = 1e-5  # Of each variable, in its unit.
SMALLEST = 1e-12  # Of the curvatures, relative to the largest.


def convex_hessian(
    gradient_at: Callable[[np.ndarray], np.ndarray],
    z: np.ndarray,
    normals: np.ndarray,
    multipliers: np.ndarray,
) -> np.ndarray:
    """Returns the Hessian by differences of the gradient, made positive definite.

    Curvature along an active constraint's normal is free to choose as long as that stays active,
    and so is raised first: it leaves Newton's step as it is. Negative curvature that remains is
    turned positive.

    Args:
        gradient_at: Gives the gradient (size,) at a point (size,).
        z: (size,) where.
        normals: (rows, size) of the constraints that were active last.
        multipliers: (rows,) of theirs, not zero; a constraint that by the gradient here no longer
            holds back the descent counts as inactive.
    """
    gradient = gradient_at(z)
    columns = [
        (gradient_at(z + step) - gradient) / DIFFERENCE for step in DIFFERENCE * np.eye(z.size)
    ]
    hessian = 0.5 * (np.array(columns) + np.array(columns).T)
    now = np.linalg.lstsq(normals.T, -gradient, rcond=None)[0]
    normals = normals[now * multipliers > 0]
    hessian += np.abs(hessian).max() * normals.T @ normals
    curvatures, directions = np.linalg.eigh(hessian)
    return (directions * np.maximum(np.abs(curvatures), SMALLEST * curvatures[-1])) @ directions.T
