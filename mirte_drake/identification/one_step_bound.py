"""Bounds on the one-step error of a model: the w of the tube (4-19), measured.

How far the pose after one sample is from the model's prediction, with nothing taken out. Each
bound is made from calibration data and judged on data held out from it.
"""

import dataclasses as dc

import numpy as np

from mirte_drake.angles import pose_error, rotation
from mirte_drake.errors import UserError
from mirte_drake.identification.recorded_run import RecordedRun
from mirte_drake.identification.validation import delayed, measured_states
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.vectors import POSE, YAW

BLOCK = 5.0  # [s] Calibration and held-out data take turns in blocks of this length.


@dc.dataclass(frozen=True)
class OneStepBound:
    """A box [-w, w] for the one-step error, and how much of the held-out data it contains."""

    name: str
    w: np.ndarray  # (3,) [m/s, m/s, rad/s] body frame.
    coverage: np.ndarray  # (3,) share of held-out samples within, by axis.
    joint_coverage: float  # Share within on all axes at once.


def one_step_error(model: PredictionModel, run: RecordedRun) -> np.ndarray:
    """Returns w_k (N - 1, 3) [m/s, m/s, rad/s] of x_{k+1} = f(x_k, u_k) + T_s R(yaw_k) w_k.

    T_s is each sample's own duration. For x_k see ``validation.measured_states``.
    """
    turn = rotation(run.pose[:, YAW])
    states, run = measured_states(model, run), delayed(run, model.delay)
    duration = np.diff(run.time)[:, None]
    predicted = model.step(states[:-1], run.wheel_command[:-1], duration)[:, POSE]
    error = pose_error(run.pose[1:], predicted) / duration
    return np.einsum("kji,kj->ki", turn[:-1], error)


def time_blocks(w: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Splits samples (n, m) into calibration and held-out data that take turns every BLOCK.

    Neighbouring samples resemble each other, so a split sample by sample would flatter the bound;
    halves would compare different kinds of driving.

    Raises:
        UserError: when nothing is left to hold out.
    """
    held_out = np.arange(len(w)) // max(1, round(BLOCK / period)) % 2 == 1
    if not np.any(held_out):
        raise UserError(
            f"the recording lasts {len(w) * period:.3g} s: more than {BLOCK:g} s are needed, so "
            "that some of it can be held out"
        )
    return w[~held_out], w[held_out]


def quantile_bound(calibration: np.ndarray, level: float) -> np.ndarray:
    """Returns the quantile (m,) of abs(w) over samples (n, m); the maximum at level 1."""
    return np.quantile(np.abs(calibration), level, axis=0)


def conformal_bound(calibration: np.ndarray, level: float) -> np.ndarray:
    """Returns the split-conformal bound on abs(w) by axis.

    It is the ceil((n + 1) level)-th smallest value. A further sample that is exchangeable with
    the calibration data lies within with probability >= level, whatever the distribution;
    residuals that are correlated in time are exchangeable only nearly.

    Args:
        calibration: (n, m) samples.
        level: 1 - alpha, in (0, 1).

    Raises:
        UserError: when n is too small for the level.
    """
    n = len(calibration)
    rank = int(np.ceil((n + 1) * level - 1e-9))
    if rank > n:
        raise UserError(f"level {level:g} needs more than {n} calibration samples: record longer")
    return np.sort(np.abs(calibration), axis=0)[rank - 1]


def coverage(name: str, w: np.ndarray, held_out: np.ndarray) -> OneStepBound:
    """Returns a box w (m,) with the share of held-out samples (n, m) that it contains."""
    within = np.abs(held_out) <= w
    return OneStepBound(name, w, np.mean(within, axis=0), float(np.mean(np.all(within, axis=1))))
