"""What the robot knows of its motion: encoder ticks, integrated as its base controller does."""

import dataclasses as dc
import math

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
)

from mirte_drake.angles import rotation
from mirte_drake.checks import check_array, check_number
from mirte_drake.geometry import WHEEL_RADIUS, body_velocity
from mirte_drake.model.drivetrain import MAX_DELAY
from mirte_drake.sampling import sample_number
from mirte_drake.vectors import POSE, POSE_SIZE, WHEELS, YAW


@dc.dataclass
class OdometrySensorConfig:
    """Config of OdometrySensor; the defaults are the robot's, without delays."""

    # 1320 gives the quanta of the recordings: their pose increments are whole numbers of them.
    ticks_per_revolution: int = 1320
    period: float = 0.1  # [s] Between readings.
    latency: float = 0.0  # [s] Age of a reading when it arrives; to 1e-6 of the period.
    # [s] At most so much older are the ticks of a reading, at random. The robot's encoders report
    # at 50 Hz, so up to 0.02; its recordings look like 0.007 to 0.017.
    jitter: float = 0.0
    wheel_radius: float = WHEEL_RADIUS  # [m] That the base controller believes in.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_number("ticks_per_revolution", self.ticks_per_revolution, minimum=1)
        check_number("period", self.period, minimum=1e-3)
        check_number("latency", self.latency, minimum=0, maximum=MAX_DELAY)
        check_number("jitter", self.jitter, minimum=0, maximum=self.period)
        check_number("wheel_radius", self.wheel_radius, above=0)


def encoder_ticks(wheel_angles: np.ndarray, ticks_per_revolution: float) -> np.ndarray:
    """Returns the whole ticks counted since the wheels stood at zero.

    The first edge is half a tick away either way, so that the error is within half a tick.

    Args:
        wheel_angles: (..., 4) [rad].
        ticks_per_revolution: Of a wheel.
    """
    return np.floor(wheel_angles * (ticks_per_revolution / (2 * np.pi)) + 0.5)


def body_increment(ticks: np.ndarray, config: OdometrySensorConfig) -> np.ndarray:
    """Returns how far the robot moved in its own frame, (2-3) over one period.

    Args:
        ticks: (..., 4) counted in the period.
        config: Of ticks and wheels.

    Returns:
        (..., 3) [m, m, rad].
    """
    turned = ticks * (2 * np.pi / config.ticks_per_revolution)
    return config.wheel_radius / WHEEL_RADIUS * body_velocity(turned)


def next_pose(pose: np.ndarray, increment: np.ndarray) -> np.ndarray:
    """Returns the pose (3,) after an increment (3,) [m, m, rad] in the body frame.

    The increment is turned into the world by the yaw at its **end**, as the robot's base
    controller does: so turned back, the pose increments of the training recording are whole
    quanta to 1e-11 of one; with the yaw at start or middle they are not.
    """
    return pose + rotation(pose[YAW] + increment[YAW]) @ increment


def tick_age(jitter: float, seed: int, reading: int) -> float:
    """Returns how old the ticks of a reading are [s], a function of its number and the seed.

    Uniform in [0, jitter]. Drawn from a counter-based generator, so a Context needs no generator
    state; its counters are others than those of the disturbance.
    """
    generator = np.random.Generator(np.random.Philox(key=seed, counter=[0, 0, 1, reading]))
    return jitter * generator.uniform()


