"""Estimates pose, body velocity and velocity bias, where the next command will find the robot."""

import dataclasses as dc

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
)

from mirte_drake.checks import check_array, check_number
from mirte_drake.control.lagged_axis import observer_gains
from mirte_drake.control.state_observer import correct, innovation, predict
from mirte_drake.model.lagged_model import MAX_DELAY, LaggedModel
from mirte_drake.sampling import sample_number
from mirte_drake.vectors import POSE_SIZE


@dc.dataclass
class StateEstimatorConfig:
    """Config of StateEstimator: standard deviations by axis, forward, sideways, turning."""

    # (3,) [m, m, rad] Of a measured pose: ticks up to 12 ms old at 0.2 m/s.
    pose_noise: np.ndarray = dc.field(default_factory=lambda: np.array([0.001, 0.001, 0.002]))
    # (3,) [m, m, rad] What moves the pose beside the velocity, per sample.
    position_drift: np.ndarray = dc.field(
        default_factory=lambda: np.array([0.0003, 0.0003, 0.0006])
    )
    # (3,) [m/s, m/s, rad/s] What moves the velocity beside the commands, per sample.
    velocity_drift: np.ndarray = dc.field(default_factory=lambda: np.array([0.003, 0.003, 0.006]))
    # (3,) [m/s, m/s, rad/s] By how much the bias changes, per sample.
    bias_drift: np.ndarray = dc.field(default_factory=lambda: np.array([0.0042, 0.0042, 0.0084]))
    estimates_bias: bool = True  # Whether there is a bias at all; else it is zero.
    # [samples] From command to motion, that of measurements to arrive included; null: the model's.
    delay: int | None = None

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        for name in ("pose_noise", "position_drift", "velocity_drift", "bias_drift"):
            check_array(name, getattr(self, name), (POSE_SIZE,), minimum=1e-9)
        if self.delay is not None:
            check_number("delay", self.delay, minimum=0, maximum=MAX_DELAY)

    def gains(self, lag: np.ndarray, period: float) -> np.ndarray:
        """Returns the gains L (3, 3) for lags (3,) [s], see ``observer_gains``."""
        drift = (self.position_drift, self.velocity_drift, self.bias_drift)
        gains = observer_gains(lag, period, self.pose_noise, np.column_stack(drift))
        if not self.estimates_bias:
            gains[:, -1] = 0.0
        return gains


