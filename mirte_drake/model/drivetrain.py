"""From wheel command to wheel speed and back: deadband, gain, friction, lag, delay per wheel.

Arrays by wheel have the order of ``vectors.WHEELS``; those by direction have two rows, forward
and backward. All functions are vectorised over leading batch axes.
"""

import dataclasses as dc

import numpy as np

from mirte_drake.checks import check_array, check_number
from mirte_drake.geometry import PWM_SPEED
from mirte_drake.vectors import WHEELS

MAX_COMMAND = 100.0  # [pwm] Saturation of (2-4).
MAX_DELAY = 2.0  # [s] Beyond any robot; what a simulation stores grows with it.
DIRECTIONS = ("forward", "backward")

BY_DIRECTION = (len(DIRECTIONS), len(WHEELS))


def _same(value: float) -> np.ndarray:
    return np.full(BY_DIRECTION, value)


@dc.dataclass
class DrivetrainParameters:
    """What a motor, its driver and its gearbox make of a command; the defaults are ideal (2-5)."""

    # (2, 4) [rad/s per pwm] Of the speed without load, beyond the deadband.
    gain: np.ndarray = dc.field(default_factory=lambda: _same(PWM_SPEED))
    deadband: np.ndarray = dc.field(default_factory=lambda: _same(0.0))  # (2, 4) [pwm]
    # (2, 4) [rad/s] Coulomb friction, as the speed it takes from a wheel that turns.
    friction: np.ndarray = dc.field(default_factory=lambda: _same(0.0))
    # (4,) [s] Time constant of the speed without load.
    lag: np.ndarray = dc.field(default_factory=lambda: np.full(len(WHEELS), 0.02))
    delay: float = 0.0  # [s] From command to motor.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        for name in ("gain", "deadband", "friction"):
            check_array(name, getattr(self, name), BY_DIRECTION, minimum=0)
        if np.any(self.gain == 0):
            raise ValueError(f"gain: must be > 0, got {self.gain.tolist()}")
        check_array("lag", self.lag, (len(WHEELS),), minimum=0)
        if np.any(self.lag == 0):
            raise ValueError(f"lag: must be > 0 s, got {self.lag.tolist()}")
        check_number("delay", self.delay, minimum=0, maximum=MAX_DELAY)


def drive_speed(drivetrain: DrivetrainParameters, command: np.ndarray) -> np.ndarray:
    """Returns the speed (..., 4) [rad/s] that the motors settle at without load or friction.

    Args:
        drivetrain: The parameters.
        command: (..., 4) [pwm], saturated at 100.
    """
    command = np.clip(command, -MAX_COMMAND, MAX_COMMAND)
    gain, deadband = _along(drivetrain.gain, command), _along(drivetrain.deadband, command)
    return np.sign(command) * gain * np.maximum(np.abs(command) - deadband, 0.0)


def steady_speed(drivetrain: DrivetrainParameters, command: np.ndarray) -> np.ndarray:
    """Returns the speed (..., 4) [rad/s] that the wheels settle at, Coulomb friction taken off.

    Args:
        drivetrain: The parameters.
        command: (..., 4) [pwm], saturated at 100.
    """
    speed = drive_speed(drivetrain, command)
    return np.sign(speed) * np.maximum(np.abs(speed) - _along(drivetrain.friction, speed), 0.0)


def lagged_speed(
    drivetrain: DrivetrainParameters, speed: np.ndarray, target: np.ndarray, step: float
) -> np.ndarray:
    """Returns the speed (..., 4) [rad/s] after a time ``step`` [s] on the way to a fixed target.

    Args:
        drivetrain: The parameters.
        speed: (..., 4) [rad/s] before.
        target: (..., 4) [rad/s].
        step: [s].
    """
    return target + np.exp(-step / drivetrain.lag) * (speed - target)


def command_for(drivetrain: DrivetrainParameters, speed: np.ndarray) -> np.ndarray:
    """Returns the command (..., 4) [pwm] that makes the wheels settle at a speed (inverse).

    It jumps over deadband and friction at zero speed: a controller that hovers there should ask
    for exactly zero.

    Args:
        drivetrain: The parameters.
        speed: (..., 4) [rad/s]; what is out of reach gets +-100 pwm.
    """
    speed = np.asarray(speed, dtype=float)
    gain, deadband, friction = (
        _along(values, speed)
        for values in (drivetrain.gain, drivetrain.deadband, drivetrain.friction)
    )
    command = np.sign(speed) * (deadband + (np.abs(speed) + friction) / gain)
    return np.clip(command, -MAX_COMMAND, MAX_COMMAND)


def _along(values: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Returns the entries (..., 4) of values (2, 4) for the signs of an array (..., 4)."""
    return np.where(np.asarray(direction) >= 0, values[0], values[1])
