"""Yaw angles: wrapping errors, unwrapping measurements, and quaternions."""

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


def yaw_quaternion(yaw: float) -> tuple[float, float, float, float]:
    """Returns the unit quaternion x, y, z, w of a turn by ``yaw`` [rad] about the z axis."""
    return 0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2))


def quaternion_yaw(x: float, y: float, z: float, w: float) -> float:
    """Returns the yaw [rad] of a quaternion of any length; nan for one of no or infinite length."""
    q = np.array([x, y, z, w])
    length = np.max(np.abs(q))
    if not 0 < length < np.inf:
        return np.nan
    x, y, z, w = q / length
    return float(np.arctan2(2 * (w * z + x * y), w**2 + x**2 - y**2 - z**2))
