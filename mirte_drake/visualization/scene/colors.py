"""The colours of the scene, by what they mean; those of the figures where both show the same."""

from matplotlib.colors import to_rgb
from pydrake.geometry import Rgba

from mirte_drake.visualization.style import ACTUAL, NOMINAL, REFERENCE

COLORS = {
    "reference": REFERENCE["color"],
    "measured": ACTUAL["color"],
    "true": "#c98a00",
    "plan": NOMINAL["color"],
    "tube": "#3f8fd0",
    "swept tube": "#8fbce0",
    "disturbance": "#1b7837",
    "forward": "#e8710a",
    "backward": "#8e4ec6",
    "glass": "#5c6670",
    "floor": "#dfe1e2",
    "grid": "#c3c7ca",
    "patch": "#bfe3d6",
}


def rgba(name: str, opacity: float = 1.0) -> Rgba:
    """Returns one of ``COLORS`` for Drake."""
    return Rgba(*to_rgb(COLORS[name]), opacity)
