"""Fits drivetrain and dynamic robot to a recording, by the error of open-loop simulation.

The whole recording is simulated from its first row, with the commands held between rows and
nothing measured fed back. What is fitted is the body velocity, as means over each sample, which
is what odometry measures; errors of the pose are those of the velocity, piled up.

How much the wheels may differ from each other is chosen on blocks of the recording that are held
out of the fit. A recording that is to validate the result has no part in it.

A recording of commands and odometry does not tell everything. Fixed, not fitted, are

- the mass: only the ratios of forces to it are seen;
- the wheels' viscous friction D_v: it acts as more motor damping with less gain, so that
  ``motor_damping`` is beta + D_v / R of (2-13);
- the deadband: it acts as Coulomb friction does;
- motor lag and delay: they lie below a sample, and held-out errors are as good without.

A weak pull towards the start keeps what the data hardly tell, such as sliding beside static
friction, from running away.
"""

import dataclasses as dc
from collections.abc import Callable

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from mirte_drake.errors import UserError
from mirte_drake.identification.held_out import (
    BLOCKS,
    VELOCITY_SCALE,
    held_out_error,
    identification_record,
)
from mirte_drake.identification.recorded_run import RecordedRun, check_excitation
from mirte_drake.identification.robot_validation import simulate_robot
from mirte_drake.identification.validation import Validation
from mirte_drake.model.drivetrain import BY_DIRECTION, DrivetrainParameters
from mirte_drake.model.dynamic_model import DynamicParameters
from mirte_drake.model.robot_file import RobotFile

STARTS = 3  # Of the final fit: the values below, and others around them.
START_SPREAD = 0.3  # Standard deviation of the starts' logarithms.
PULL = 0.02  # Weight of ln(parameter / start) beside a velocity error of VELOCITY_SCALE.
WORST_ERROR = 1e3  # In VELOCITY_SCALE: what a simulation that diverges counts as.

# Start, least and largest value of all that is fitted. First what wheels and directions may
# differ by: [rad/s per pwm], [rad/s].
WHEEL_RANGES = {"gain": (0.19, 0.02, 1.0), "friction": (2.0, 0.02, 20.0)}
RANGES = {
    "motor_damping": (13.0, 1.0, 60.0),
    "yaw_inertia": (0.45, 0.15, 5.0),
    "breakaway": (3.0, 0.01, 20.0),
    "stribeck_speed": (0.1, 0.03, 1.0),
    "roller_friction": (5.0, 0.01, 100.0),
    "roller_speed": (0.1, 0.03, 1.0),
}
SHAPES = {"robot": (1, 1), "wheel": (1, 4), "wheel_direction": BY_DIRECTION}


@dc.dataclass(frozen=True)
class Structure:
    """What gain and friction may differ by; each a key of SHAPES."""

    gain: str
    friction: str

    def __str__(self) -> str:
        """Names the structure for a table."""
        names = (name.replace("_", " and ") for name in (self.gain, self.friction))
        return "gain by {}, friction by {}".format(*names)


STRUCTURES = (
    Structure("robot", "wheel"),
    Structure("wheel", "wheel"),
    Structure("wheel_direction", "wheel"),
    Structure("wheel_direction", "wheel_direction"),
)


@dc.dataclass(frozen=True)
class RobotFit:
    """A fitted robot, and how it was chosen."""

    parameters: DynamicParameters
    structure: Structure
    # Mean square error of held-out samples, in VELOCITY_SCALE, by structure.
    held_out_errors: dict[Structure, float]


def fit_steps(structures: tuple[Structure, ...]) -> int:
    """Returns how many times ``fit_robot`` calls ``on_step``."""
    return len(structures) * (1 + BLOCKS) + STARTS - 1


def fit_robot(
    run: RecordedRun,
    structures: tuple[Structure, ...] = STRUCTURES,
    *,
    seed: int = 0,
    on_step: Callable[[], None] = lambda: None,
) -> RobotFit:
    """Returns the dynamic robot that moves as a recording says.

    Args:
        run: The recording.
        structures: What gain and friction may differ by; the one of least held-out error is taken.
        seed: Of the starts of the final fit; the best of them is taken.
        on_step: Called after each of ``fit_steps`` fits.

    Raises:
        UserError: when a wheel's command is constant, or the robot never moves.
    """
    check_excitation(run)
    if not np.any(run.body_velocity):
        raise UserError(f"{run.source}: the robot does not move; record more motion")
    problem = _Problem(run)
    measured = np.arange(len(run.time)) > 0  # Row 0 is the start, not a result.
    held_out_errors, solutions = {}, {}
    for structure in structures:
        solution = problem.fit(structure, measured, problem.start(structure))
        on_step()
        held_out_errors[structure] = problem.held_out_error(
            structure, measured, solution.x, on_step
        )
        solutions[structure] = solution
    best = min(structures, key=held_out_errors.__getitem__)
    draw = np.random.default_rng(seed)
    results = [solutions[best]]
    for _ in range(STARTS - 1):
        spread = np.exp(START_SPREAD * draw.normal(size=len(solutions[best].x)))
        results.append(problem.fit(best, measured, problem.start(best) + np.log(spread)))
        on_step()
    chosen = min(results, key=lambda result: result.cost)
    return RobotFit(_parameters(best, chosen.x), best, held_out_errors)


