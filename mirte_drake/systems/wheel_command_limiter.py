"""Makes any wheel command one that the motors can take."""

import dataclasses as dc

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from mirte_drake.checks import check_number


@dc.dataclass
class WheelCommandLimiterConfig:
    """Config of WheelCommandLimiter; the defaults are the study's: saturation alone."""

    deadband: float = 0.0  # [pwm] Smaller commands become zero. The robot's own is 10.
    round_to_integer: bool = False  # The robot takes whole percent.
    # [pwm] A wheel's command stays what it was until what is asked for is farther off than this,
    # and then follows at this distance: noise within it turns no motor back and forth.
    play: float = 0.0

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_number("deadband", self.deadband, minimum=0)
        check_number("play", self.play, minimum=0)

    @property
    def error(self) -> float:
        """How far off [pwm] from what is asked for, beyond the deadband and within the limits."""
        return self.play + 0.5 * self.round_to_integer


def with_play(command: np.ndarray, last: np.ndarray, play: float) -> np.ndarray:
    """Returns the last command [pwm], moved to within the play [pwm] of what is asked for.

    The play operator of hysteresis. A wheel that is asked to stop does.
    """
    return np.where(command == 0, 0.0, np.clip(last, command - play, command + play))


def limit_wheel_command(
    command: np.ndarray, *, limit: float, deadband: float, round_to_integer: bool
) -> np.ndarray:
    """Returns the command [pwm] saturated, without the deadband, rounded.

    A command that is not finite stops its wheel.
    """
    finite = np.where(np.isfinite(command), command, 0.0)
    limited = np.clip(finite, -limit, limit)
    limited = np.where(np.abs(limited) < deadband, 0.0, limited)
    # Towards zero where rounding would pass a limit that is no whole number.
    whole = np.floor(limit)
    return np.clip(np.rint(limited), -whole, whole) if round_to_integer else limited


class WheelCommandLimiter(LeafSystem):
    """Gives play, saturates, applies a deadband and rounds the wheel command. Stateless.

    .. pydrake_system::

        name: WheelCommandLimiter
        input_ports:
        - wheel_command
        - last_command
        output_ports:
        - limited_command

    ==================  ===========  =====  =============================================
    port                type         unit   meaning
    ==================  ===========  =====  =============================================
    wheel_command (in)  vector (4,)  [pwm]  asked for; any numbers, even not finite
    last_command (in)   vector (4,)  [pwm]  what the wheels were told last, for the play
    limited_command     vector (4,)  [pwm]  finite, within +-limit
    ==================  ===========  =====  =============================================

    What it gives is what it gives again when that is the last command.

    Raises:
        ValueError: when ``config`` is out of range (at construction).
    """

    def __init__(self, config: WheelCommandLimiterConfig, *, input_limit: float = 100.0) -> None:
        """Declares ports.

        Args:
            config: The config.
            input_limit: [pwm] saturation.
        """
        super().__init__()
        config.validate()
        check_number("input_limit", input_limit, minimum=0)
        self._config, self._limit = config, input_limit
        self._input = self.DeclareVectorInputPort("wheel_command", 4)
        self._last = self.DeclareVectorInputPort("last_command", 4)
        self.DeclareVectorOutputPort(
            "limited_command", 4, self._calc, {self._input.ticket(), self._last.ticket()}
        )

    def _calc(self, context: Context, output: BasicVector) -> None:
        command, last = self._input.Eval(context), self._last.Eval(context)
        output.SetFromVector(
            limit_wheel_command(
                with_play(command, last, self._config.play),
                limit=self._limit,
                deadband=self._config.deadband,
                round_to_integer=self._config.round_to_integer,
            )
        )


def AddWheelCommandLimiter(
    builder: DiagramBuilder,
    config: WheelCommandLimiterConfig,
    *,
    input_limit: float = 100.0,
    name: str = "wheel_command_limiter",
) -> WheelCommandLimiter:
    """Adds a WheelCommandLimiter to ``builder``; the caller connects its ports."""
    return builder.AddNamedSystem(name, WheelCommandLimiter(config, input_limit=input_limit))
