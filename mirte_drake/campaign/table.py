"""The tables of a campaign: every run as a row, and every cell as one of a summary."""

import csv
import dataclasses as dc
import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mirte_drake.campaign.grid import Trial, Variation
from mirte_drake.campaign.outcome import Failure, Outcome
from mirte_drake.campaign.statistics import CONFIDENCE, CellSummary, Interval
from mirte_drake.files import replacing, write_json
from mirte_drake.run_summary import versions

TABLE_FILES = ("runs.csv", "runs.parquet", "summary.json")
PARQUET_KINDS: dict[Any, str] = {float: "float64", int: "int64", int | None: "int64", bool: "bool"}


def rows(
    variations: Sequence[Variation],
    todo: Sequence[Trial],
    results: Sequence[Outcome | Failure],
) -> list[dict[str, Any]]:
    """Returns every run as a row; of a failed one, its outcome is None, of the others, its error.

    Nothing in it depends on when, where and in how many processes it was run.
    """
    blank = dict.fromkeys(field.name for field in dc.fields(Outcome))
    table = []
    for trial, result in zip(todo, results, strict=True):
        settings = {v.field: value for v, value in zip(variations, trial.cell.values, strict=True)}
        row = {"scenario": trial.cell.name, **settings, "seed": trial.seed, "error": None}
        table.append({**row, **blank, **dc.asdict(result)})
    return table


def save_tables(
    table: Sequence[dict[str, Any]],
    variations: Sequence[Variation],
    summaries: Sequence[CellSummary],
    folder: Path,
) -> None:
    """Writes ``TABLE_FILES``; the Parquet file where pyarrow is installed.

    Raises:
        UserError: when the folder cannot be written.
    """
    with (
        replacing(folder / "runs.csv") as temporary,
        temporary.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.DictWriter(file, list(table[0]))
        writer.writeheader()
        writer.writerows(table)
    if importlib.util.find_spec("pyarrow"):
        _save_parquet(table, folder / "runs.parquet")
    cells = [_cell(variations, summary) for summary in summaries]
    write_json(
        {"cells": cells, "confidence": CONFIDENCE, "versions": versions()}, folder / "summary.json"
    )


def _save_parquet(table: Sequence[dict[str, Any]], path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    kinds = {
        "seed": "int64",
        **{field.name: PARQUET_KINDS[field.type] for field in dc.fields(Outcome)},
    }
    # A column of empty cells says nothing of what could be in it.
    schema = pyarrow.schema([(name, kinds.get(name, "string")) for name in table[0]])
    with replacing(path) as temporary:
        pyarrow.parquet.write_table(pyarrow.Table.from_pylist(list(table), schema), temporary)


def _cell(variations: Sequence[Variation], summary: CellSummary) -> dict[str, Any]:
    values = summary.cell.values
    return {
        "scenario": summary.cell.name,
        **{v.field: value for v, value in zip(variations, values, strict=True)},
        "runs": summary.runs,
        "failed": summary.failed,
        "lost": _json(summary.lost),
        "medians": {key: _json(interval) for key, interval in summary.medians.items()},
        "samples": {
            **summary.counts,
            "measured_inside": _json(summary.measured_inside),
            "true_inside": _json(summary.true_inside),
            "successor_inside": _json(summary.successor_inside),
            "in_use_coverage": _json(summary.in_use_coverage),
            "calibrated_coverage": _json(summary.calibrated_coverage),
        },
    }


def _json(interval: Interval) -> dict[str, float | None] | None:
    """Returns an interval for JSON, which has no NaN."""
    if np.isnan(interval.value):
        return None
    bounds = dc.asdict(interval)
    return {key: None if np.isnan(value) else value for key, value in bounds.items()}


def summary_text(variations: Sequence[Variation], summaries: Sequence[CellSummary]) -> str:
    """Returns the summary as a table for a person to read; RMSE of the true pose in mm and mrad.

    The last two columns, one-step coverage, are there where a coverage monitor was.
    """
    watched = any(not np.isnan(summary.in_use_coverage.value) for summary in summaries)
    head = ["scenario", *(variation.field.split(".")[-1] for variation in variations)]
    lines = [
        [
            *(*head, "runs", "failed", "lost", "x [mm]", "y [mm]", "yaw [mrad]"),
            *("turns [1/s]", "limit [%]", "true [%]", "next [%]"),
            *(("set [%]", "calibrated [%]") if watched else ()),
        ]
    ]
    for summary in summaries:
        outcomes = summary.runs - summary.failed
        lost = "-" if outcomes == 0 else str(round(summary.lost.value * outcomes))
        medians = summary.medians
        lines.append(
            [
                *(summary.cell.name, *summary.cell.values),
                *(str(summary.runs), str(summary.failed), lost),
                *(_text(medians[key], 1e3, 0) for key in ("true_x_m", "true_y_m", "true_yaw_rad")),
                _text(medians["oscillation"], 1, 2),
                _text(medians["saturation"], 100, 1),
                _text(summary.true_inside, 100, 1),
                _text(summary.successor_inside, 100, 1),
                *(
                    _text(interval, 100, 1)
                    for interval in (summary.in_use_coverage, summary.calibrated_coverage)
                    if watched
                ),
            ]
        )
    widths = [max(len(line[i]) for line in lines) for i in range(len(lines[0]))]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if i < len(head) else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(line, widths, strict=True))
        )
        for line in lines
    )


def _text(interval: Interval, factor: float, digits: int) -> str:
    """Returns an interval as ``12 (11-13)``."""
    if np.isnan(interval.value):
        return "-"
    value, low, high = (f"{factor * number:.{digits}f}" for number in dc.astuple(interval))
    return value if np.isnan(interval.low) or np.isnan(interval.high) else f"{value} ({low}-{high})"
