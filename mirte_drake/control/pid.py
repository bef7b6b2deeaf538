"""PID on the pose: one loop per axis of the robot, mapped to its wheels by the ideal kinematics."""

import dataclasses as dc

import numpy as np

from mirte_drake.angles import pose_error, rotation
from mirte_drake.geometry import PWM_SPEED, wheel_speeds
from mirte_drake.vectors import POSE_SIZE, WHEELS, YAW


@dc.dataclass(frozen=True)
class PidGains:
    """Gains of the axes forward, left and yaw, each (3,)."""

    proportional: np.ndarray  # [1/s]
    integral: np.ndarray  # [1/s^2]
    derivative: np.ndarray  # [-]
    feedforward: np.ndarray  # [-] Factor on the reference velocity: 1 of an ideal robot.


@dc.dataclass(frozen=True)
class PidMemory:
    """What the loops remember from sample to sample, in the body frame."""

    integral: np.ndarray = dc.field(default_factory=lambda: np.zeros(POSE_SIZE))  # (3,) [m s, ...]
    error: np.ndarray = dc.field(default_factory=lambda: np.zeros(POSE_SIZE))  # (3,) [m, m, rad]


def reference_velocity(window: np.ndarray, period: float, preview: int) -> np.ndarray:
    """Returns the mean velocity (3,) of the reference over the sample ``preview`` samples ahead.

    World frame [m/s, m/s, rad/s].

    Args:
        window: (at least preview + 2, 3) [m, m, rad] r_k, r_{k+1}, ...; yaw unwrapped.
        period: [s] between them.
        preview: What lags behind its command is told so much earlier.
    """
    return (window[preview + 1] - window[preview]) / period


def pid_step(
    gains: PidGains,
    memory: PidMemory,
    pose: np.ndarray,
    reference: np.ndarray,
    velocity: np.ndarray,
    *,
    period: float,
    input_limit: float,
) -> tuple[np.ndarray, PidMemory]:
    """Returns the wheel command of a sample and what to remember for the next one.

    The body velocity asked for is F v + P e + I (sum of Ts e) + D (change of e) / Ts, with the
    error e and the reference velocity v in the body frame. Where a wheel cannot turn so fast, all
    turn slower, so that the direction is kept; meanwhile no integral grows that asks for more
    still (anti-windup).

    Args:
        gains: P, I, D and F.
        memory: Of the sample before.
        pose: (3,) [m, m, rad] measured.
        reference: (3,) [m, m, rad]
        velocity: (3,) [m/s, m/s, rad/s] of the reference, world frame.
        period: [s] T_s.
        input_limit: [pwm] that no wheel exceeds.

    Returns:
        The command (4,) [pwm] and the memory. With a pose that is not finite the command is NaN,
        and the memory stays as it was.
    """
    if not np.all(np.isfinite(pose)):
        return np.full(len(WHEELS), np.nan), memory
    to_body = rotation(pose[YAW]).T
    error = -to_body @ pose_error(pose, reference)
    wanted = (
        gains.feedforward * (to_body @ velocity)
        + gains.proportional * error
        + gains.integral * memory.integral
        + gains.derivative * (error - memory.error) / period
    )
    command = wheel_speeds(wanted) / PWM_SPEED
    excess = max(1.0, np.max(np.abs(command)) / input_limit)
    winding_up = (excess > 1.0) & (error * wanted > 0.0)
    integral = memory.integral + np.where(winding_up, 0.0, period * error)
    return command / excess, PidMemory(integral, error)
