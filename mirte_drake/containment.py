"""Errors of a run's poses beside what its tube allows them.

Logs are those of ``run``. The lag-aware tube bounds errors in the robot's frame, of pose and
velocity; the others bound those of the pose in the world frame.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from mirte_drake.angles import pose_error
from mirte_drake.control.lagged_law import tracking_error
from mirte_drake.vectors import POSE, POSE_SIZE

ROUNDING = 1e-9  # Where a bound is met exactly, in the unit of whatever is bounded.

Log = Mapping[str, np.ndarray]


class TubeErrors(NamedTuple):
    """Errors (K, n) of samples, and the bounds (K, n) that the tube has on them.

    Of a sample without a measurement, which is NaN, nothing is beyond.
    """

    error: np.ndarray
    bound: np.ndarray

    @property
    def outside(self) -> np.ndarray:
        """Tells (K, n) which are beyond."""
        return np.abs(self.error) > self.bound + ROUNDING

    @property
    def violations(self) -> int:
        """Number of samples of which any entry is beyond."""
        return int(np.sum(np.any(self.outside, axis=1)))


def of_plans(log: Log) -> TubeErrors:
    """Returns those of the pose that a plan begins around, against its nominal one."""
    return TubeErrors(pose_error(_planned_pose(log), log["nominal_pose"]), log["half_width"])


def of_successors(log: Log) -> TubeErrors:
    """Returns those of all but the first sample, against what the one before predicted."""
    if "error_bound" not in log:
        error = pose_error(_planned_pose(log)[1:], log["nominal_next"][:-1])
        return TubeErrors(error, log["half_width"][1:])
    predicted = np.hstack([log["nominal_next"], log["nominal_next_velocity"]])
    return _lagged(log["state"][1:], predicted[:-1], log["error_bound"][1:])


def of_true_poses(log: Log, delay: int) -> TubeErrors:
    """Returns those of where the robot is, against the nominal pose of that time.

    Args:
        log: The log.
        delay: [samples] After which a plan acts; as many samples at the begin have none.
    """
    true, nominal = log["true_pose"][delay:], log["nominal_pose"]
    known = len(true)
    if "error_bound" not in log:
        return TubeErrors(pose_error(true, nominal[:known]), log["half_width"][:known])
    # A velocity of none beside each: only the pose counts.
    states, plans = (np.hstack([poses, np.zeros_like(poses)]) for poses in (true, nominal[:known]))
    errors = _lagged(states, plans, log["error_bound"][:known])
    return TubeErrors(errors.error[:, :POSE_SIZE], errors.bound[:, :POSE_SIZE])


def _planned_pose(log: Log) -> np.ndarray:
    """Returns the poses (K, 3) that plans begin around: estimated ahead where a state is."""
    return log["state"][:, POSE] if "state" in log else log["pose"]


def _lagged(states: np.ndarray, nominal: np.ndarray, bound: np.ndarray) -> TubeErrors:
    error = tracking_error(states, nominal).swapaxes(-1, -2)
    return TubeErrors(error.reshape(len(states), -1), bound)
