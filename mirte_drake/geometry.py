"""Mecanum kinematics of the MIRTE Master: body velocity, wheel speeds, PWM; (2-2) to (2-5)."""

import numpy as np

WHEEL_RADIUS = 0.051  # [m] R, of the robot's own base controller; its URDF has 0.050.
HALF_WHEELBASE = 0.09  # [m] a, from the middle to an axle.
HALF_TRACK = 0.135  # [m] b, from the middle to a wheel's plane.
PWM_SPEED = 6 * np.pi / 100  # [rad/s per pwm] K of (2-5).

# (4, 2) [m] x, y of the wheels' centres in the body frame; order as ``vectors.WHEELS``.
WHEEL_POSITIONS = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * [HALF_WHEELBASE, HALF_TRACK]
# (4, 2) unit vectors along the roller that touches the ground, body frame.
ROLLER_AXES = np.array([[1, -1], [1, 1], [1, -1], [1, 1]]) / np.sqrt(2)

_REACH = HALF_WHEELBASE + HALF_TRACK
# (4, 3) J / R of (2-2): body velocity [m/s, m/s, rad/s] to wheel speeds [rad/s].
INVERSE_KINEMATICS = (
    np.array([[1, -1, -_REACH], [1, 1, _REACH], [1, -1, _REACH], [1, 1, -_REACH]]) / WHEEL_RADIUS
)
# (3, 4) its Moore-Penrose inverse (2-3): wheel speeds to body velocity.
FORWARD_KINEMATICS = np.linalg.pinv(INVERSE_KINEMATICS)


def wheel_speeds(body_velocity: np.ndarray) -> np.ndarray:
    """Returns the wheel speeds (..., 4) [rad/s] of a body velocity (..., 3) (2-2)."""
    return body_velocity @ INVERSE_KINEMATICS.T


def body_velocity(wheel_speeds: np.ndarray) -> np.ndarray:
    """Returns the body velocity (..., 3) [m/s, m/s, rad/s] of wheel speeds (..., 4) (2-3)."""
    return wheel_speeds @ FORWARD_KINEMATICS.T


def pwm_to_wheel_speed(pwm: np.ndarray) -> np.ndarray:
    """Returns the ideal wheel speed [rad/s] of a wheel command [PWM percent] (2-5)."""
    return PWM_SPEED * pwm


def wheel_speed_to_pwm(speed: np.ndarray) -> np.ndarray:
    """Returns the wheel command [PWM percent], saturated at 100, of a speed [rad/s] (2-4)."""
    return np.clip(speed / PWM_SPEED, -100.0, 100.0)
