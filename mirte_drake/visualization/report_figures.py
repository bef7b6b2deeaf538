"""Figures that a report has beside those of ``figures``: does the tube hold, is it in time."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from mirte_drake.visualization.style import ACTUAL, NOMINAL, set_time_axis

Log = Mapping[str, np.ndarray]

_AXES = (("x", "m"), ("y", "m"), (r"\theta", "rad"))
_VELOCITIES = (("v_x", "m/s"), ("v_y", "m/s"), (r"\dot\theta", "rad/s"))
_OUTSIDE = {"ls": "", "marker": "x", "color": "black", "ms": 6, "mew": 1.4, "zorder": 4}


def tube_figure(
    time: np.ndarray, error: np.ndarray, bound: np.ndarray, outside: np.ndarray
) -> Figure:
    """Draws how far each sample was from what the one before predicted, within the tube.

    Args:
        time: (K,) [s] of all samples.
        error: (K - 1, 3) of the poses, or (K - 1, 6) with velocities.
        bound: The same, of the tube.
        outside: The same, whether the one is beyond the other.
    """
    columns = error.shape[1] // len(_AXES)
    figure = Figure(figsize=(5.2 if columns == 1 else 7.4, 4.6), layout="constrained")
    panels = figure.subplots(len(_AXES), columns, sharex=True, squeeze=False)
    for entry, (axes, (symbol, unit)) in enumerate(
        zip(panels.T.flat, (*_AXES, *_VELOCITIES)[: error.shape[1]], strict=True)
    ):
        half, errors = bound[:, entry], error[:, entry]
        axes.fill_between(time[1:], -half, half, step="mid", color="0.86", lw=0, label="tube")
        axes.axhline(0.0, color="black", lw=0.6)
        axes.plot(time[1:], errors, label="robot", **ACTUAL)
        there = outside[:, entry]
        axes.plot(time[1:][there], errors[there], label="outside", **_OUTSIDE)
        axes.set_ylabel(rf"${symbol}-\bar{{{symbol}}}$ [{unit}]")
        axes.set_title(f"outside {there.sum()} of {len(errors)}", loc="right", fontsize=9)
    for axes in panels[-1]:
        set_time_axis(axes, time)
    figure.align_ylabels()
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def coverage_figure(log: Log, target: float, in_use: np.ndarray) -> Figure:
    """Draws the running coverage of both disturbance sets, and the size of the calibrated one.

    Args:
        log: The log.
        target: Share of errors that a set shall hold.
        in_use: (3,) [m/s, m/s, rad/s] half-widths of the set in use.
    """
    figure = Figure(figsize=(5.2, 3.6), layout="constrained")
    shares, size = figure.subplots(2, 1, sharex=True)
    shares.axhline(100 * target, color="black", lw=0.9, ls=":", label=f"target: {100 * target:g} %")
    for column, (label, line) in enumerate((("set in use", NOMINAL), ("calibrated", ACTUAL))):
        shares.plot(log["time"], 100 * log["coverage"][:, column], label=label, **line)
    shares.set(ylabel="held [%]", ylim=(0, 105))
    bound = log["calibrated_bound"]
    size.plot(log["time"], bound[:, 0] / in_use[0], **ACTUAL)
    size.axhline(1.0, **NOMINAL)
    size.set(ylabel="size [set in use]")
    size.set_ylim(bottom=0)
    set_time_axis(size, log["time"])
    figure.align_ylabels()
    figure.legend(*shares.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def solve_time_figure(log: Log, period: float) -> Figure:
    """Draws the solve time of every sample against the period [s], both in milliseconds."""
    figure = Figure(figsize=(5.2, 2.6), layout="constrained")
    axes = figure.subplots()
    solve_time = 1e3 * log["solve_time_s"]
    axes.plot(log["time"], solve_time, ".", color=ACTUAL["color"], ms=3, label="solve")
    for share, style in ((50, "-"), (99, "--")):
        value = np.percentile(solve_time, share)
        label = "median" if share == 50 else f"{share} %"
        axes.axhline(value, color="black", lw=0.9, ls=style, label=f"{label}: {value:.2g} ms")
    axes.axhline(1e3 * period, color="black", lw=1.2, ls=":", label=f"period: {1e3 * period:g} ms")
    axes.set(yscale="log", ylabel="solve time [ms]")
    set_time_axis(axes, log["time"])
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    figure.legend(loc="outside upper center", ncols=4)
    return figure
