"""Open-loop validation of a model: simulated from a recording's first row, with its inputs.

Nothing is corrected on the way, so errors accumulate: section 3-2-2, tables 3-4 and 3-5.
"""

import dataclasses as dc

import numpy as np

from mirte_drake.angles import rotation
from mirte_drake.checks import check_choice
from mirte_drake.errors import UserError
from mirte_drake.identification.model_structure import BODY_VELOCITIES
from mirte_drake.identification.ode45 import ode45
from mirte_drake.identification.recorded_run import RecordedRun
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.vectors import POSE, POSE_SIZE, YAW

INTEGRATORS = ("zoh", "ode45")
MAX_STEP = 0.01  # [s] of RK4 under "zoh": lags down to this are still followed.
MAX_POSE_STEP = 0.05  # [s] The same where the pose is the only state and nothing lags.


@dc.dataclass(frozen=True)
class Validation:
    """A model's open-loop prediction of a recording, and how far off it is."""

    model: str  # Name of the model.
    integrator: str  # One of INTEGRATORS.
    states: np.ndarray  # (N, n) predicted, one row per sample of the recording.
    body_velocity: np.ndarray  # (N, 3) [m/s, m/s, rad/s] predicted.
    pose_rmse: np.ndarray  # (3,) [m, m, rad]
    velocity_rmse: np.ndarray  # (3,) [m/s, m/s, rad/s]

    @property
    def pose(self) -> np.ndarray:
        """Predicted pose (N, 3) [m, m, rad], yaw unwrapped."""
        return self.states[:, POSE]


def validate_model(
    model: PredictionModel, run: RecordedRun, *, integrator: str = "zoh"
) -> Validation:
    """Simulates a model over a recording, open loop, and compares.

    Yaw errors are not wrapped: both angles are continuous from the same start, so a whole turn
    between them is an error.

    Args:
        model: The model.
        run: The recording; the input of row k is held from row k to row k + 1.
        integrator: ``zoh`` for exact integration of the held inputs, ``ode45`` for what MATLAB
            gives, which steps over switches of the input: as in the thesis, no better.

    Raises:
        ValueError: when the integrator is not known.
        UserError: when the model has not the recording's inputs, or the simulation diverges.
    """
    check_choice("integrator", integrator, INTEGRATORS)
    if model.num_inputs != run.wheel_command.shape[1]:
        raise UserError(
            f"model {model.name}: has {model.num_inputs} inputs, "
            f"the recording {run.wheel_command.shape[1]}"
        )
    run = delayed(run, model.delay)
    simulate = {"zoh": simulate_held_inputs, "ode45": simulate_as_matlab}[integrator]
    with np.errstate(all="ignore"):
        states, inputs = simulate(model, run)
        velocity = body_velocity(model, states, inputs)
    if not np.all(np.isfinite(velocity)):
        raise UserError(f"model {model.name}: the open-loop simulation of {run.source} diverges")
    return Validation(
        model=model.name,
        integrator=integrator,
        states=states,
        body_velocity=velocity,
        pose_rmse=rmse(states[:, POSE], run.pose),
        velocity_rmse=rmse(velocity, run.body_velocity),
    )


def delayed(run: RecordedRun, delay: int) -> RecordedRun:
    """Returns a recording with its commands so many samples later, the first one until then."""
    rows = np.maximum(np.arange(len(run.time)) - delay, 0)
    return dc.replace(run, wheel_command=run.wheel_command[rows])


def rmse(predicted: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Returns the root mean square error (m,) over the rows of two arrays (N, m)."""
    return np.sqrt(np.mean((predicted - measured) ** 2, axis=0))


def measured_states(model: PredictionModel, run: RecordedRun) -> np.ndarray:
    """Returns the model states (N, n) that a recording tells.

    Pose as measured; ``vx``, ``vy``, ``yaw_rate`` the measured velocity, and ``x_dot``, ``y_dot``,
    ``theta_dot`` the same turned into the world frame (2-1); any other state zero.
    """
    rate = np.einsum("kij,kj->ki", rotation(run.pose[:, YAW]), run.body_velocity)
    names = model.states[:POSE_SIZE]
    known = dict(zip(names, run.pose.T, strict=True))
    known |= dict(zip(BODY_VELOCITIES, run.body_velocity.T, strict=True))
    known |= {f"{name}_dot": column for name, column in zip(names, rate.T, strict=True)}
    return np.column_stack([known.get(state, np.zeros(len(rate))) for state in model.states])


def body_velocity(model: PredictionModel, states: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Returns the body velocity (..., 3) that a model has at states (..., n), inputs (..., m)."""
    rate = model.derivative(states, inputs)[..., POSE]
    return np.einsum("...ji,...j->...i", rotation(states[..., YAW]), rate)


def simulate_held_inputs(model: PredictionModel, run: RecordedRun) -> tuple[np.ndarray, np.ndarray]:
    """Integrates from sample to sample with the input held (RK4).

    Returns:
        States (N, n) and inputs (N, m) at the samples.
    """
    max_step = MAX_STEP if model.num_states > POSE_SIZE else MAX_POSE_STEP
    states = np.empty((len(run.time), model.num_states))
    states[0] = measured_states(model, run)[0]
    for k, duration in enumerate(np.diff(run.time)):
        count = int(np.ceil(duration / max_step))
        x = states[k]
        for _ in range(count):
            x = model.step(x, run.wheel_command[k], duration / count)
        states[k + 1] = x
    return states, run.wheel_command


def simulate_as_matlab(model: PredictionModel, run: RecordedRun) -> tuple[np.ndarray, np.ndarray]:
    """Integrates with ode45, on evenly spaced times, as the thesis's program does.

    It looks the input up by time ('previous') on ``linspace(0, T, N)`` and asks for output at
    ``0:dt:T``. The two grids differ by round-off, so that at some samples the input found, and
    with it a kinematic model's velocity, is the one of the row before.

    Returns:
        States (N, n) and inputs (N, m) as found at the samples.

    Raises:
        UserError: when the tolerance cannot be met.
    """
    input_times, output_times = matlab_grids(float(run.time[-1] - run.time[0]), len(run.time))

    def input_at(t: float | np.ndarray) -> np.ndarray:
        row = np.searchsorted(input_times, t, side="right") - 1
        return run.wheel_command[row]

    start = measured_states(model, run)[0]
    try:
        solution = ode45(
            lambda t, x: model.derivative(x, input_at(t)),
            output_times,
            start,
        )
    except ArithmeticError as error:
        raise UserError(f"model {model.name}: {run.source}: {error}") from None
    return solution.states, input_at(output_times)


def matlab_grids(end: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns the times (count,) of MATLAB's linspace(0, end, count) and 0:dt:end, to the bit.

    dt is the second entry of the former. The colon operator counts up from its first entry in
    the first half and down from its last one in the second.

    Args:
        end: T [s].
        count: N, at least two.
    """
    rows = np.arange(count)
    linspace = rows * end / (count - 1)
    linspace[-1] = end
    dt = linspace[1]
    colon = np.where(rows <= (count - 1) // 2, rows * dt, end - (count - 1 - rows) * dt)
    if count % 2 == 1:
        colon[(count - 1) // 2] = end / 2
    return linspace, colon
