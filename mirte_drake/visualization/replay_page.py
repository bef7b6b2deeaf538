"""A run as one page that plays by itself, without server or network."""

import html
import json
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.colors import to_rgb
from pydrake.geometry import MeshcatAnimation

from mirte_drake.visualization.meshcat_server import local_meshcat
from mirte_drake.visualization.scene.colors import COLORS
from mirte_drake.visualization.scene.drawer import SceneDrawer
from mirte_drake.visualization.scene.frame import Frame, Trail
from mirte_drake.visualization.scene.shapes import RobotShapes
from mirte_drake.visualization.scene.stage import BACKGROUNDS, Stage

PAUSE = 2.0  # [s] Before it begins anew.

_OVERLAY = Path(__file__).with_name("replay_overlay.html")
_ROUNDS = 1000  # Hours, even of a short run.
_LEGEND = {  # What is drawn, how the legend draws it, and what it is called.
    "reference": ("dashed", "reference"),
    "measured": ("line", "measured pose"),
    "true": ("line", "true pose"),
    "plan": ("dotted", "nominal plan"),
    "tube": ("solid", "tube"),
    "disturbance": ("line", "disturbance"),
    "forward": ("bar", "wheel command, forward"),
    "backward": ("bar", "wheel command, backward"),
}


def replay_page(
    stage: Stage,
    robot: RobotShapes,
    frames: Sequence[Frame],
    trails: Sequence[Trail],
    *,
    period: float,
    title: str,
    caption: str,
) -> str:
    """Returns the HTML text of a page that plays frames, and what they leave behind, in a loop.

    Args:
        stage: Where the robot will be; the page chooses its background itself.
        robot: What it looks like.
        frames: What is seen, at equal distances in time.
        trails: Pieces that follow each other; each is there when its last sample is.
        period: [s] between frames.
        title: Name of the run.
        caption: What to know about it, in one line.
    """
    meshcat = local_meshcat()
    drawer = SceneDrawer(meshcat, stage, robot, len(frames[0].plan) - 1)
    end = period * (len(frames) - 1)
    meshcat.StartRecording(1 / period, set_visualizations_while_recording=False)
    for k, frame in enumerate(frames):
        drawer.draw(frame, k * period)
    drawer.draw(frames[-1], end + PAUSE)
    lengths = np.array([len(trail.poses) - 1 for trail in trails])
    for i, time in enumerate(end * np.cumsum(lengths) / max(lengths.sum(), 1)):
        drawer.leave(trails[i], i, (time, end + PAUSE))
    animation = meshcat.get_mutable_recording()
    animation.set_loop_mode(MeshcatAnimation.LoopMode.kLoopRepeat)
    animation.set_repetitions(_ROUNDS)
    meshcat.PublishRecording()
    page = meshcat.StaticHtml().replace("<title>Drake MeshCat<", f"<title>{html.escape(title)}<")
    before, body, after = page.rpartition("</body>")
    return before + _overlay(title, caption, end, _shown(frames)) + body + after


def _shown(frames: Sequence[Frame]) -> list[str]:
    """Returns the names in the legend of what is to be seen in these frames."""
    absent = set()
    if all(np.array_equal(frame.pose, frame.true_pose) for frame in frames):
        absent.add("true")
    if all(np.all(frame.plan == frame.pose) for frame in frames):
        absent.add("plan")  # There is none: it is drawn where the robot is.
    if not any(np.any(frame.half_widths) for frame in frames):
        absent.add("tube")
    if not any(np.any(frame.disturbance) for frame in frames):
        absent.add("disturbance")
    return [name for name in _LEGEND if name not in absent]


def _overlay(title: str, caption: str, end: float, names: Sequence[str]) -> str:
    """Returns what lies over the scene: title, legend, player."""
    legend = ""
    for name in names:
        mark, words = _LEGEND[name]
        legend += f'<li><i class="{mark}" style="--mark: {COLORS[name]}"></i>{words}</li>'
    backgrounds = {
        shade: {
            edge: to_rgb(color)
            for edge, color in zip(("top_color", "bottom_color"), colors, strict=True)
        }
        for shade, colors in BACKGROUNDS.items()
    }
    values = {
        "title": html.escape(title),
        "caption": html.escape(caption),
        "legend": legend,
        "backgrounds": json.dumps(backgrounds),
        "end": json.dumps(end),
    }
    text = _OVERLAY.read_text(encoding="utf-8")
    return re.sub(r"@(\w+)@", lambda match: values[match[1]], text)
