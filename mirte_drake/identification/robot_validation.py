"""Open-loop simulation of a dynamic robot over a recording, and how far off it is."""

import numpy as np

from mirte_drake.errors import UserError
from mirte_drake.identification.recorded_run import RecordedRun
from mirte_drake.identification.validation import Validation, rmse
from mirte_drake.model.dynamic_model import (
    BODY_VELOCITY,
    STATE_SIZE,
    DynamicParameters,
    roll_out,
)
from mirte_drake.vectors import POSE

MAX_STEP = 0.01  # [s] of the simulation.


def simulate_robot(parameters: DynamicParameters, run: RecordedRun) -> tuple[np.ndarray, ...]:
    """Simulates a robot over a recording, open loop, from its first row.

    Args:
        parameters: The robot.
        run: The recording; the command of row k is held from row k to row k + 1, and reaches the
            motors after the drivetrain's delay.

    Returns:
        States (N, 10) at the rows, and body velocities (N, 3) as means over the sample before
        each row, as odometry has it; of row 0 the measured one.
    """
    durations = np.diff(run.time)
    counts = np.ceil(durations / MAX_STEP - 1e-9).astype(int)
    steps = np.repeat(durations / counts, counts)
    middles = run.time[0] + np.cumsum(steps) - 0.5 * steps
    rows = np.searchsorted(run.time, middles - parameters.drivetrain.delay, side="right") - 1
    start = np.zeros(STATE_SIZE)
    start[POSE], start[BODY_VELOCITY] = run.pose[0], run.body_velocity[0]
    states = roll_out(parameters, start, run.wheel_command[np.maximum(rows, 0)], steps)
    velocity = states[:, BODY_VELOCITY]
    travelled = 0.5 * (velocity[1:] + velocity[:-1]) * steps[:, None]
    ends = np.concatenate([[0], np.cumsum(counts)])
    means = np.add.reduceat(travelled, ends[:-1]) / durations[:, None]
    return states[ends], np.vstack([run.body_velocity[:1], means])


def validate_robot(name: str, parameters: DynamicParameters, run: RecordedRun) -> Validation:
    """Simulates a robot over a recording, open loop, and compares.

    Raises:
        UserError: when the simulation diverges.
    """
    states, velocity = simulate_robot(parameters, run)
    if not np.all(np.isfinite(states)):
        raise UserError(f"robot {name}: the open-loop simulation of {run.source} diverges")
    return Validation(
        model=name,
        integrator="zoh",
        states=states,
        body_velocity=velocity,
        pose_rmse=rmse(states[:, POSE], run.pose),
        velocity_rmse=rmse(velocity, run.body_velocity),
    )
