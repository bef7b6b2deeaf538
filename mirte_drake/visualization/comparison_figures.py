"""Runs over each other: paths, errors, wheel commands, and their RMSE over the seeds.

Runs of one setting, which differ by their seed, share a line style.
"""

from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mirte_drake.angles import pose_error
from mirte_drake.errors import UserError
from mirte_drake.vectors import WHEELS
from mirte_drake.visualization.style import COMPARED, REFERENCE, Line, path_size, set_time_axis

Log = Mapping[str, np.ndarray]
Settings = Mapping[str, Sequence[Log]]  # Logs of the runs of each setting, by its label.

T = TypeVar("T")

MAX_SETTINGS = len(COMPARED)  # That lines tell apart in black and white.

_ENTRIES = (("x", "m"), ("y", "m"), (r"\theta", "rad"))


def paths_figure(settings: Settings) -> Figure:
    """Draws the measured paths over the reference, which all runs share."""
    shown = np.concatenate([log["pose"] for logs in settings.values() for log in logs])
    figure = Figure(figsize=path_size(shown[:, :2]), layout="compressed")
    axes = figure.subplots()
    for label, logs, line in _lines(settings):
        for log in logs:
            axes.plot(*log["pose"][:, :2].T, label=label, **line)
    first = next(iter(settings.values()))[0]
    axes.plot(*first["reference"][:, :2].T, label="reference", zorder=3, **REFERENCE)
    axes.set(xlabel="$x$ [m]", ylabel="$y$ [m]", aspect="equal")
    _legend(figure, axes)
    return figure


def errors_figure(settings: Settings) -> Figure:
    """Draws the tracking errors of the measured pose over time."""
    figure = Figure(figsize=(5.2, 4.8), layout="constrained")
    panels = figure.subplots(len(_ENTRIES), 1, sharex=True)
    for label, logs, line in _lines(settings):
        for log in logs:
            error = pose_error(log["pose"], log["reference"])
            for entry, axes in enumerate(panels):
                axes.plot(log["time"], error[:, entry], label=label, **line)
    for axes, (symbol, unit) in zip(panels, _ENTRIES, strict=True):
        axes.axhline(0.0, color="black", lw=0.6)
        axes.set_ylabel(rf"${symbol}-{symbol}_{{\mathrm{{ref}}}}$ [{unit}]")
    _over_time(figure, panels, settings)
    return figure


def commands_figure(settings: Settings) -> Figure:
    """Draws the applied wheel commands over time."""
    figure = Figure(figsize=(5.2, 6.0), layout="constrained")
    panels = figure.subplots(len(WHEELS), 1, sharex=True, sharey=True)
    for label, logs, line in _lines(settings):
        for log in logs:
            for wheel, axes in enumerate(panels):
                command = log["applied_input"][:, wheel]
                axes.step(log["time"], command, where="post", label=label, **line)
    for wheel, axes in enumerate(panels):
        axes.set_ylabel(f"$u_{wheel + 1}$ [%]")
        axes.set_title(WHEELS[wheel].replace("_", " "), loc="right", fontsize=9)
    _over_time(figure, panels, settings)
    return figure


def rmse_figure(rmse: Mapping[str, np.ndarray]) -> Figure:
    """Draws the RMSE of every run as a dot, and the median of each setting as a bar.

    Args:
        rmse: (R, 3) [m, m, rad] of the runs of each setting, by its label.
    """
    figure = Figure(figsize=(5.2, 0.9 + 0.36 * len(rmse)), layout="constrained")
    panels = figure.subplots(1, len(_ENTRIES), sharey=True)
    for level, (_, values, line) in enumerate(_styled(rmse)):
        for entry, axes in enumerate(panels):
            runs = 1e3 * values[:, entry]
            axes.plot(runs, np.full(len(runs), level), "o", color=line["color"], ms=4, alpha=0.6,
                      mew=0)  # fmt: skip
            axes.plot(np.median(runs), level, "|", color=line["color"], ms=13, mew=2)
    for axes, (symbol, unit) in zip(panels, _ENTRIES, strict=True):
        axes.set_title(f"${symbol}$ [m{unit}]")
        axes.set_xlim(0.0, 1.08 * axes.dataLim.xmax)
        axes.set_ylim(len(rmse) - 0.5, -0.5)
        axes.tick_params(axis="y", length=0)
    panels[0].set_yticks(range(len(rmse)), list(rmse))
    return figure


def _lines(settings: Settings) -> list[tuple[str, Sequence[Log], Line]]:
    """Returns label, logs and line of each setting; the line is thin where there are many."""
    return [
        (label, logs, line if len(logs) == 1 else {**line, "lw": 0.7})
        for label, logs, line in _styled(settings)
    ]


def _styled(settings: Mapping[str, T]) -> list[tuple[str, T, Line]]:
    if len(settings) > MAX_SETTINGS:
        raise UserError(
            f"figures tell at most {MAX_SETTINGS} settings apart, got {len(settings)}: "
            f"{', '.join(settings)}; compare fewer at once"
        )
    return [(*item, line) for item, line in zip(settings.items(), COMPARED, strict=False)]


def _over_time(figure: Figure, panels: Sequence[Axes], settings: Settings) -> None:
    times = [log["time"] for logs in settings.values() for log in logs]
    set_time_axis(panels[-1], max(times, key=len))
    figure.align_ylabels()
    _legend(figure, panels[0])


def _legend(figure: Figure, axes: Axes) -> None:
    """Adds a legend with one entry for each setting, not each run."""
    handles, labels = axes.get_legend_handles_labels()
    entries = dict(zip(labels, handles, strict=True))
    columns = 3 if max(map(len, entries)) < 24 else 2
    figure.legend(entries.values(), entries.keys(), loc="outside upper center", ncols=columns)
