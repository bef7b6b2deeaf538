"""Figures of one run, in the manner of the thesis's figures 4-2 and 4-3.

Each is readable in black and white: lines differ in style, not in colour alone.
"""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from mirte_drake.angles import pose_error
from mirte_drake.vectors import WHEELS
from mirte_drake.visualization.style import (
    ACTUAL,
    FORMATS,
    NOMINAL,
    REFERENCE,
    TRUE,
    path_size,
    set_time_axis,
    write_figures,
)

Log = Mapping[str, np.ndarray]

FIGURES = ("path", "errors", "wheel_commands")
FIGURE_FILES = tuple(f"{name}.{suffix}" for name in FIGURES for suffix in FORMATS)

_SYMBOLS, _UNITS = ("x", "y", r"\theta"), ("m", "m", "rad")  # Of a pose.


def path_figure(log: Log) -> Figure:
    """Draws reference, nominal and actual path, and the tube box of every sample.

    A controller that does not plan has neither a nominal path nor a tube.
    """
    shown = np.concatenate([log["reference"], log["pose"], log.get("true_pose", log["pose"])])
    figure = Figure(figsize=path_size(shown[:, :2]), layout="compressed")
    axes = figure.subplots()
    plans = "nominal_pose" in log
    if plans and np.any(log["half_width"][:, :2] > 0):
        center, half = log["nominal_pose"][:, :2], log["half_width"][:, :2]
        boxes = [
            Rectangle(tuple(c - h), 2 * h[0], 2 * h[1]) for c, h in zip(center, half, strict=True)
        ]
        tube = PatchCollection(boxes, facecolor="0.86", edgecolor="none", zorder=1)
        axes.add_collection(tube)
        outlines = PatchCollection(boxes[::10], facecolor="none", edgecolor="0.45", lw=0.5)
        outlines.set_zorder(1.5)
        axes.add_collection(outlines)
        axes.add_patch(
            Rectangle((np.nan, np.nan), 0, 0, fc="0.86", ec="0.45", lw=0.5, label="tube")
        )
    axes.plot(*log["reference"][:, :2].T, label="reference", zorder=3, **REFERENCE)
    if plans:
        axes.plot(*log["nominal_pose"][:, :2].T, label="nominal", zorder=4, **NOMINAL)
    true_pose = _true_pose(log)
    label = "actual" if true_pose is None else "measured"
    axes.plot(*log["pose"][:, :2].T, label=label, zorder=5, **ACTUAL)
    if true_pose is not None:
        axes.plot(*true_pose[:, :2].T, label="true", zorder=5, **TRUE)
    axes.plot(*log["pose"][0, :2], "o", color="black", ms=4, zorder=6, label="start")
    axes.set(xlabel="$x$ [m]", ylabel="$y$ [m]", aspect="equal")
    figure.legend(loc="outside upper center", ncols=5 if true_pose is None else 3)
    return figure


def error_figure(log: Log) -> Figure:
    """Draws the tracking errors over time, with their RMSE in the titles."""
    figure = Figure(figsize=(5.2, 4.6), layout="constrained")
    curves = [(log["pose"], ACTUAL, "measured", "")]
    true_pose = _true_pose(log)
    if true_pose is not None:
        curves.append((true_pose, TRUE, "true", ", true "))
    panels = figure.subplots(3, 1, sharex=True)
    titles = ["RMSE "] * len(panels)
    for pose, line, label, word in curves:
        error = pose_error(pose, log["reference"])
        rmse = np.sqrt(np.mean(error**2, axis=0))
        for entry, (axes, unit) in enumerate(zip(panels, _UNITS, strict=True)):
            axes.plot(log["time"], error[:, entry], label=label, zorder=3, **line)
            titles[entry] += f"{word}{rmse[entry]:.4f} {unit}"
    for axes, symbol, unit, title in zip(panels, _SYMBOLS, _UNITS, titles, strict=True):
        axes.axhline(0.0, color="black", lw=0.6)
        axes.set(ylabel=rf"${symbol}-{symbol}_{{\mathrm{{ref}}}}$ [{unit}]")
        axes.set_title(title, loc="right", fontsize=9)
    if true_pose is not None:
        handles = panels[0].get_legend_handles_labels()
        figure.legend(*handles, loc="outside upper center", ncols=2)
    set_time_axis(panels[-1], log["time"])
    figure.align_ylabels()
    return figure


def input_figure(log: Log, input_limit: float) -> Figure:
    """Draws applied and nominal wheel commands, the tightened bounds and the input set."""
    figure = Figure(figsize=(5.2, 6.0), layout="constrained")
    panels = figure.subplots(4, 1, sharex=True)
    time, plans = log["time"], "nominal_input" in log
    for wheel, axes in enumerate(panels):
        if plans:
            lower, upper = log["input_lower"][:, wheel], log["input_upper"][:, wheel]
            axes.fill_between(time, lower, upper, step="post", color="0.93", lw=0)
            for bound, label in ((lower, "tightened bounds"), (upper, None)):
                axes.step(time, bound, where="post", color="0.45", lw=0.8, label=label)
        for limit, label in ((-input_limit, "input set"), (input_limit, None)):
            axes.axhline(limit, color="black", lw=0.8, ls=":", label=label)
        applied = log["applied_input"][:, wheel]
        axes.step(time, applied, where="post", label="applied", **ACTUAL)
        if plans:
            nominal = log["nominal_input"][:, wheel]
            axes.step(time, nominal, where="post", label="nominal", **NOMINAL)
        axes.set_ylim(-1.12 * input_limit, 1.12 * input_limit)
        axes.set_ylabel(f"$u_{wheel + 1}$ [%]")
        axes.set_title(WHEELS[wheel].replace("_", " "), loc="right", fontsize=9)
    set_time_axis(panels[-1], time)
    figure.align_ylabels()
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


def save_figures(log: Log, folder: Path, *, input_limit: float) -> list[Path]:
    """Writes the figures of a run as PDF, SVG and PNG.

    Args:
        log: Arrays of the run, as in ``log.npz``.
        folder: Where to.
        input_limit: [pwm] bound of the input set.

    Returns:
        The files written.

    Raises:
        UserError: when the folder cannot be written.
    """
    draw: tuple[Callable[[], Figure], ...] = (
        lambda: path_figure(log),
        lambda: error_figure(log),
        lambda: input_figure(log, input_limit),
    )
    return write_figures(dict(zip(FIGURES, draw, strict=True)), folder)


def _true_pose(log: Log) -> np.ndarray | None:
    """Returns where the robot really was, where that is known and not what was measured."""
    true_pose = log.get("true_pose")
    return None if true_pose is None or np.array_equal(true_pose, log["pose"]) else true_pose
