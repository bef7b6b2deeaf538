"""Scenarios on every robot, over many seeds: a campaign with a table of its own.

The seed is that of the scenario: it draws the disturbance, where the robot has an input for one
(sindyc, dynamic), and the jitter of the odometry, where it has one (dynamic, multibody).
"""

import csv
import dataclasses as dc
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mirte_drake.campaign import grid, study
from mirte_drake.campaign.grid import Trial
from mirte_drake.campaign.outcome import Failure, Outcome
from mirte_drake.campaign.statistics import summarise_cells
from mirte_drake.files import replacing
from mirte_drake.robots.names import robot_override
from mirte_drake.run_summary import versions

SCENARIOS = tuple(
    f"{prefix}{path}"
    for path in ("rectangle", "circle", "turning_circle", "robot_rectangle", "robot_circle")
    for prefix in ("", "baseline_", "lagged_")
)
# What is compared, of an Outcome: RMSE, and the shares of samples that follow.
MEDIANS = (
    *("x_m", "y_m", "yaw_rad", "true_x_m", "true_y_m", "true_yaw_rad"),
    *("measured_inside", "true_inside", "successor_inside", "saturation", "oscillation"),
)
FIELDS = (*MEDIANS, "solve_failures")


def trials(
    scenarios: Sequence[str], robots: Sequence[str], runs: int, overrides: Sequence[str] = ()
) -> list[Trial]:
    """Returns every scenario on every robot with the seeds 0 to ``runs`` - 1.

    Raises:
        UserError: when a scenario does not load.
    """
    cells = [
        dc.replace(cell, values=(robot,))
        for scenario in scenarios
        for robot in robots
        for cell in grid.cells([scenario], (), (robot_override(robot), *overrides))
    ]
    return grid.trials(cells, range(runs))


def run_trials(
    todo: Sequence[Trial], *, jobs: int = 1, on_run: Callable[[], object] = lambda: None
) -> list[Outcome]:
    """Runs trials, in as many processes as asked for, and returns what each shows.

    Args:
        todo: What to run.
        jobs: Number of processes; 1 runs them in this one.
        on_run: Called after each run, for a progress bar.

    Raises:
        RuntimeError: when one could not be run.
    """
    backend = "serial" if jobs == 1 else "loky"
    outcomes = []
    for trial, result in zip(
        todo, study.run_trials(todo, backend=backend, jobs=jobs, on_run=on_run), strict=True
    ):
        if isinstance(result, Failure):
            raise RuntimeError(f"{trial.cell.name}, seed {trial.seed}: {result.error}")
        outcomes.append(result)
    return outcomes


def comparison(todo: Sequence[Trial], outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Returns the medians over the seeds of every scenario on every robot, for a JSON file.

    Solve failures are summed: a median would hide those of a few runs.
    """
    return {
        "medians": [
            {
                "scenario": summary.cell.name,
                "robot": summary.cell.values[0],
                "runs": summary.runs,
                **{key: _number(summary.medians[key].value) for key in MEDIANS},
                "solve_failures": summary.counts["solve_failures"],
            }
            for summary in summarise_cells(todo, outcomes)
        ],
        "versions": versions(),
    }


def _number(value: float) -> float | None:
    return None if np.isnan(value) else value


def comparison_text(summary: dict) -> str:
    """Returns the medians as a table; RMSE in mm and mrad."""
    lines = [
        f"{'':36}{'RMSE, odometry':>18}{'RMSE, true':>20}{'in the tube':>16}",
        f"{'scenario':26}{'robot':10}"
        f"{'x':>6}{'y':>6}{'yaw':>6}  {'x':>6}{'y':>6}{'yaw':>6}"
        f"{'true':>8}{'next':>8}{'limit':>8}{'turns':>7}",
        f"{'':36}{'mm':>6}{'mm':>6}{'mrad':>6}  {'mm':>6}{'mm':>6}{'mrad':>6}"
        f"{'%':>8}{'%':>8}{'%':>8}{'1/s':>7}",
    ]
    for row in summary["medians"]:
        measured = "".join(f"{1e3 * row[key]:6.0f}" for key in MEDIANS[:3])
        true = "".join(f"{1e3 * row[key]:6.0f}" for key in MEDIANS[3:6])
        shares = "".join(
            f"{'-':>8}" if row[key] is None else f"{100 * row[key]:8.1f}"
            for key in ("true_inside", "successor_inside", "saturation")
        )
        lines.append(
            f"{row['scenario']:26}{row['robot']:10}{measured}  {true}{shares}"
            f"{row['oscillation']:7.2f}"
        )
    return "\n".join(lines)


def save_runs(todo: Sequence[Trial], outcomes: Sequence[Outcome], path: Path) -> None:
    """Writes every run as a line of a CSV file, complete or not at all.

    Raises:
        UserError: when the file cannot be written.
    """
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["scenario", "robot", "seed", *FIELDS])
        for trial, result in zip(todo, outcomes, strict=True):
            values = [getattr(result, key) for key in FIELDS]
            writer.writerow([trial.cell.name, *trial.cell.values, trial.seed, *values])
