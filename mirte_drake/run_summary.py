"""What is kept of a run: its summary, and the files that it is saved to."""

import importlib.metadata
import platform
from pathlib import Path

import numpy as np

import mirte_drake
from mirte_drake.angles import pose_error
from mirte_drake.containment import ROUNDING, of_plans, of_successors
from mirte_drake.control.plan import SolveStatus
from mirte_drake.files import replacing, write_json
from mirte_drake.run import Run
from mirte_drake.typed_yaml import write_typed

RUN_FILES = ("log.npz", "summary.json", "as_run.scenario.yaml")
REPLAY_FILE = "replay.html"  # What ``replay`` makes of them.


def summarise(run: Run) -> dict[str, object]:
    """Returns the summary of a run, as written to ``summary.json``.

    Of a controller that does not plan, it has nothing about solver, tube and bounds.
    """
    log = run.log
    return {
        "scenario": run.name,
        "seed": run.scenario.seed,
        "steps": len(log["time"]),
        "simulated_time_s": float(log["time"][-1]),
        "wall_time_s": run.wall_time,
        "rmse": _rmse(log["pose"], log["reference"]),
        "true_rmse": _rmse(log["true_pose"], log["reference"]) if "true_pose" in log else None,
        **(_plan_summary(run) if "nominal_plan" in log else {}),
        **({"wire": _wire_summary(run)} if "command_latency_s" in log else {}),
        "versions": versions(),
    }


def _plan_summary(run: Run) -> dict[str, object]:
    """Returns what a controller that plans adds to the summary of a run."""
    log, limit = run.log, run.scenario.input_limit
    assert run.rate_limit is not None
    plans = of_plans(log)
    # What the ancillary law asked for: what is applied has been saturated.
    correction = np.einsum("kij,kj->ki", log["gain"], plans.error)
    stopping = log["status"][:, None] == SolveStatus.STOPPING
    asked = log["nominal_input"] - np.where(stopping, 0.0, correction)
    beyond = np.abs(asked) > limit + ROUNDING
    if "reached" in log:
        beyond |= log["reached"][:, None] < 1.0
    statuses = [SolveStatus(status) for status in log["status"]]
    moves = np.abs(np.diff(log["nominal_input"], axis=0, prepend=0.0))
    return {
        "solve_time_ms": _percentiles(log["solve_time_s"]),
        "feedback_time_ms": _percentiles(log["solve_time_s"] - log["preparation_time_s"]),
        "solver": run.scenario.nominal_nmpc.solver,
        "solve_failures": sum(status.failed for status in statuses),
        "rate_relaxations": sum(status.relaxed for status in statuses),
        "early_solves": sum(status.early for status in statuses),
        "tube_violations": plans.violations,
        "successor_violations": of_successors(log).violations,
        "input_violations": _count(beyond),
        "rate_violations": _count(moves > run.rate_limit + ROUNDING),
        **({"coverage": _coverage_summary(run)} if "coverage" in log else {}),
    }


def _coverage_summary(run: Run) -> dict[str, object]:
    """Returns what a coverage monitor adds to the summary of a run.

    Shares of the one-step errors that the set in use and the calibrated set held, each judged by
    the set as it was before the error.
    """
    log, config, in_use = run.log, run.scenario.coverage_monitor, run.scenario.disturbance_bound
    assert config is not None and in_use is not None
    errors = np.abs(log["prediction_error"])
    seen = np.all(np.isfinite(errors[1:]), axis=1)  # The first sample has no prediction.
    error, bound = errors[1:][seen], log["calibrated_bound"][:-1][seen]
    misses = {"in_use": _count(error > in_use), "calibrated": _count(error > bound)}
    warnings = np.sum(log["coverage_warning"], axis=0)
    return {
        "target": config.target,
        "errors": len(error),
        "misses": misses,
        **{
            key: 1.0 - missed / len(error) if len(error) else None for key, missed in misses.items()
        },
        "beyond_cap": _count(error > config.cap * in_use),
        "mean_calibrated_bound": np.mean(log["calibrated_bound"], axis=0).tolist(),
        "warnings": {"in_use": int(warnings[0]), "calibrated": int(warnings[1])},
    }


def _wire_summary(run: Run) -> dict[str, object]:
    """Returns what a wire adds to the summary of a run."""
    log = run.log
    return {
        "ended": run.ended,
        "command_latency_ms": _percentiles(log["command_latency_s"]),
        "odometry_age_ms": _percentiles(log["odometry_age_s"]),
        "missed_odometry": int(np.sum(~log["fresh_odometry"])),
    }


def _rmse(pose: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    rmse = np.sqrt(np.mean(pose_error(pose, reference) ** 2, axis=0))
    return dict(zip(("x_m", "y_m", "yaw_rad"), rmse, strict=True))


def _percentiles(seconds: np.ndarray) -> dict[str, float]:
    return dict(
        zip(("p50", "p99", "max"), np.percentile(1e3 * seconds, [50, 99, 100]), strict=True)
    )


def _count(violated: np.ndarray) -> int:
    """Number of samples in which any entry is violated."""
    return int(np.sum(violated.any(axis=tuple(range(1, violated.ndim)))))


def versions() -> dict[str, str]:
    """Returns the versions that the numbers depend on."""
    return {
        "mirte_drake": mirte_drake.__version__,
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in ("drake", "numpy", "scipy")},
    }


def save_run(run: Run, folder: Path) -> dict[str, object]:
    """Writes ``RUN_FILES``: log, summary and the scenario as run, each complete or not at all.

    Returns:
        The summary.

    Raises:
        UserError: when the folder cannot be written.
    """
    summary = summarise(run)
    log, summary_file, scenario_file = (folder / name for name in RUN_FILES)
    with replacing(log) as path:
        np.savez_compressed(path, **run.log)  # type: ignore[arg-type]
    write_json(summary, summary_file)
    write_typed(run.scenario, scenario_file)
    return summary
