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

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_number("deadband", self.deadband, minimum=0)


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
    """Saturates, applies a deadband and rounds the wheel command. Stateless.

    .. pydrake_system::

        name: WheelCommandLimiter
        input_ports:
        - wheel_command
        output_ports:
        - limited_command

    ==================  ===========  =====  ==============================
    port                type         unit   meaning
    ==================  ===========  =====  ==============================
    wheel_command (in)  vector (4,)  [pwm]  any numbers, even not finite
    limited_command     vector (4,)  [pwm]  finite, within +-limit
    ==================  ===========  =====  ==============================

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
        self.DeclareVectorOutputPort("limited_command", 4, self._calc, {self._input.ticket()})

    def _calc(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(
            limit_wheel_command(
                self._input.Eval(context),
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
