"""How the figures look, and the one function that writes them.

Lines differ in style, not in colour alone, so that each figure is readable in black and white.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from mirte_drake.files import replacing

FORMATS = ("pdf", "svg", "png")

RC_PARAMS: dict[Any, Any] = {
    "font.family": "STIXGeneral",
    "font.size": 9,
    "mathtext.fontset": "stix",
    "axes.grid": True,
    "grid.color": "0.88",
    "grid.linewidth": 0.5,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "pdf.fonttype": 42,
    "svg.hashsalt": "mirte_drake",  # The same figure gives the same file.
}

Line = Mapping[str, Any]  # Keyword arguments of ``Axes.plot``.

ACTUAL: Line = {"color": "#b2182b", "lw": 1.3, "ls": "-"}
TRUE: Line = {"color": "#1b7837", "lw": 1.2, "ls": (0, (2, 1))}
NOMINAL: Line = {"color": "#2166ac", "lw": 1.1, "ls": "-."}
REFERENCE: Line = {"color": "black", "lw": 1.0, "ls": (0, (5, 3))}
MEASURED: Line = {"color": "black", "lw": 1.2, "ls": "-"}
BACKGROUND: Line = {"color": "0.65", "lw": 1.8, "ls": "-"}  # Under a curve that smooths it.
FOREGROUND: Line = {"color": "black", "lw": 0.8, "ls": "-"}
PREDICTED: tuple[Line, ...] = (  # One for each model that is compared.
    {"color": "#d6604d", "lw": 1.2, "ls": (0, (5, 2))},
    {"color": "#2166ac", "lw": 1.5, "ls": (0, (1, 1))},
    {"color": "#1b7837", "lw": 1.2, "ls": (0, (6, 1.5, 1, 1.5))},
    {"color": "#762a83", "lw": 1.2, "ls": (0, (3, 1, 1, 1, 1, 1))},
    {"color": "#b35806", "lw": 1.2, "ls": (0, (10, 3))},
)
SOLVERS: tuple[Line, ...] = (  # One for each solver that is compared.
    {"color": "#b2182b", "lw": 1.4, "ls": "-", "marker": "o", "ms": 4},
    {"color": "#2166ac", "lw": 1.4, "ls": (0, (5, 2)), "marker": "s", "ms": 4},
    {"color": "0.25", "lw": 1.1, "ls": (0, (6, 1.5, 1, 1.5)), "marker": "v", "ms": 4},
    {"color": "#b35806", "lw": 1.1, "ls": (0, (1, 1)), "marker": "^", "ms": 4},
    {"color": "#762a83", "lw": 1.1, "ls": (0, (3, 1, 1, 1, 1, 1)), "marker": "D", "ms": 3.5},
    {"color": "#1b7837", "lw": 1.1, "ls": (0, (10, 3)), "marker": "P", "ms": 4.5},
)
# One for each of several settings of which runs are compared.
COMPARED: tuple[Line, ...] = tuple(
    {key: line[key] for key in ("color", "lw", "ls")} for line in SOLVERS
)


def path_size(path: np.ndarray) -> tuple[float, float]:
    """Returns a figure's size [inches] for a path (N, 2) drawn to scale, with its legend."""
    width, height = np.maximum(np.ptp(path, axis=0), 1e-9)
    return 5.2, float(np.clip(1.0 + 5.0 * height / width, 2.2, 4.4))


def set_time_axis(axes: Axes, time: np.ndarray) -> None:
    """Labels the time axis [s] and lets it end with the samples, of which there may be one."""
    axes.set_xlabel("time [s]")
    if len(time) > 1:
        axes.set_xlim(time[0], time[-1])


def write_figures(figures: Mapping[str, Callable[[], Figure]], folder: Path) -> list[Path]:
    """Draws figures in the house style and writes them as PDF, SVG and PNG.

    Args:
        figures: For each file name without suffix, the function that draws the figure.
        folder: Where to.

    Returns:
        The files written.

    Raises:
        UserError: when the folder cannot be written.
    """
    paths = []
    with matplotlib.rc_context(RC_PARAMS):
        for name, draw in figures.items():
            figure = draw()
            area = _lay_out(figure)
            for suffix in FORMATS:
                path = folder / f"{name}.{suffix}"
                metadata = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}.get(suffix)
                with replacing(path) as temporary:
                    figure.savefig(temporary, dpi=200, metadata=metadata, bbox_inches=area)
                paths.append(path)
    return paths


def _lay_out(figure: Figure) -> Bbox:
    """Gives all of a figure its place, once for all formats, and returns the area [inches] of it.

    ``savefig`` would do so for each format, which takes as long as drawing does.
    """
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    return figure.get_tightbbox().padded(matplotlib.rcParams["savefig.pad_inches"])
