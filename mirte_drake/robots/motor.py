"""The motors: what speed each wheel is driven to by a wheel command."""

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
from mirte_drake.geometry import PWM_SPEED
from mirte_drake.vectors import WHEELS

_WHEELS = len(WHEELS)


@dc.dataclass
class MotorParameters:
    """Gains, deadbands and lags of the motors; the defaults are ideal gains (2-5).

    Rows of gain and deadband: forward, backward; columns as ``vectors.WHEELS``.
    """

    gain: np.ndarray = dc.field(  # (2, 4) [rad/s per pwm] above the deadband.
        default_factory=lambda: np.full((2, _WHEELS), PWM_SPEED)
    )
    deadband: np.ndarray = dc.field(  # (2, 4) [pwm] below it the wheel stands.
        default_factory=lambda: np.zeros((2, _WHEELS))
    )
    # (4,) [s] time constants.
    lag: np.ndarray = dc.field(default_factory=lambda: np.full(_WHEELS, 0.1))

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_array("gain", self.gain, (2, _WHEELS), minimum=0)
        check_array("deadband", self.deadband, (2, _WHEELS), minimum=0)
        check_array("lag", self.lag, (_WHEELS,), minimum=0)


MOTORS = {"clean": MotorParameters(), "drifting": MotorParameters()}


def steady_wheel_speed(command: np.ndarray, motors: MotorParameters) -> np.ndarray:
    """Returns the speeds (4,) [rad/s] that wheel commands (4,) [pwm] lead to."""
    row, wheel = np.where(np.signbit(command), 1, 0), np.arange(_WHEELS)
    beyond = np.maximum(np.abs(command) - motors.deadband[row, wheel], 0.0)
    return np.sign(command) * motors.gain[row, wheel] * beyond


def lag_pole(lag: np.ndarray, period: float) -> np.ndarray:
    """Returns exp(-period / lag), which is 0 without lag."""
    return np.exp(-np.divide(period, lag, out=np.full(len(lag), np.inf), where=lag > 0))


class Motor(LeafSystem):
    """Drives the wheels to the speeds that the commands ask for, with a first-order lag.

    .. pydrake_system::

        name: Motor
        input_ports:
        - wheel_command
        output_ports:
        - desired_state

    ==================  ===========  ============  ==============================================
    port                type         unit          meaning
    ==================  ===========  ============  ==============================================
    wheel_command (in)  vector (4,)  [pwm]         u, clamped to +-100
    desired_state       vector (8,)  [rad, rad/s]  angles, which the plant's motors have no gain
                                                   for, here zero; then wheel speeds
    ==================  ===========  ============  ==============================================

    State, every ``period`` s: s_{k+1} = s + p (s_k - s), s the steady speed and p the pole of
    the lag. No feedthrough.
    """

    def __init__(self, parameters: MotorParameters, *, period: float) -> None:
        """Declares ports and state.

        Args:
            parameters: The motors.
            period: [s] time step of the plant.

        Raises:
            ValueError: when a value is out of range.
        """
        super().__init__()
        parameters.validate()
        check_number("period", period, above=0)
        self._parameters, self._pole = parameters, lag_pole(parameters.lag, period)
        self._command_input = self.DeclareVectorInputPort("wheel_command", _WHEELS)
        state = self.DeclareDiscreteState(2 * _WHEELS)
        self.DeclareStateOutputPort("desired_state", state)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, next_state: DiscreteValues) -> None:
        command = np.clip(self._command_input.Eval(context), -100.0, 100.0)
        steady = steady_wheel_speed(command, self._parameters)
        speed = context.get_discrete_state_vector().value()[_WHEELS:]
        next_state.set_value([*np.zeros(_WHEELS), *(steady + self._pole * (speed - steady))])
