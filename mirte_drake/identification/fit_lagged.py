"""Fits a LaggedModel to a recording, by the error of open-loop simulation.

The velocity is simulated over the whole recording from its first row, with the commands held
between rows and nothing measured fed back: it is a prediction over as many steps as the lag
remembers. Compared are means over each sample, which is what odometry measures; errors of the pose
are those of the velocity, piled up.

How much the wheels may differ, and the delay, are chosen on blocks of the recording that are held
out of the fit. A recording that is to validate the result has no part in it.
"""

import dataclasses as dc
from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from mirte_drake.compiled import compiled
from mirte_drake.errors import UserError
from mirte_drake.geometry import PWM_SPEED
from mirte_drake.identification.held_out import (
    BLOCKS,
    VELOCITY_SCALE,
    held_out_error,
    identification_record,
)
from mirte_drake.identification.recorded_run import RecordedRun, check_excitation
from mirte_drake.model.drivetrain import BY_DIRECTION
from mirte_drake.model.lagged_model import LaggedModel, LaggedParameters
from mirte_drake.model.model_file import ModelFile
from mirte_drake.model.term_table import dense

# What the wheels' gains may differ by, and the shape of their table.
GAINS = {"robot": (1, 1), "wheel": (1, 4), "wheel and direction": BY_DIRECTION}
DELAYS = (0, 1, 2)  # [samples]

# Start, least and largest value of what is fitted. Of the axes' gains the first, forward, is 1:
# what is common to all is the wheels' gain.
DEADBAND = (5.0, 0.0, 50.0)  # [pwm]
# [s] Of each axis. A fifth of a sample is as good as none; below it a velocity is so soon forgotten
# that plans do not know at which one to begin.
LAG = (0.2, 0.02, 2.0)
AXIS_GAIN = (0.8, 0.05, 2.0)
WHEEL_GAIN = (PWM_SPEED, 0.02, 1.0)  # [rad/s per pwm]


@dc.dataclass(frozen=True)
class Structure:
    """What may differ, and what is not fitted."""

    gain: str  # A key of GAINS.
    delay: int  # [samples]

    def __str__(self) -> str:
        """Names the structure for a table."""
        return f"gain by {self.gain}, delay {self.delay}"


STRUCTURES = tuple(Structure(gain, delay) for gain in GAINS for delay in DELAYS)


@dc.dataclass(frozen=True)
class LaggedFit:
    """A fitted model, and how it was chosen."""

    parameters: LaggedParameters
    structure: Structure
    velocity_rmse: np.ndarray  # (3,) [m/s, m/s, rad/s] over the recording.
    # Mean square error of held-out samples, in VELOCITY_SCALE, by structure.
    held_out_errors: dict[Structure, float]


def fit_steps(structures: Sequence[Structure] = STRUCTURES) -> int:
    """Returns how many times ``fit_lagged`` calls ``on_step``."""
    return len(structures) * (1 + BLOCKS)


def fit_lagged(
    run: RecordedRun,
    structures: Sequence[Structure] = STRUCTURES,
    *,
    on_step: Callable[[], None] = lambda: None,
) -> LaggedFit:
    """Returns the lagged model that moves as a recording says.

    Args:
        run: The recording.
        structures: To choose from; the one of least held-out error is taken.
        on_step: Called after each of ``fit_steps`` fits.

    Raises:
        UserError: when a wheel's command is constant, or the robot does not move in a direction.
    """
    check_excitation(run)
    if np.any(np.ptp(run.body_velocity, axis=0) == 0):
        raise UserError(
            f"{run.source}: the robot must move forward, sideways and turn; record more motion"
        )
    measured = np.arange(len(run.time)) > 0  # Row 0 is the start, not a result.
    held_out_errors, solutions = {}, {}
    for structure in structures:
        start = _fit(structure, run, measured, _ranges(structure)[0])
        on_step()
        held_out_errors[structure] = _held_out_error(structure, run, measured, start.x, on_step)
        solutions[structure] = start.x
    best = min(structures, key=held_out_errors.__getitem__)
    error = VELOCITY_SCALE * _error(best, run, solutions[best])[measured]
    return LaggedFit(
        _parameters(best, solutions[best]),
        best,
        np.sqrt(np.mean(error**2, axis=0)),
        held_out_errors,
    )


