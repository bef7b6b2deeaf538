"""Where a camera stands so that everything is seen."""

import numpy as np

FIELD_OF_VIEW = np.deg2rad(32.0)  # From top to bottom of the picture: little distortion.
ASPECT = 1.4  # Narrowest picture, width by height, in which everything is seen.
AZIMUTH = np.deg2rad(-68.0)  # Of the camera, seen from the scene: on its right, a little ahead.
ELEVATION = np.deg2rad(42.0)
MARGINS = (0.05, 0.17, 0.04)  # Parts of the half picture left free: at a side, below, above.


def camera_pose(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns position and target (3,) [m] of the nearest camera that sees all points (n, 3) [m].

    A camera at (a, d), across and against its view, sees a point at (x, z) where
    -s (d - z) <= x - a <= t (d - z). Where d is smallest both bounds meet in a.
    """
    towards = np.array(
        [
            np.cos(ELEVATION) * np.cos(AZIMUTH),
            np.cos(ELEVATION) * np.sin(AZIMUTH),
            np.sin(ELEVATION),
        ]
    )
    right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    up = np.cross(towards, right)
    z = points @ towards
    half_height = np.tan(FIELD_OF_VIEW / 2)
    half_width = ASPECT * half_height
    side, below, above = 1 - np.array(MARGINS)
    bounds = []
    for axis, s, t in (
        (right, side * half_width, side * half_width),
        (up, below * half_height, above * half_height),
    ):
        x = points @ axis
        bounds.append((axis, s, t, np.min(x - s * z), np.max(x + t * z)))
    d = max((high - low) / (s + t) for _, s, t, low, high in bounds)
    across = sum((low + s * d + high - t * d) / 2 * axis for axis, s, t, low, high in bounds)
    return across + d * towards, across + np.mean(z) * towards
