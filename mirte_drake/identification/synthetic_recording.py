"""Recordings of a robot whose dynamics are known: to try the identification, or without a robot."""

import dataclasses as dc

import numpy as np

from mirte_drake.angles import rotation
from mirte_drake.checks import check_array, check_number
from mirte_drake.control.excitation import ExcitationConfig, excitation
from mirte_drake.control.reference_paths import integrate_body_velocity
from mirte_drake.identification.recorded_run import RecordedRun
from mirte_drake.identification.validation import body_velocity
from mirte_drake.model.model_file import load_model
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.vectors import POSE, POSE_SIZE, YAW

# [m/s, m/s, rad/s] One step of the odometry over 0.1 s, as a body velocity.
VELOCITY_QUANTA = np.array([0.000607, 0.000607, 0.00270])
QUANTA_PERIOD = 0.1  # [s]


@dc.dataclass
class SyntheticRecordingConfig:
    """Excitation and odometry of a synthetic recording."""

    excitation: ExcitationConfig = dc.field(default_factory=ExcitationConfig)
    period: float = 0.1  # [s] Sample time.
    velocity_noise: np.ndarray = dc.field(  # (3,) [m/s, m/s, rad/s] standard deviation of w.
        default_factory=lambda: np.zeros(POSE_SIZE)
    )
    quantised: bool = True  # Whether odometry comes in whole quanta, as the robot's does.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        self.excitation.validate()
        check_number("period", self.period, above=0)
        check_array("velocity_noise", self.velocity_noise, (POSE_SIZE,), minimum=0)


def synthetic_recording(
    model: PredictionModel | None = None,
    config: SyntheticRecordingConfig | None = None,
    *,
    seed: int = 0,
) -> RecordedRun:
    """Records a model that is driven by algorithm 1.

    Args:
        model: The robot; by default the published extended kinematic model.
        config: Excitation and odometry; by default the thesis's, without noise.
        seed: Seed >= 0 of excitation and noise.

    Raises:
        ValueError: when ``config`` is out of range.
    """
    config = config or SyntheticRecordingConfig()
    config.validate()
    model = model or load_model("extended_kinematic")
    commands = excitation(config.excitation, seed, config.period)
    return recording_of(model, commands, config, seed=seed)


def recording_of(
    model: PredictionModel,
    wheel_command: np.ndarray,
    config: SyntheticRecordingConfig,
    *,
    seed: int = 0,
) -> RecordedRun:
    """Records a model that starts at rest at the origin, under any commands.

    The body velocity of a row is the mean over the sample before it, in whole quanta. The quanta
    are those of the distance travelled, so what is left over counts in the next sample, as with
    encoders. The pose integrates that velocity along arcs. Noise is a further body velocity, drawn
    for each sample, that the robot moves with: the w of the tube, seen by the wheels.

    Deviation: the robot turns each increment into the world by the yaw at its end; along arcs the
    pose is the model's own where nothing is quantised.

    Args:
        model: The robot; states beyond the pose start at zero.
        wheel_command: (N, m) [pwm], N >= 2; row k is held from row k to row k + 1.
        config: Period and odometry; the excitation is not used.
        seed: Seed >= 0 of the noise.

    Returns:
        The recording, of N rows.

    Raises:
        ValueError: when ``config`` or the shape of ``wheel_command`` is wrong.
    """
    config.validate()
    count, period = len(wheel_command), config.period
    check_array("wheel_command", wheel_command, (max(count, 2), model.num_inputs))
    noise = np.random.default_rng(seed).normal(size=(count - 1, POSE_SIZE)) * config.velocity_noise
    velocity = noise + _mean_body_velocity(model, wheel_command[:-1], noise, period)
    if config.quantised:
        quantum = QUANTA_PERIOD * VELOCITY_QUANTA
        travelled = np.round(np.cumsum(period * velocity, axis=0) / quantum)
        velocity = np.diff(travelled, axis=0, prepend=0.0) * quantum / period
    return RecordedRun(
        time=period * np.arange(count),
        pose=integrate_body_velocity(velocity, np.zeros(POSE_SIZE), period),
        body_velocity=np.vstack([np.zeros(POSE_SIZE), velocity]),
        wheel_command=np.array(wheel_command, dtype=float),
        source=f"synthetic recording of {model.name}, seed {seed}",
    )


def _mean_body_velocity(
    model: PredictionModel, inputs: np.ndarray, noise: np.ndarray, period: float
) -> np.ndarray:
    """Returns the model's mean body velocity (N, 3) over each sample of held input and noise.

    Simpson's rule, of the order of the RK4 step.
    """
    x, means = np.zeros(model.num_states), np.empty_like(noise)
    for k, (u, w) in enumerate(zip(inputs, noise, strict=True)):
        middle, end = model.step(x, u, period / 2), model.step(x, u, period)
        nodes = body_velocity(model, np.stack([x, middle, end]), np.broadcast_to(u, (3, len(u))))
        means[k] = np.array([1, 4, 1]) / 6 @ nodes
        x = end
        x[POSE] += period * rotation(middle[YAW]) @ w
    return means
