"""Scenarios on every robot, over many seeds: how well, how safely and how calmly they drive.

The seed is that of the scenario: it draws the disturbance, where the robot has an input for one
(sindyc, dynamic), and the jitter of the odometry, where it has one (dynamic, multibody).
"""

import csv
import dataclasses as dc
import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mirte_drake.angles import pose_error
from mirte_drake.files import replacing
from mirte_drake.robots.names import robot_override
from mirte_drake.run import (
    ROUNDING,
    Run,
    planned_pose,
    simulate,
    successor_outside,
    summarise,
    versions,
)
from mirte_drake.scenario import load_scenario, scenario_stem

SCENARIOS = tuple(
    f"{prefix}{path}"
    for path in ("rectangle", "circle", "turning_circle", "robot_rectangle", "robot_circle")
    for prefix in ("", "baseline_", "lagged_")
)
# Runs that a process serves. Python systems hold their Diagram by their callbacks, so that it is
# never freed: 1 to 3 MB stay with the process after each run.
BATCH = 50


@dc.dataclass(frozen=True)
class Trial:
    """One run of a comparison."""

    scenario: str  # Name, or path of a YAML file.
    robot: str
    seed: int


@dc.dataclass(frozen=True)
class Outcome:
    """What one run shows. Shares are of samples; those of the tube are NaN where there is none."""

    x_m: float  # [m] RMSE of the measured pose against the reference.
    y_m: float  # [m]
    yaw_rad: float  # [rad]
    true_x_m: float  # [m] RMSE of where the robot really is.
    true_y_m: float  # [m]
    true_yaw_rad: float  # [rad]
    # The measured pose is within the tube around the nominal one. By construction 1, since the
    # solver places the nominal state so.
    measured_inside: float
    true_inside: float  # The true pose is.
    # The measured pose is within the tube around what was predicted for it a sample before.
    successor_inside: float
    saturation: float  # A wheel is at the limit.
    oscillation: float  # [1/s] Sign changes of a wheel command's increments, mean over wheels.
    solve_failures: int  # Number of samples.


FIELDS = tuple(field.name for field in dc.fields(Outcome))


def trials(scenarios: Sequence[str], robots: Sequence[str], runs: int) -> list[Trial]:
    """Returns every scenario on every robot with the seeds 0 to ``runs`` - 1."""
    return [Trial(s, r, seed) for s in scenarios for r in robots for seed in range(runs)]


def run_trials(
    todo: Sequence[Trial],
    overrides: Sequence[str] = (),
    *,
    jobs: int = 1,
    on_run: Callable[[], object] = lambda: None,
) -> list[Outcome]:
    """Runs trials, in as many processes as asked for, and returns what each shows.

    Args:
        todo: What to run.
        overrides: Changes of all scenarios, each as ``path.to.field=value``.
        jobs: Number of processes; 1 runs them in this one.
        on_run: Called after each run, for a progress bar.

    Raises:
        UserError: when a scenario does not load, before anything runs.
    """
    for scenario, robot in dict.fromkeys((trial.scenario, trial.robot) for trial in todo):
        load_scenario(scenario, (robot_override(robot), *overrides))
    run = partial(run_trial, overrides=tuple(overrides))
    outcomes = []
    if jobs == 1:
        for trial in todo:
            outcomes.append(run(trial))
            on_run()
        return outcomes
    for batch in (todo[i : i + jobs * BATCH] for i in range(0, len(todo), jobs * BATCH)):
        # Spawned, not forked: Drake and BLAS have threads.
        with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
            for result in pool.map(run, batch):
                outcomes.append(result)
                on_run()
    return outcomes


def run_trial(trial: Trial, overrides: tuple[str, ...] = ()) -> Outcome:
    """Runs one trial.

    Raises:
        UserError: when the scenario does not load.
    """
    settings = (robot_override(trial.robot), *overrides, f"seed={trial.seed}")
    scenario = load_scenario(trial.scenario, settings)
    return outcome(simulate(scenario, scenario_stem(trial.scenario)))


def outcome(run: Run) -> Outcome:
    """Returns what a run shows."""
    log = run.log
    summary: dict[str, Any] = summarise(run)
    inside = dict.fromkeys(("measured_inside", "true_inside", "successor_inside"), np.nan)
    if run.scenario.has_tube:
        half_width, pose, nominal = log["half_width"], planned_pose(log), log["nominal_pose"]
        late = run.scenario.delay  # Samples from a plan to when it acts.
        known = len(pose) - late
        inside = {
            "measured_inside": _share_inside(pose, nominal, half_width),
            "true_inside": _share_inside(
                log["true_pose"][late:], nominal[:known], half_width[:known]
            ),
            "successor_inside": float(1.0 - np.mean(successor_outside(log))),
        }
    return Outcome(
        **summary["rmse"],
        **{f"true_{key}": value for key, value in summary["true_rmse"].items()},
        **inside,
        saturation=saturation(log["applied_input"], run.scenario.input_limit),
        oscillation=oscillation(log["applied_input"], log["time"][-1]),
        solve_failures=summary["solve_failures"],
    )


def saturation(commands: np.ndarray, limit: float) -> float:
    """Returns the share of the samples at which a wheel is at the limit.

    Args:
        commands: (N, 4) [pwm].
        limit: [pwm]
    """
    return float(np.mean(np.any(np.abs(commands) >= limit - ROUNDING, axis=1)))


def oscillation(commands: np.ndarray, duration: float) -> float:
    """Returns how often increments of a wheel command change their sign [1/s], mean over wheels.

    An increment of zero has no sign: one before and one after it are compared. A command that
    changes its direction at every sample of 0.1 s has 10.

    Args:
        commands: (N, 4) [pwm].
        duration: [s] from the first to the last.
    """
    changes = 0
    for increments in np.diff(commands, axis=0).T:
        rising = increments[np.abs(increments) > ROUNDING] > 0
        changes += int(np.sum(rising[1:] != rising[:-1]))
    return changes / commands.shape[1] / duration


def _share_inside(pose: np.ndarray, center: np.ndarray, half_width: np.ndarray) -> float:
    deviation = np.abs(pose_error(pose, center))
    return float(np.mean(np.all(deviation <= half_width + ROUNDING, axis=1)))


def comparison(todo: Sequence[Trial], outcomes: Sequence[Outcome]) -> dict[str, object]:
    """Returns the medians over the seeds of every scenario on every robot, for a JSON file.

    Solve failures are summed: a median would hide those of a few runs.
    """
    cells: dict[tuple[str, str], list[Outcome]] = {}
    for trial, result in zip(todo, outcomes, strict=True):
        cells.setdefault((trial.scenario, trial.robot), []).append(result)
    return {
        "medians": [
            {
                "scenario": scenario_stem(scenario),
                "robot": robot,
                "runs": len(results),
                **{key: _median([getattr(result, key) for result in results]) for key in FIELDS},
                "solve_failures": sum(result.solve_failures for result in results),
            }
            for (scenario, robot), results in cells.items()
        ],
        "versions": versions(),
    }


def _median(values: list[float]) -> float | None:
    median = float(np.median(values))
    return None if np.isnan(median) else median


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
        measured = "".join(f"{1e3 * row[key]:6.0f}" for key in FIELDS[:3])
        true = "".join(f"{1e3 * row[key]:6.0f}" for key in FIELDS[3:6])
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
            writer.writerow([*dc.astuple(trial), *dc.astuple(result)])