class OdometrySensor(LeafSystem):
    """Counts encoder ticks and integrates them to a pose, as the robot's base controller does.

    .. pydrake_system::

        name: OdometrySensor
        input_ports:
        - wheel_angles
        output_ports:
        - pose
        - body_velocity

    =================  ===========  ==================  =====================================
    port               type         unit                meaning
    =================  ===========  ==================  =====================================
    wheel_angles (in)  vector (4,)  [rad]               true rotations since the start
    pose               vector (3,)  [m, m, rad]         world frame, yaw unwrapped
    body_velocity      vector (3,)  [m/s, m/s, rad/s]   mean over the period before a reading
    =================  ===========  ==================  =====================================

    A reading is taken ``latency`` before k times the period, and arrives at k times the period,
    where a controller samples; the outputs hold it until the next one arrives. Readings yet to
    arrive wait in the state, so with latency there is no feedthrough.

    Without latency a reading arrives when it is taken. Drake updates the controller's plan before
    any discrete state, so a state alone would show that plan the reading before. Therefore the
    outputs give a reading that is due as the update is about to store it, which is feedthrough.

    With jitter the ticks of a reading are older, never newer, than its instant. The velocity is
    still ticks over the nominal period, so it jumps, as the robot's does: by 5 to 12 % (rms) from
    reading to reading at steady commands, each jump taken back by the next, while its driver's
    clock keeps the period to 0.2 %.

    Deviation: between two readings' instants, ticks older than the instant are those of wheels
    that turned evenly from one to the other.

    Raises:
        ValueError: when ``config``, ``start`` or ``seed`` is out of range (at construction).
    """

    def __init__(self, config: OdometrySensorConfig, *, start: np.ndarray, seed: int = 0) -> None:
        """Declares ports, state and parameter.

        Args:
            config: The config.
            start: (3,) [m, m, rad] pose that the odometry begins with.
            seed: Seed >= 0 of the jitter; a numeric parameter of the Context.
        """
        super().__init__()
        config.validate()
        check_array("start", start, (POSE_SIZE,))
        check_number("seed", seed, minimum=0, maximum=2**53)
        self._config = config
        periods_late = round(config.latency / config.period, 6)
        # Readings on their way at an instant of arrival, and instant of the first reading.
        self._delay = math.ceil(periods_late)
        self._offset = (self._delay - periods_late) * config.period
        self._angles_input = self.DeclareVectorInputPort("wheel_angles", len(WHEELS))
        self._seed = self.DeclareNumericParameter(BasicVector([float(seed)]))
        at_rest = np.concatenate([start, np.zeros(3)])  # Pose and body velocity.
        # The newest reading first.
        self._readings = self.DeclareDiscreteState(np.tile(at_rest, self._delay + 1))
        self._newest = self.DeclareDiscreteState([-1.0])  # Its number.
        self._ticks = self.DeclareDiscreteState(len(WHEELS))  # That it counted.
        self._angles = self.DeclareDiscreteState(len(WHEELS))  # [rad] At its nominal instant.
        sources = {self.time_ticket(), self.xd_ticket()}
        if self._delay == 0:
            sources |= {self._angles_input.ticket(), self.pn_ticket()}
        self.DeclareVectorOutputPort("pose", 3, self._calc_pose, sources)
        self.DeclareVectorOutputPort("body_velocity", 3, self._calc_body_velocity, sources)
        self.DeclarePeriodicDiscreteUpdateEvent(config.period, self._offset, self._update)

    def _number(self, context: Context) -> int:
        """Number of the reading whose instant is now."""
        return round((context.get_time() - self._offset) / self._config.period)

    def _read(self, context: Context) -> tuple[np.ndarray, np.ndarray]:
        """Takes a reading now: pose and body velocity (6,), and the ticks (4,) counted for it."""
        config = self._config
        now, before = self._angles_input.Eval(context), self._value(context, self._angles)
        seed = int(context.get_numeric_parameter(int(self._seed)).GetAtIndex(0))
        age = tick_age(config.jitter, seed, self._number(context))
        ticks = encoder_ticks(
            now - age / config.period * (now - before), config.ticks_per_revolution
        )
        increment = body_increment(ticks - self._value(context, self._ticks), config)
        pose = next_pose(self._value(context, self._readings)[POSE], increment)
        return np.concatenate([pose, increment / config.period]), ticks

    def _value(self, context: Context, index: int) -> np.ndarray:
        return context.get_discrete_state(index).value()

    def _arrived(self, context: Context) -> np.ndarray:
        """The last reading (6,) that has arrived."""
        arrived = int(sample_number(context.get_time(), self._config.period)) - self._delay
        waiting = int(self._value(context, self._newest)[0]) - arrived
        if waiting < 0 and self._delay == 0:
            return self._read(context)[0]
        return self._value(context, self._readings).reshape(self._delay + 1, -1)[max(waiting, 0)]

    def _calc_pose(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._arrived(context)[POSE])

    def _calc_body_velocity(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._arrived(context)[POSE_SIZE:])

    def _update(self, context: Context, next_state: DiscreteValues) -> None:
        reading, ticks = self._read(context)
        earlier = self._value(context, self._readings)[: -len(reading)]
        next_state.set_value(self._readings, np.concatenate([reading, earlier]))
        next_state.set_value(self._newest, [self._number(context)])
        next_state.set_value(self._ticks, ticks)
        next_state.set_value(self._angles, self._angles_input.Eval(context))


def AddOdometrySensor(
    builder: DiagramBuilder,
    config: OdometrySensorConfig,
    *,
    start: np.ndarray,
    seed: int = 0,
    name: str = "odometry_sensor",
) -> OdometrySensor:
    """Adds an OdometrySensor to ``builder``; the caller connects its ports."""
    return builder.AddNamedSystem(name, OdometrySensor(config, start=start, seed=seed))