def lagged_model_file(fit: LaggedFit, run: RecordedRun, *, date: str = "") -> ModelFile:
    """Returns the file of a fitted model.

    Args:
        fit: The result.
        run: The recording that it was fitted to.
        date: ISO date.
    """
    names = ("vx_rmse", "vy_rmse", "yaw_rate_rmse")
    return ModelFile(
        name="lagged",
        lagged=fit.parameters,
        identification=identification_record(run, date, fit.structure, fit.held_out_errors),
        training_scores=dict(zip(names, map(float, fit.velocity_rmse.round(5)), strict=True)),
    )


def mean_velocities(model: LaggedModel, run: RecordedRun) -> np.ndarray:
    """Returns the model's body velocity (N, 3), each row the mean over the sample before it.

    Open loop from the measured velocity of row 0, which is that row too.
    """
    rows = np.maximum(np.arange(len(run.time) - 1) - model.delay, 0)
    steady = model.steady_velocity(run.wheel_command[rows])
    lag = dense(model.parameters.lag)
    return _mean_velocities(steady, lag, np.diff(run.time), dense(run.body_velocity[0]))


@compiled
def _mean_velocities(
    steady: np.ndarray, lag: np.ndarray, durations: np.ndarray, start: np.ndarray
) -> np.ndarray:
    means, velocity = np.empty((len(steady) + 1, 3)), start.copy()
    means[0] = start
    for k in range(len(steady)):
        for i in range(3):
            settled, decay = steady[k, i], np.exp(-durations[k] / lag[i])
            way = velocity[i] - settled
            means[k + 1, i] = settled + way * (1.0 - decay) * lag[i] / durations[k]
            velocity[i] = settled + decay * way
    return means


def _error(structure: Structure, run: RecordedRun, x: np.ndarray) -> np.ndarray:
    """Returns the velocity errors (N, 3) in VELOCITY_SCALE."""
    model = LaggedModel("fit", _parameters(structure, x))
    return (mean_velocities(model, run) - run.body_velocity) / VELOCITY_SCALE


def _fit(
    structure: Structure, run: RecordedRun, rows: np.ndarray, guess: np.ndarray
) -> OptimizeResult:
    """Fits the rows (N,) that are True."""
    start, lowest, highest = _ranges(structure)
    return least_squares(
        lambda x: _error(structure, run, x)[rows].ravel(),
        guess,
        bounds=(lowest, highest),
        x_scale=start,
        ftol=1e-6,
        xtol=1e-6,
    )


def _held_out_error(
    structure: Structure,
    run: RecordedRun,
    rows: np.ndarray,
    guess: np.ndarray,
    on_fit: Callable[[], None],
) -> float:
    return held_out_error(
        rows,
        lambda fitted: _fit(structure, run, fitted, guess).x,
        lambda x: _error(structure, run, x),
        on_fit,
    )


def _ranges(structure: Structure) -> np.ndarray:
    """Returns start, least and largest values (3, n)."""
    wheels = int(np.prod(GAINS[structure.gain]))
    return np.array([DEADBAND, *[LAG] * 3, *[AXIS_GAIN] * 2, *[WHEEL_GAIN] * wheels]).T


def _parameters(structure: Structure, x: np.ndarray) -> LaggedParameters:
    gains = x[6:].reshape(GAINS[structure.gain])
    return LaggedParameters(
        axis_gain=np.array([1.0, *x[4:6]]),
        wheel_gain=np.broadcast_to(gains, BY_DIRECTION).copy(),
        deadband=float(x[0]),
        lag=x[1:4].copy(),
        delay=structure.delay,
    )