def robot_file(
    fit: RobotFit, run: RecordedRun, scores: dict[str, Validation], *, seed: int, date: str
) -> RobotFile:
    """Returns the file of a fitted robot.

    Args:
        fit: The result.
        run: The recording that it was fitted to.
        scores: Validations by recording.
        seed: That was used.
        date: ISO date.
    """
    quantities = ("x [m]", "y [m]", "yaw [rad]", "vx [m/s]", "vy [m/s]", "yaw rate [rad/s]")
    values = {
        label: np.concatenate([score.pose_rmse, score.velocity_rmse])
        for label, score in scores.items()
    }
    return RobotFile(
        name="fitted",
        parameters=fit.parameters,
        identification=identification_record(
            run,
            date,
            fit.structure,
            fit.held_out_errors,
            pull=f"{PULL:g}",
            starts=f"{STARTS}, seed {seed}",
            fixed="mass, viscous friction, deadband, lag, delay",
        ),
        scores={
            f"{label} {quantity}": round(float(value), 4)
            for label, entries in values.items()
            for quantity, value in zip(quantities, entries, strict=True)
        },
    )


class _Problem:
    """Least squares over the logarithms of the parameters."""

    def __init__(self, run: RecordedRun) -> None:
        self._run = run

    def start(self, structure: Structure) -> np.ndarray:
        """Returns the logarithms (n,) of the starting values."""
        return _ranges(structure)[0]

    def error(self, structure: Structure, x: np.ndarray) -> np.ndarray:
        """Returns the velocity errors (N, 3) in VELOCITY_SCALE."""
        _, velocity = simulate_robot(_parameters(structure, x), self._run)
        error = (velocity - self._run.body_velocity) / VELOCITY_SCALE
        return np.clip(np.nan_to_num(error, nan=WORST_ERROR), -WORST_ERROR, WORST_ERROR)

    def held_out_error(
        self,
        structure: Structure,
        rows: np.ndarray,
        guess: np.ndarray,
        on_fit: Callable[[], None],
    ) -> float:
        """Returns the mean square error in rows (N,) held out in turn."""
        return held_out_error(
            rows,
            lambda fitted: self.fit(structure, fitted, guess).x,
            lambda x: self.error(structure, x),
            on_fit,
        )

    def fit(self, structure: Structure, rows: np.ndarray, guess: np.ndarray) -> OptimizeResult:
        """Fits the rows (N,) that are True; its ``x`` (n,) holds logarithms."""
        start, lowest, highest = _ranges(structure)
        weight = 1 / np.sqrt(3 * np.count_nonzero(rows))

        def residuals(x: np.ndarray) -> np.ndarray:
            pull = PULL * (x - start) / np.sqrt(len(x))
            return np.concatenate([weight * self.error(structure, x)[rows].ravel(), pull])

        return least_squares(
            residuals,
            np.clip(guess, lowest + 1e-3, highest - 1e-3),
            bounds=(lowest, highest),
            x_scale=0.1,
            diff_step=1e-4,
            ftol=1e-4,
            xtol=1e-3,
            max_nfev=40,
        )


def _ranges(structure: Structure) -> np.ndarray:
    """Returns the logarithms (3, n) of start, least and largest values."""
    columns = [
        value
        for name, value in WHEEL_RANGES.items()
        for _ in range(int(np.prod(SHAPES[getattr(structure, name)])))
    ]
    return np.log(np.array([*columns, *RANGES.values()]).T)


def _parameters(structure: Structure, x: np.ndarray) -> DynamicParameters:
    """Returns the parameters of logarithms (n,)."""
    shapes = [SHAPES[getattr(structure, name)] for name in WHEEL_RANGES]
    counts = [int(np.prod(shape)) for shape in shapes]
    gain, friction, values = np.split(np.exp(x), np.cumsum(counts))
    gain, friction = (
        np.broadcast_to(part.reshape(shape), BY_DIRECTION).copy()
        for part, shape in zip((gain, friction), shapes, strict=True)
    )
    scalars = dict(zip(RANGES, values.tolist(), strict=True))
    return DynamicParameters(
        drivetrain=DrivetrainParameters(gain=gain, friction=friction), **scalars
    )
