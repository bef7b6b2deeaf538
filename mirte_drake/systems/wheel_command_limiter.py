"""Makes any wheel command one that the motors can take."""

import dataclasses as dc

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from mirte_drake.checks import check_number

MAX_PLAY = 20.0  # [pwm] With more, a robot hardly follows.


@dc.dataclass
class WheelCommandLimiterConfig:
    """Config of WheelCommandLimiter; the defaults are the study's: saturation alone."""

    deadband: float = 0.0  # [pwm] Smaller commands become zero. The robot's own is 10.
    round_to_integer: bool = False  # The robot takes whole percent.
    # [pwm] A wheel's command stays what it was until what is asked for is farther off than this,
    # and then follows at this distance: noise within it turns no motor back and forth. It stops
    # where zero is asked for, or less than the deadband. The published tube reckons with neither
    # play nor deadband and rounding.
    play: float = 0.0

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_number("deadband", self.deadband, minimum=0)
        check_number("play", self.play, minimum=0, maximum=MAX_PLAY)

    @property
    def command_error(self) -> float:
        """How far [pwm] a command is from what is asked for, without deadband, within limits."""
        return self.play + 0.5 * self.round_to_integer


def with_play(command: np.ndarray, last: np.ndarray, *, play: float, deadband: float) -> np.ndarray:
    """Returns the last command [pwm], moved to within the play [pwm] of what is asked for.

    The play operator of hysteresis. A wheel of which zero is asked, or less than the deadband,
    stops.
    """
    stops = (command == 0) | (np.abs(command) < deadband)
    return np.where(stops, 0.0, np.clip(last, command - play, command + play))


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
    last_command (in)   vector (4,)  [pwm]  what the wheels were told last; open: no play
    limited_command     vector (4,)  [pwm]  finite, within +-limit
    ==================  ===========  =====  =============================================

    Without a deadband, what it gives it gives again when that is the last command.

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
        config, command = self._config, self._input.Eval(context)
        if self._last.HasValue(context):
            last = self._last.Eval(context)
            command = with_play(command, last, play=config.play, deadband=config.deadband)
        output.SetFromVector(
            limit_wheel_command(
                command,
                limit=self._limit,
                deadband=config.deadband,
                round_to_integer=config.round_to_integer,
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
