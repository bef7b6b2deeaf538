"""What stands still in the scene: floor, reference path, light, camera, background."""

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from matplotlib.colors import to_rgb
from pydrake.geometry import Box, Meshcat, Rgba
from pydrake.math import RigidTransform

from mirte_drake.visualization.scene.camera import FIELD_OF_VIEW, camera_pose
from mirte_drake.visualization.scene.colors import rgba
from mirte_drake.visualization.scene.ribbons import (
    FlatMesh,
    dashes,
    grid,
    joined,
    rectangle,
    ribbon,
)

ROOT = "/mirte"  # Path in Meshcat of all that is drawn.
BACKGROUNDS = {  # Colours above and below.
    "light": ("#ffffff", "#e4e8ee"),
    "dark": ("#23272e", "#0d0f12"),
}
# [m] What lies flat lies in layers, so that none flickers through another.
GRID_LAYER, PATCH_LAYER, TUBE_LAYER, PATH_LAYER, TRUE_LAYER, TRAIL_LAYER = 6e-4 * np.arange(1, 7)

_REACH = 0.26  # [m] From the robot's pose to the furthest that is drawn around it.
_HEIGHT = 0.3  # [m] Of all that is drawn above the floor.
_MARGIN = 0.06  # [m] Of the floor around all that.
_THICKNESS = 0.03  # [m] Of the floor, as a plate.
_ORDINARY = 3.0  # [m] Up to this size of the floor all lines have their ordinary width.
_CAMERA = "/Cameras/default/rotated/<object>"
_LAMP = "/Lights/FillLight/<object>"
_BRIGHTNESS = {"AmbientLight": 1.5, "FillLight": 2.0}  # Of Meshcat's lights that are on.


@dc.dataclass(frozen=True)
class Patch:
    """A rectangle on the floor, along the axes."""

    center: np.ndarray  # (2,) [m]
    size: np.ndarray  # (2,) [m]


@dc.dataclass(frozen=True)
class Stage:
    """Where the robot will be, and what is on the floor there."""

    path: np.ndarray  # (n, 2) [m] of the reference; empty where nobody knows it beforehand.
    places: np.ndarray  # (m, 2) [m] further places that must be seen.
    patches: Sequence[Patch] = ()
    background: str = "light"  # A key of BACKGROUNDS.

    @property
    def floor(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners (2,) [m] of the floor, smallest and largest x and y."""
        seen = np.vstack([self.path, self.places])
        reach = _REACH + _MARGIN
        return seen.min(axis=0) - reach, seen.max(axis=0) + reach

    @property
    def scale(self) -> float:
        """How much wider than usual lines must be, to be seen from where all is seen."""
        lower, upper = self.floor
        return max(1.0, float(np.max(upper - lower)) / _ORDINARY)


def draw_flat(meshcat: Meshcat, path: str, mesh: FlatMesh, height: float, color: Rgba) -> None:
    """Draws a flat mesh at a height [m]; without triangles there is nothing to draw."""
    if len(mesh.triangles):
        vertices = np.vstack([mesh.points.T, np.full(len(mesh.points), height)])
        meshcat.SetTriangleMesh(path, vertices, mesh.triangles.T, color)


def draw_stage(meshcat: Meshcat, stage: Stage) -> None:
    """Draws floor and reference path, and places lamp and camera so that all is seen."""
    lower, upper = stage.floor
    _draw_floor(meshcat, lower, upper, stage.patches)
    if len(stage.path):
        width, dash, gap = stage.scale * np.array([0.009, 0.04, 0.02])
        line = joined(ribbon(piece, width) for piece in dashes(stage.path, dash, gap))
        draw_flat(meshcat, f"{ROOT}/reference/path", line, PATH_LAYER, rgba("reference"))
    for name, color in zip(("top", "bottom"), BACKGROUNDS[stage.background], strict=True):
        meshcat.SetProperty("/Background/<object>", f"{name}_color", list(to_rgb(color)))
    for name in ("Grid", "Axes", "Lights/PointLightPositiveX", "Lights/PointLightNegativeX"):
        meshcat.SetProperty(f"/{name}", "visible", False)
    _place_light(meshcat)
    _place_camera(meshcat, lower, upper)


def _draw_floor(
    meshcat: Meshcat, lower: np.ndarray, upper: np.ndarray, patches: Sequence[Patch]
) -> None:
    plate = f"{ROOT}/floor/plate"
    meshcat.SetObject(plate, Box(*(upper - lower), _THICKNESS), rgba("floor"))
    meshcat.SetTransform(plate, RigidTransform([*(lower + upper) / 2, -_THICKNESS / 2]))
    decade = 10.0 ** max(0.0, np.floor(np.log10(np.max(upper - lower) / _ORDINARY)))
    for name, spacing, width in (("fine", 0.1, 0.0015), ("coarse", 0.5, 0.004)):
        lines = grid(lower, upper, decade * spacing, decade * width)
        draw_flat(meshcat, f"{ROOT}/floor/{name}", lines, GRID_LAYER, rgba("grid"))
    for i, patch in enumerate(patches):
        corners = [np.clip(patch.center + s * patch.size / 2, lower, upper) for s in (-1, 1)]
        if np.all(corners[0] < corners[1]):
            mesh = rectangle(*corners)
            draw_flat(meshcat, f"{ROOT}/floor/patch_{i}", mesh, PATCH_LAYER, rgba("patch"))


def _place_light(meshcat: Meshcat) -> None:
    """Lights the scene evenly, with one lamp that casts shadows: the robot stands on the floor."""
    for name, intensity in _BRIGHTNESS.items():
        meshcat.SetProperty(f"/Lights/{name}/<object>", "intensity", intensity)
    meshcat.SetProperty(_LAMP, "position", [-2.5, 2.5, 5.0])
    meshcat.SetProperty(_LAMP, "castShadow", True)
    for side in ("width", "height"):
        meshcat.SetProperty(_LAMP, f"shadow.mapSize.{side}", 2048.0)
    # In parts of the lamp's range, 500 m: larger, and what is near the floor casts no shadow;
    # smaller, and everything casts some on itself.
    meshcat.SetProperty(_LAMP, "shadow.bias", -1.2e-5)
    meshcat.SetProperty(_LAMP, "shadow.normalBias", 0.004)
    meshcat.SetProperty(_LAMP, "shadow.radius", 2.0)


def _place_camera(meshcat: Meshcat, lower: np.ndarray, upper: np.ndarray) -> None:
    """Places the camera so that it sees a rectangle of the floor, and the robot anywhere on it."""
    corners = np.array([[x, y] for x in (lower[0], upper[0]) for y in (lower[1], upper[1])])
    middle = (lower + upper) / 2
    inner = corners - _MARGIN * np.sign(corners - middle)
    points = [[*corner, 0.0] for corner in corners] + [[*corner, _HEIGHT] for corner in inner]
    meshcat.SetProperty(_CAMERA, "fov", float(np.rad2deg(FIELD_OF_VIEW)))
    meshcat.SetProperty(_CAMERA, "near", 0.05)
    position, target = camera_pose(np.array(points))
    distance = float(np.linalg.norm(position - target))
    meshcat.SetProperty(_CAMERA, "far", max(100.0, 4 * distance))
    meshcat.SetCameraPose(position, target)
