"""Where a camera sees points."""

import numpy as np

from mirte_drake.visualization.scene.camera import ASPECT, FIELD_OF_VIEW


def seen_at(points, position, target) -> np.ndarray:
    """Where points (n, 3) are in the picture: -1 to 1 from left to right, from bottom to top."""
    ahead = (target - position) / np.linalg.norm(target - position)
    right = np.cross(ahead, [0, 0, 1])
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    to = points - position
    half = np.tan(FIELD_OF_VIEW / 2) * (to @ ahead)
    return np.column_stack([to @ right / (ASPECT * half), to @ up / half])
