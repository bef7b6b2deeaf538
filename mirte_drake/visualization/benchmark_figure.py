"""The figure of a benchmark: how long solvers take, and how that grows with the horizon."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from mirte_drake.visualization.style import FORMATS, SOLVERS, Line, write_figures

BENCHMARK_FILES = tuple(f"benchmark.{suffix}" for suffix in FORMATS)

_BINS_PER_DECADE = 30
_PAUSED: dict[str, Any] = {"marker": "o", "ms": 4, "mfc": "white", "mew": 0.8}
_HEIGHT = 0.5  # Of the tallest bin, where solvers stand one apart.


def benchmark_figure(
    solve_time: Mapping[str, np.ndarray],
    after_pause: Mapping[str, np.ndarray],
    period: float,
    horizons: Sequence[int],
    scaling: Mapping[str, np.ndarray],
) -> Figure:
    """Draws the distributions of solve times, and the medians over the horizon.

    Args:
        solve_time: (S,) [s] of every solver, by its name.
        after_pause: (S,) [s] the same after pauses.
        period: [s] of the controller.
        horizons: (H,) in samples.
        scaling: (H,) [s] medians of every solver, NaN where unknown.
    """
    figure = Figure(figsize=(7.2, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.15, 1))
    styles = dict(zip(solve_time, SOLVERS, strict=False))
    # The fastest on top, as a table would have it.
    names = sorted(solve_time, key=lambda name: np.median(solve_time[name]), reverse=True)
    _draw_distributions(left, [(name, 1e3 * solve_time[name], styles[name]) for name in names])
    for level, name in enumerate(names):
        left.plot(1e3 * np.median(after_pause[name]), level, color=styles[name]["color"], **_PAUSED)
    left.axvline(1e3 * period, color="black", lw=0.9, ls=":")
    left.text(1e3 * period, len(names) - 0.12, "sample time ", ha="right", va="top", fontsize=8)
    for name in reversed(names):
        if name in scaling:
            label = name.replace("_", " ")
            right.plot(horizons, 1e3 * scaling[name], label=label, **styles[name])
    _draw_slopes(right, horizons, scaling)
    right.axhline(1e3 * period, color="black", lw=0.9, ls=":")
    right.set(xscale="log", yscale="log", xlabel="horizon [samples]", ylabel="median [ms]")
    right.set_xticks(horizons, [str(horizon) for horizon in horizons])
    right.minorticks_off()
    right.yaxis.set_major_formatter(FuncFormatter(_plain))
    right.legend(
        loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, fontsize=8, handlelength=2.8
    )
    return figure


def save_benchmark_figure(
    solve_time: Mapping[str, np.ndarray],
    after_pause: Mapping[str, np.ndarray],
    period: float,
    horizons: Sequence[int],
    scaling: Mapping[str, np.ndarray],
    folder: Path,
) -> list[Path]:
    """Writes ``benchmark_figure`` as PDF, SVG and PNG; arguments as there.

    Raises:
        UserError: when the folder cannot be written.
    """
    return write_figures(
        {"benchmark": lambda: benchmark_figure(solve_time, after_pause, period, horizons, scaling)},
        folder,
    )


def _draw_distributions(axes: Axes, rows: list[tuple[str, np.ndarray, Line]]) -> None:
    """Draws a histogram of each solver's times [ms] on its own line, with median, p99 and max."""
    for level, (_, times, style) in enumerate(rows):
        first, last = np.log10(times.min()), np.log10(times.max())
        edges = np.arange(np.floor(first * _BINS_PER_DECADE), last * _BINS_PER_DECADE + 2)
        edges = 10.0 ** (edges / _BINS_PER_DECADE)
        share, _ = np.histogram(times, edges)
        top = level + _HEIGHT * share / share.max()
        axes.stairs(top, edges, baseline=level, fill=True, color=style["color"], alpha=0.3, lw=0)
        axes.stairs(top, edges, baseline=level, color=style["color"], lw=0.8)
        median, tail, most = np.percentile(times, [50, 99, 100])
        axes.plot([median, most], [level, level], color=style["color"], lw=0.8)
        for value, marker, size in ((median, "o", 4), (tail, "|", 7), (most, ">", 3.5)):
            axes.plot(value, level, marker=marker, color=style["color"], ms=size, clip_on=False)
        axes.annotate(
            f"{median:.2g}" if median < 10 else f"{median:.0f}",
            (median, level),
            xytext=(0, -4),
            textcoords="offset points",
            ha="center",
            va="top",
            fontsize=8,
        )
    # What the markers mean, beside the first line that is drawn.
    for label, marker, size in (("median", "o", 4), ("99 %", "|", 7), ("longest", ">", 3.5)):
        axes.plot([], [], ls="", marker=marker, color="0.3", ms=size, label=label)
    axes.plot([], [], ls="", color="0.3", label="median after a pause", **_PAUSED)
    axes.set_yticks(range(len(rows)), [name.replace("_", " ") for name, _, _ in rows])
    axes.set(xscale="log", xlabel="solve time [ms]", ylim=(-0.5, len(rows)))
    axes.xaxis.set_major_formatter(FuncFormatter(_plain))
    axes.grid(axis="y", visible=False)
    axes.tick_params(axis="y", length=0)
    axes.legend(
        loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4, fontsize=8, handletextpad=0.1
    )


def _draw_slopes(axes: Axes, horizons: Sequence[int], scaling: Mapping[str, np.ndarray]) -> None:
    """Draws lines of growth 1 and 3 below everything, to compare the slopes with."""
    known = [1e3 * times[0] for times in scaling.values() if np.isfinite(times[0])]
    if not known:
        return
    start = 0.5 * min(known)
    for power, label in ((1, "$N$"), (3, "$N^3$")):
        line = start * (np.array(horizons) / horizons[0]) ** power
        axes.plot(horizons, line, color="0.6", lw=0.7, zorder=1)
        axes.annotate(
            label, (horizons[-1], line[-1]), xytext=(10, 0), textcoords="offset points",
            va="center", fontsize=8, color="0.4", annotation_clip=False,
        )  # fmt: skip


def _plain(value: float, position: int) -> str:
    """Returns 0.1, 1, 10, not powers of ten."""
    return f"{value:g}"