class StateEstimator(LeafSystem):
    """Observes state and bias, and predicts the state over the delay with the commands sent.

    .. pydrake_system::

        name: StateEstimator
        input_ports:
        - pose
        - wheel_command
        output_ports:
        - state
        - bias
        - innovation

    ==================  ===========  ==================  ========================================
    port                type         unit                meaning
    ==================  ===========  ==================  ========================================
    pose (in)           vector (3,)  [m, m, rad]         measured; yaw by any turn
    wheel_command (in)  vector (4,)  [pwm]               u_k, that the wheels are told now
    state               vector (6,)  model's             at k + delay, when u_k begins to act
    bias                vector (3,)  [m/s, m/s, rad/s]   of the velocity that the model settles at
    innovation          vector (3,)  [m, m, rad]         of ``pose``, in the robot's frame; NaN: the
                                                         first, or none
    ==================  ===========  ==================  ========================================

    State, every ``period`` s: the prediction for the next sample of state and bias, the last
    commands, and the outputs, which hold until the next sample. At the first sample the robot
    stands still where it is measured.

    Outputs have feedthrough from ``pose``, not from ``wheel_command``: u_k may depend on them.
    Where the measurement is not finite no output is, but for velocity and bias of zero before the
    first pose; the prediction is: it goes on by the commands alone.

    Raises:
        ValueError: when ``config`` is out of range (at construction).
    """

    def __init__(self, config: StateEstimatorConfig, model: LaggedModel, *, period: float) -> None:
        """Declares ports and state.

        Args:
            config: The config.
            model: The model.
            period: [s] sample time T_s.
        """
        super().__init__()
        config.validate()
        self._period, self._model, self._effective = period, model, model.effective()
        self._delay = model.delay if config.delay is None else config.delay
        self._gains = config.gains(model.parameters.lag, period)
        n, m = model.num_states, model.num_inputs
        self._pose_input = self.DeclareVectorInputPort("pose", POSE_SIZE)
        self._command_input = self.DeclareVectorInputPort("wheel_command", m)
        self._state = self.DeclareDiscreteState(n)
        self._bias = self.DeclareDiscreteState(POSE_SIZE)
        self._begun = self.DeclareDiscreteState(1)  # 1 from the first measured pose on.
        # Effective commands that do not act yet, the oldest first.
        self._sent = self.DeclareDiscreteState(np.zeros(m * self._delay))
        self._newest = self.DeclareDiscreteState([-1.0])  # Number of the last sample.
        self._given = self.DeclareDiscreteState(n + 2 * POSE_SIZE)  # Its outputs.
        sources = {self.time_ticket(), self.xd_ticket(), self._pose_input.ticket()}
        self.DeclareVectorOutputPort("state", n, self._calc_state, sources)
        self.DeclareVectorOutputPort("bias", POSE_SIZE, self._calc_bias, sources)
        self.DeclareVectorOutputPort("innovation", POSE_SIZE, self._calc_innovation, sources)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    @property
    def delay(self) -> int:
        """Samples from command to motion."""
        return self._delay

    @property
    def gains(self) -> np.ndarray:
        """Gains L (3, 3) of each axis; not to be written to."""
        return self._gains

    def _value(self, context: Context, index: int) -> np.ndarray:
        return context.get_discrete_state(index).value()

    def _unsent(self, context: Context) -> np.ndarray:
        return self._value(context, self._sent).reshape(self._delay, self._model.num_inputs)

    def _estimate(self, context: Context) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns state (6,) and bias (3,) of now, and the innovation (3,) that led to them."""
        state, bias = self._value(context, self._state), self._value(context, self._bias)
        pose = self._pose_input.Eval(context)
        if not self._value(context, self._begun)[0]:
            return np.concatenate([pose, state[POSE_SIZE:]]), bias, np.full(POSE_SIZE, np.nan)
        return *correct(state, bias, pose, self._gains), innovation(state, pose)

    def _outputs(self, context: Context) -> np.ndarray:
        """Returns state, bias and innovation (12,) of the last sample, or of one that is due."""
        number = sample_number(context.get_time(), self._period)
        if number <= self._value(context, self._newest)[0]:
            return self._value(context, self._given)
        state, bias, new = self._estimate(context)
        for command in self._unsent(context):
            state = predict(self._effective, state, bias, command, self._period)
        return np.concatenate([state, bias, new])

    def _calc_state(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._outputs(context)[: -2 * POSE_SIZE])

    def _calc_bias(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._outputs(context)[-2 * POSE_SIZE : -POSE_SIZE])

    def _calc_innovation(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._outputs(context)[-POSE_SIZE:])

    def _update(self, context: Context, next_state: DiscreteValues) -> None:
        state, bias = self._value(context, self._state), self._value(context, self._bias)
        begun = bool(self._value(context, self._begun)[0])
        if np.all(np.isfinite(self._pose_input.Eval(context))):
            state, bias, _ = self._estimate(context)
            begun = True
        command = self._model.effective_command(self._command_input.Eval(context))
        acting, *waiting = (*self._unsent(context), command)
        if begun:
            state = predict(self._effective, state, bias, acting, self._period)
        next_state.set_value(self._state, state)
        next_state.set_value(self._bias, bias)
        next_state.set_value(self._begun, [float(begun)])
        next_state.set_value(self._sent, np.ravel(waiting))
        next_state.set_value(self._newest, [float(sample_number(context.get_time(), self._period))])
        next_state.set_value(self._given, self._outputs(context))


def AddStateEstimator(
    builder: DiagramBuilder,
    config: StateEstimatorConfig,
    model: LaggedModel,
    *,
    period: float,
    name: str = "state_estimator",
) -> StateEstimator:
    """Adds a StateEstimator to ``builder``; the caller connects its ports."""
    return builder.AddNamedSystem(name, StateEstimator(config, model, period=period))
