"""The report of several runs beside each other, as a page that stands for itself."""

import dataclasses as dc
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from mirte_drake.visualization.comparison_figures import (
    commands_figure,
    errors_figure,
    paths_figure,
    rmse_figure,
)
from mirte_drake.visualization.page import Page
from mirte_drake.visualization.run_report import POSE_KEYS, POSE_UNITS, ReportedRun

Settings = dict[str, list[ReportedRun]]  # Runs that differ by their seed alone, by a label.

_SAME_PATH = 1e-9  # [m, rad]


@dc.dataclass(frozen=True)
class _Column:
    """A column of the tables."""

    group: str
    title: str
    unit: str
    value: Callable[[ReportedRun], float | None]  # None: a run has none.
    decimals: int
    least_is_best: bool = False


def _rmse(run: ReportedRun, key: str) -> float:
    return 1e3 * run.summary["rmse"][key]


def _true_rmse(run: ReportedRun, key: str) -> float | None:
    return 1e3 * run.summary["true_rmse"][key] if run.odometry else None


def _inside(run: ReportedRun) -> float | None:
    if not run.tube:
        return None
    return 100 * (1 - run.summary["successor_violations"] / run.successors)


def _solve_time(run: ReportedRun, key: str) -> float | None:
    return run.summary["solve_time_ms"][key] if run.plans else None


_COLUMNS = (
    *(
        _Column(group, key.split("_")[0], unit, partial(value, key=key), 1, least_is_best=True)
        for group, value in (("RMSE, measured", _rmse), ("RMSE, true", _true_rmse))
        for key, unit in zip(POSE_KEYS, POSE_UNITS, strict=True)
    ),
    _Column("in the tube", "next pose", "%", _inside, 1),
    _Column("wheels", "at a limit", "%", lambda run: 100 * run.saturation, 1),
    _Column("wheels", "turns", "1/s", lambda run: run.oscillation, 2),
    _Column("solve time", "median", "ms", partial(_solve_time, key="p50"), 2),
    _Column("solve time", "longest", "ms", partial(_solve_time, key="max"), 2),
    _Column("solves", "failed", "", lambda run: run.summary.get("solve_failures"), 0),
)


def comparison_report(runs: Mapping[str, ReportedRun]) -> str:
    """Returns the page: for each path a table, and the runs over each other.

    Args:
        runs: By the name of their folders.

    Raises:
        UserError: when there is more to tell apart than figures can.
    """
    page = Page()
    settings = _settings(runs)
    known = [
        column for column in _COLUMNS if any(column.value(run) is not None for run in runs.values())
    ]
    groups = {column.group: sum(other.group == column.group for other in known) for column in known}
    versions = {tuple(run.summary["versions"].items()): None for run in runs.values()}
    return page.render(
        "comparison.html",
        kicker="mirte_drake: comparison",
        title=f"{len(runs)} runs, {len(settings)} settings",
        repeated=len(runs) > len(settings),
        groups=groups,
        columns=known,
        sections=[_section(page, part, known) for part in _paths(settings)],
        runs=[
            {"label": folder, "note": f"seed {run.summary['seed']}", "cells": _cells([run], known)}
            for folder, run in runs.items()
        ],
        versions=[dict(each) for each in versions],
    )


def _settings(runs: Mapping[str, ReportedRun]) -> Settings:
    """Returns the runs by their setting, under labels as short as tell them apart."""
    groups: dict[str, dict[str, ReportedRun]] = {}
    for folder, run in runs.items():
        setting = re.sub(r"^seed: .*$", "", run.scenario, flags=re.MULTILINE)
        groups.setdefault(setting, {})[folder] = run
    firsts = [next(iter(group.items())) for group in groups.values()]
    for label in (
        lambda folder, run: run.name,
        lambda folder, run: f"{run.name}, {run.robot}",
        lambda folder, run: folder,
    ):
        labels = [label(*first) for first in firsts]
        if len(set(labels)) == len(labels):
            break
    return {
        label: list(group.values()) for label, group in zip(labels, groups.values(), strict=True)
    }


def _paths(settings: Settings) -> list[Settings]:
    """Returns the settings whose runs have the same reference together."""
    parts: list[Settings] = []
    for label, runs in settings.items():
        for part in parts:
            if _same_path(next(iter(part.values()))[0], runs[0]):
                part[label] = runs
                break
        else:
            parts.append({label: runs})
    return parts


def _same_path(one: ReportedRun, other: ReportedRun) -> bool:
    first, second = one.log["reference"], other.log["reference"]
    return first.shape == second.shape and np.allclose(first, second, rtol=0, atol=_SAME_PATH)


def _section(page: Page, settings: Settings, columns: Sequence[_Column]) -> dict[str, Any]:
    logs = {label: [run.log for run in runs] for label, runs in settings.items()}
    rmse = {
        label: np.array([list(run.summary["rmse"].values()) for run in runs])
        for label, runs in settings.items()
    }
    figures: dict[str, Callable[[], Figure]] = {
        "Measured paths, over the reference.": lambda: paths_figure(logs),
        "RMSE of the measured pose: a dot for each run, a bar for the median.": lambda: rmse_figure(
            rmse
        ),
        "Tracking errors: measured pose minus reference.": lambda: errors_figure(logs),
        "Applied wheel commands.": lambda: commands_figure(logs),
    }
    return {
        "title": ", ".join(dict.fromkeys(run.name for runs in settings.values() for run in runs)),
        "rows": _rows(settings, columns),
        "figures": [
            {"caption": caption, "svg": page.plot(draw, caption)}
            for caption, draw in figures.items()
        ],
    }


def _rows(settings: Settings, columns: Sequence[_Column]) -> list[dict[str, Any]]:
    """Returns the rows of a table: medians over the runs, ranges, and which is best."""
    cells = {label: _cells(runs, columns) for label, runs in settings.items()}
    for index, column in enumerate(columns):
        medians = {row[index]["median"] for row in cells.values()} - {None}
        if column.least_is_best and len(medians) > 1:
            for row in cells.values():
                row[index]["best"] = row[index]["median"] == min(medians)
    return [
        {
            "label": label,
            "note": f"{runs[0].controller}, {runs[0].robot} robot"
            + (f", {len(runs)} runs" if len(runs) > 1 else ""),
            "cells": cells[label],
        }
        for label, runs in settings.items()
    ]


def _cells(runs: Sequence[ReportedRun], columns: Sequence[_Column]) -> list[dict[str, Any]]:
    cells = []
    for column in columns:
        values = [value for value in map(column.value, runs) if value is not None]
        median = float(np.median(values)) if values else None
        low, high = (_text(limit(values, default=None), column) for limit in (min, max))
        cells.append({
            "text": _text(median, column),
            "median": median,
            "range": f"{low}–{high}" if low != high else "",
            "best": False,
        })  # fmt: skip
    return cells


def _text(value: float | None, column: _Column) -> str:
    return "-" if value is None else f"{value:.{column.decimals}f}"
