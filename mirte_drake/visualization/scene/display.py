"""What the controller knows and wants, above the robot, which would hide it on the floor.

Pose, reference, plan and tube are at one level, true to scale in x and y, so that they can be
compared by eye.
"""

import numpy as np
from pydrake.geometry import Box, Cylinder, Meshcat, MeshcatCone, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from mirte_drake.angles import rotation
from mirte_drake.vectors import YAW
from mirte_drake.visualization.scene.colors import rgba
from mirte_drake.visualization.scene.frame import Frame
from mirte_drake.visualization.scene.solids import draw_solid, place, stretch
from mirte_drake.visualization.scene.stage import ROOT

ARROW_TIME = 4.0  # [s] The arrow is as long as the way that the disturbance goes in this time.
LONGEST_ARROW = 0.4  # [m]

_MOST_BEADS = 10  # Of a longer horizon every second, third, ... stage is drawn.
_MOST_BOXES = 5
_ROBOT_TOP, _LEVEL, _ARROW_LEVEL = 0.19, 0.225, 0.29  # [m] Heights.
_NOW, _AHEAD = (0.195, 0.27), (0.213, 0.237)  # [m] Heights of the tube's boxes, bottom and top.


def shown_stages(horizon: int, most: int) -> np.ndarray:
    """Returns at most so many of the stages 1, ..., N, evenly spread, the last among them."""
    return np.unique(np.linspace(0, horizon, min(horizon, most) + 1).round().astype(int))[1:]


def draw_display(meshcat: Meshcat, horizon: int) -> None:
    """Draws a pin at the measured pose, marks of reference and plan, boxes and arrow."""
    pin = RigidTransform([0, 0, (_LEVEL + _ROBOT_TOP) / 2])
    measured = rgba("measured")
    draw_solid(meshcat, f"{ROOT}/pose/pin", Cylinder(0.004, _LEVEL - _ROBOT_TOP), measured, pin)
    draw_solid(
        meshcat, f"{ROOT}/pose/head", Sphere(0.009), measured, RigidTransform([0, 0, _LEVEL])
    )
    draw_solid(meshcat, f"{ROOT}/reference/now/head", Sphere(0.008), rgba("reference"))
    for i, stage in enumerate(shown_stages(horizon, _MOST_BEADS)):
        bead = Sphere(0.0065 * (1 - 0.05 * i))
        draw_solid(meshcat, f"{ROOT}/plan/stage_{stage}/bead", bead, rgba("plan"))
    for name, _, opacity in _boxes(horizon):
        draw_solid(meshcat, f"{ROOT}/tube/{name}/box", Box(1, 1, 1), rgba("tube", opacity))
    ahead, back = (RotationMatrix.MakeYRotation(turn) for turn in (np.pi / 2, -np.pi / 2))
    shaft, tip = RigidTransform(ahead, [0.35, 0, 0]), RigidTransform(back, [1, 0, 0])
    draw_solid(
        meshcat, f"{ROOT}/disturbance/shaft", Cylinder(0.03, 0.7), rgba("disturbance"), shaft
    )
    draw_solid(
        meshcat, f"{ROOT}/disturbance/tip", MeshcatCone(0.3, 0.08, 0.08), rgba("disturbance"), tip
    )


def _boxes(horizon: int) -> list[tuple[str, int, float]]:
    """Returns name, stage and opacity of the tube's boxes."""
    ahead = shown_stages(horizon, _MOST_BOXES)
    return [("now", 0, 0.35), *((f"stage_{stage}", int(stage), 0.22) for stage in ahead)]


def move_display(meshcat: Meshcat, frame: Frame, time: float | None) -> None:
    """Moves and scales what ``draw_display`` drew."""
    horizon = len(frame.plan) - 1
    place(meshcat, f"{ROOT}/pose", [*frame.pose[:2], 0.0], time)
    place(meshcat, f"{ROOT}/reference/now", [*frame.reference[:2], _LEVEL], time)
    for stage in shown_stages(horizon, _MOST_BEADS):
        place(meshcat, f"{ROOT}/plan/stage_{stage}", [*frame.plan[stage, :2], _LEVEL], time)
    for name, stage, _ in _boxes(horizon):
        bottom, top = _AHEAD if stage else _NOW
        box = f"{ROOT}/tube/{name}"
        place(meshcat, box, [*frame.plan[stage, :2], (bottom + top) / 2], time)
        stretch(meshcat, box, [*2 * frame.half_widths[stage, :2], top - bottom], time)
    _move_arrow(meshcat, frame, time)


def _move_arrow(meshcat: Meshcat, frame: Frame, time: float | None) -> None:
    """Points the arrow to where the disturbance moves the robot; its turning is not shown."""
    x, y, _ = rotation(frame.true_pose[YAW]) @ frame.disturbance
    heading = RotationMatrix.MakeZRotation(np.arctan2(y, x))
    X = RigidTransform(heading, [*frame.true_pose[:2], _ARROW_LEVEL])
    meshcat.SetTransform(f"{ROOT}/disturbance", X, time)
    length = min(ARROW_TIME * np.hypot(x, y), LONGEST_ARROW)
    stretch(meshcat, f"{ROOT}/disturbance", [length] * 3, time)
