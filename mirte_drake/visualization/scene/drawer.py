"""Draws the scene, frame by frame."""

import numpy as np
from pydrake.geometry import Meshcat

from mirte_drake.visualization.scene.colors import rgba
from mirte_drake.visualization.scene.display import draw_display, move_display
from mirte_drake.visualization.scene.frame import Frame, Trail
from mirte_drake.visualization.scene.ribbons import joined, ribbon, swept_box
from mirte_drake.visualization.scene.robot import draw_robot, move_robot
from mirte_drake.visualization.scene.shapes import RobotShapes
from mirte_drake.visualization.scene.stage import (
    ROOT,
    TRAIL_LAYER,
    TRUE_LAYER,
    TUBE_LAYER,
    Stage,
    draw_flat,
    draw_stage,
)

TRAIL = f"{ROOT}/trail"

_LAYERS = {"measured": TRAIL_LAYER, "true": TRUE_LAYER, "swept tube": TUBE_LAYER}
_WIDTH = 0.006  # [m] Of a trail on a stage of ordinary size.


class SceneDrawer:
    """Draws frames in Meshcat, and what they leave behind.

    What moves is drawn once, and then only moved, scaled and shown, so that a recording of it
    plays in a page without a server.
    """

    def __init__(self, meshcat: Meshcat, stage: Stage, robot: RobotShapes, horizon: int) -> None:
        """Draws all that does not depend on a frame.

        Args:
            meshcat: Where to.
            stage: Where the robot will be.
            robot: What it looks like.
            horizon: N, of the plan.
        """
        self._meshcat, self._robot, self._width = meshcat, robot, _WIDTH * stage.scale
        draw_stage(meshcat, stage)
        draw_robot(meshcat, robot)
        draw_display(meshcat, horizon)

    def draw(self, frame: Frame, time: float | None = None) -> None:
        """Moves everything to where it is in a frame; a recording shows that at ``time`` [s]."""
        move_robot(self._meshcat, self._robot, frame, time)
        move_display(self._meshcat, frame, time)

    def leave(self, trail: Trail, index: int, span: tuple[float, float] | None = None) -> None:
        """Draws a piece of the trails on the floor.

        Args:
            trail: The piece.
            index: Its number; it takes the place of an earlier one of that number.
            span: [s] of a recording: from when the piece is there, and when the recording ends.
        """
        ends = zip(trail.nominal[..., :2], trail.half_widths[..., :2], strict=True)
        boxes = [swept_box(p[0], d[0], p[1], d[1]) for p, d in ends if np.any(d)]
        same = np.array_equal(trail.poses, trail.true_poses)
        pieces = {
            "measured": ribbon(trail.poses[:, :2], self._width),
            "true": joined([] if same else [ribbon(trail.true_poses[:, :2], self._width)]),
            "swept tube": joined(boxes),
        }
        for name, mesh in pieces.items():
            path = f"{TRAIL}/{name.replace(' ', '_')}/{index}"
            if not len(mesh.triangles):
                self._meshcat.Delete(path)
                continue
            draw_flat(self._meshcat, path, mesh, _LAYERS[name], rgba(name))
            if span is not None:
                for shown, time in ((False, 0.0), *((True, time) for time in span)):
                    self._meshcat.SetProperty(path, "visible", shown, time)

    def forget(self) -> None:
        """Removes the trails."""
        self._meshcat.Delete(TRAIL)
