"""What one run shows: how well, how safely and how calmly the robot drove."""

import dataclasses as dc
from collections.abc import Mapping
from typing import Any

import numpy as np

from mirte_drake.angles import pose_error
from mirte_drake.containment import ROUNDING, of_true_poses
from mirte_drake.run import Run, simulate
from mirte_drake.run_summary import summarise
from mirte_drake.scenario import Scenario
from mirte_drake.vectors import YAW

# A robot so far from its reference is lost. One that only drives loosely, as with the settings of
# the robot program, comes to 0.8 m on a circle of 1 m radius; at more than a quarter turn a robot
# drives away from where it is told to go.
LOST_DISTANCE = 1.0  # [m]
LOST_YAW = np.pi / 2  # [rad]


@dc.dataclass(frozen=True)
class Outcome:
    """What one run shows. Of something that the controller does not have, None."""

    samples: int
    delay: int  # Samples from a plan to when it acts; plans of as many at the end never do.
    x_m: float  # [m] RMSE of the measured pose against the reference.
    y_m: float  # [m]
    yaw_rad: float  # [rad]
    true_x_m: float  # [m] RMSE of where the robot really is.
    true_y_m: float  # [m]
    true_yaw_rad: float  # [rad]
    max_distance_m: float  # [m] Largest distance of the true position from the reference.
    max_yaw_rad: float  # [rad] Largest error of the true yaw.
    lost: bool  # Either is beyond ``LOST_DISTANCE`` or ``LOST_YAW``.
    saturation: float  # Share of samples in which a wheel is at its limit.
    oscillation: float  # [1/s] Sign changes of a wheel command's increments, mean over wheels.
    # Numbers of samples; the first five are those of summary.json.
    solve_failures: int | None
    input_violations: int | None
    rate_violations: int | None
    # The pose that the plan begins around, measured or estimated, is outside the tube around the
    # nominal one. By construction 0, since the solver places the nominal state so.
    tube_violations: int | None
    # It is outside the tube around what was predicted for it a sample before; the first sample
    # has no such prediction.
    successor_violations: int | None
    # The true pose is outside the tube around the nominal one of that time; the first ``delay``
    # samples have none.
    true_violations: int | None
    # One-step errors that a coverage monitor judged, and of them, those that were not in the set in
    # use, and not in the calibrated one.
    errors: int | None
    in_use_misses: int | None
    calibrated_misses: int | None

    @property
    def measured_inside(self) -> float:
        """Share of samples in which a plan begins with its pose in the tube; NaN without one."""
        return _share_inside(self.tube_violations, self.samples)

    @property
    def true_inside(self) -> float:
        """Share of samples in which the true pose is in the tube; NaN without one."""
        return _share_inside(self.true_violations, self.samples - self.delay)

    @property
    def in_use_coverage(self) -> float:
        """Share of one-step errors that the set in use holds; NaN without a monitor."""
        return _share_inside(self.in_use_misses, self.errors or 0)

    @property
    def calibrated_coverage(self) -> float:
        """Share of one-step errors that the calibrated set holds; NaN without a monitor."""
        return _share_inside(self.calibrated_misses, self.errors or 0)

    @property
    def successor_inside(self) -> float:
        """Share of predicted samples whose pose is in the predicted tube; NaN without one."""
        return _share_inside(self.successor_violations, self.samples - 1)


@dc.dataclass(frozen=True)
class Failure:
    """Why a run gave no outcome."""

    error: str


def run_outcome(scenario: Scenario) -> Outcome | Failure:
    """Simulates a scenario and returns what it shows, or why it could not be run.

    Catches whatever is wrong with one run, so that it does not end a campaign of others. Drake
    ends some of them with SystemExit.
    """
    try:
        return outcome(simulate(scenario, ""))
    except (Exception, SystemExit) as error:
        return Failure(" ".join(f"{type(error).__name__}: {error}".split()))


def outcome(run: Run) -> Outcome:
    """Returns what a run of a simulated robot shows."""
    log = run.log
    summary: Mapping[str, Any] = summarise(run)
    error = np.abs(pose_error(log["true_pose"], log["reference"]))
    distance, yaw = float(np.max(np.hypot(error[:, 0], error[:, 1]))), float(np.max(error[:, YAW]))
    errors: dict[str, Any] = {
        **{key: float(value) for key, value in summary["rmse"].items()},
        **{f"true_{key}": float(value) for key, value in summary["true_rmse"].items()},
    }
    return Outcome(
        samples=summary["steps"],
        delay=run.scenario.delay,
        **errors,
        max_distance_m=distance,
        max_yaw_rad=yaw,
        lost=not (distance <= LOST_DISTANCE and yaw <= LOST_YAW),  # One that is NaN is, too.
        saturation=saturation(log["applied_input"], run.scenario.input_limit),
        oscillation=oscillation(log["applied_input"], float(log["time"][-1])),
        solve_failures=summary.get("solve_failures"),
        input_violations=summary.get("input_violations"),
        rate_violations=summary.get("rate_violations"),
        **_tube_violations(run, summary),
        **_misses(summary.get("coverage")),
    )


def _tube_violations(run: Run, summary: Mapping[str, Any]) -> dict[str, Any]:
    if not run.scenario.has_tube:
        return {"tube_violations": None, "successor_violations": None, "true_violations": None}
    return {
        "tube_violations": summary["tube_violations"],
        "successor_violations": summary["successor_violations"],
        "true_violations": of_true_poses(run.log, run.scenario.delay).violations,
    }


def _misses(coverage: Mapping[str, Any] | None) -> dict[str, Any]:
    if coverage is None:
        return {"errors": None, "in_use_misses": None, "calibrated_misses": None}
    misses = {f"{key}_misses": missed for key, missed in coverage["misses"].items()}
    return {"errors": coverage["errors"], **misses}


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


def _share_inside(violations: int | None, samples: int) -> float:
    return np.nan if violations is None or not samples else (samples - violations) / samples
