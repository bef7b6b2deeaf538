"""Yaw angles: wrapping errors and unwrapping measurements."""

import numpy as np

from mirte_drake.vectors import YAW


def wrap_angle(angle: np.ndarray | float) -> np.ndarray:
    """Returns the angle [rad] shifted by whole turns into [-pi, pi)."""
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi


def unwrap_near(angle: np.ndarray | float, near: np.ndarray | float) -> np.ndarray:
    """Returns the angle [rad] shifted by the whole turns that bring it nearest to ``near``."""
    return angle + 2 * np.pi * np.round((np.asarray(near) - angle) / (2 * np.pi))


def pose_error(pose: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Returns pose - reference with the yaw error wrapped.

    Args:
        pose: (..., n) states whose first three entries are x, y, yaw [m, m, rad].
        reference: (..., n), the same.
    """
    error = np.array(np.subtract(pose, reference), dtype=float)
    error[..., YAW] = wrap_angle(error[..., YAW])
    return error


def rotation(yaw: float | np.ndarray) -> np.ndarray:
    """Returns R(yaw) of (2-1), (..., 3, 3): body-frame velocity to world-frame velocity."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    zero, one = np.zeros_like(cos), np.ones_like(cos)
    rows = [[cos, -sin, zero], [sin, cos, zero], [zero, zero, one]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
