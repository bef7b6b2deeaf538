"""Solids of the scene that are drawn once and then moved and scaled."""

from collections.abc import Sequence

from pydrake.geometry import Meshcat, Rgba, Shape
from pydrake.math import RigidTransform

THINNEST = 1e-4  # A scale, or size of a box [m], for what is not there: at zero it has no inverse.


def draw_solid(
    meshcat: Meshcat, path: str, shape: Shape, color: Rgba, X: RigidTransform | None = None
) -> None:
    """Draws a solid that casts no shadow, as what is not really there."""
    meshcat.SetObject(path, shape, color)
    meshcat.SetTransform(path, X or RigidTransform())
    meshcat.SetProperty(f"{path}/<object>", "castShadow", False)


def place(meshcat: Meshcat, path: str, position: Sequence[float], time: float | None) -> None:
    """Moves what is at ``path`` to a position (3,) [m], without turning it."""
    meshcat.SetProperty(path, "position", [float(value) for value in position], time)


def stretch(meshcat: Meshcat, path: str, scale: Sequence[float], time: float | None) -> None:
    """Scales what is at ``path`` along its axes (3,), by THINNEST at least."""
    meshcat.SetProperty(path, "scale", [max(float(value), THINNEST) for value in scale], time)
