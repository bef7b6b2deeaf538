"""Newton's model of the robot, (2-7) to (2-13), driven through the drivetrain.

State: pose x, y, yaw [m, m, rad] (world), body velocity vx, vy, yaw rate [m/s, m/s, rad/s], and
the drive speed of the wheels [rad/s] (4): what the motors would settle at without load, lagged.

In the body frame, with J of (2-2) and wheels that do not slip, (2-7) and (2-13) read

    m (d(vx, vy)/dt + yaw_rate x (vx, vy)) and I d(yaw_rate)/dt  =  J' F + roller friction,
    F_i = beta R (drive_i - omega_i) - F_s,i - D_v omega_i,   omega = J v / R.

F_i is the force at the rim in the wheel's plane; those of (2-10) lie along the rollers, sqrt 2
times larger, and T = J' / sqrt 2. alpha K_v u of (2-10) is beta R times the drive speed, which is
where deadband and gain of a wheel come in.

Static friction F_s is Coulomb friction with Stribeck's rise at low speed. At rest it is
set-valued: it takes whatever value within its bounds keeps the robot at rest, if there is one. The
forces of four wheels have three resultants, so there is one free number, and the best one is
known in closed form (``_holding_force``). Between rest and ``STICK_SPEED`` friction changes
linearly from that value to the sliding one. So a robot below breakaway stands exactly still, one
without command comes to rest, and the derivative is continuous: integrators neither chatter nor
creep. The price is that friction reverses over 2 STICK_SPEED instead of at once.

Deviation: (2-10) has friction of the wheels only. In these data the robot loses half its speed
when it moves sideways, where the rollers turn fast: they have friction of their own, on the
lateral velocity of the wheels' centres. It is smooth, as vibration frees rollers that stand.
"""

import dataclasses as dc
from typing import NamedTuple

import numpy as np

from mirte_drake.checks import check_number
from mirte_drake.compiled import compiled
from mirte_drake.geometry import INVERSE_KINEMATICS, WHEEL_POSITIONS, WHEEL_RADIUS
from mirte_drake.model.drivetrain import DrivetrainParameters, drive_speed

MASS = 5.0 + 4 * 2.15  # [kg] Base and wheels, of the robot's URDF.
STICK_SPEED = 0.02  # [m/s] Rim speed up to which static friction holds, at least in part.

BODY_VELOCITY = slice(3, 6)
DRIVE_SPEED = slice(6, 10)
STATE_SIZE = 10

_J = np.ascontiguousarray(WHEEL_RADIUS * INVERSE_KINEMATICS)  # (4, 3) of (2-2).
_AXLES = np.ascontiguousarray(WHEEL_POSITIONS[:, 0])  # (4,) [m]
# (4,) forces with no resultant: J' _NULL = 0.
_NULL = np.array([1.0, 1.0, -1.0, -1.0])


@dc.dataclass
class DynamicParameters:
    """Parameters of the dynamic robot; the defaults are an ideal robot with light friction."""

    mass: float = MASS  # [kg] m.
    yaw_inertia: float = 0.45  # [kg m^2] I_w.
    motor_damping: float = 13.0  # [N s/m] beta of (2-8), at the rim of one wheel.
    viscous_friction: float = 0.0  # [N s/rad] D_v of (2-10), of one wheel.
    breakaway: float = 0.0  # Static beyond sliding friction, as a share of the latter.
    stribeck_speed: float = 0.1  # [m/s] Rim speed at which most of that share is gone.
    roller_friction: float = 0.0  # [N] Of the rollers of one wheel.
    roller_speed: float = 0.1  # [m/s] Lateral speed at which it reaches 71 %.
    drivetrain: DrivetrainParameters = dc.field(default_factory=DrivetrainParameters)

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        for name in ("mass", "yaw_inertia", "motor_damping", "stribeck_speed", "roller_speed"):
            check_number(name, getattr(self, name), above=0)
        for name in ("viscous_friction", "breakaway", "roller_friction"):
            check_number(name, getattr(self, name), minimum=0)
        try:
            self.drivetrain.validate()
        except ValueError as error:
            raise ValueError(f"drivetrain.{error}") from None


class _Coefficients(NamedTuple):
    """The parameters as the compiled functions take them."""

    mass: float
    yaw_inertia: float
    motor: float  # [N s/rad] beta R.
    viscous: float  # [N s/rad] D_v.
    friction: np.ndarray  # (2, 4) [N]
    breakaway: float
    stribeck_speed: float
    roller_friction: float
    roller_speed: float
    lag: np.ndarray  # (4,) [s]


def _coefficients(parameters: DynamicParameters) -> _Coefficients:
    p, motor = parameters, parameters.motor_damping * WHEEL_RADIUS
    return _Coefficients(
        float(p.mass),
        float(p.yaw_inertia),
        motor,
        float(p.viscous_friction),
        np.ascontiguousarray(motor * p.drivetrain.friction, dtype=float),
        float(p.breakaway),
        float(p.stribeck_speed),
        float(p.roller_friction),
        float(p.roller_speed),
        np.ascontiguousarray(p.drivetrain.lag, dtype=float),
    )


def derivative(parameters: DynamicParameters, state: np.ndarray, command: np.ndarray) -> np.ndarray:
    """Returns the time derivative (..., 10) of the state.

    Args:
        parameters: The parameters; the drivetrain's delay is the caller's business.
        state: (..., 10), see above.
        command: (..., 4) [pwm] that reaches the motors now.
    """
    shape = np.broadcast_shapes(np.shape(state)[:-1], np.shape(command)[:-1])
    target = drive_speed(parameters.drivetrain, command)
    states = np.broadcast_to(state, (*shape, STATE_SIZE)).reshape(-1, STATE_SIZE)
    targets = np.broadcast_to(target, (*shape, 4)).reshape(-1, 4)
    rates = np.empty(states.shape)
    coefficients, work = _coefficients(parameters), np.empty((5, 4))
    for x, drive, rate in zip(
        states.astype(float), np.ascontiguousarray(targets), rates, strict=True
    ):
        _derivative(coefficients, x, drive, rate, work)
    return rates.reshape(*shape, STATE_SIZE)


def roll_out(
    parameters: DynamicParameters, start: np.ndarray, commands: np.ndarray, steps: np.ndarray
) -> np.ndarray:
    """Returns the states (N + 1, 10) under held commands, beginning with ``start`` (RK4).

    Args:
        parameters: The parameters; delay the commands beforehand.
        start: (10,) state.
        commands: (N, 4) [pwm] that reach the motors.
        steps: (N,) [s] how long each is held; one Runge-Kutta step, so 0.01 s at most.
    """
    states = np.empty((len(commands) + 1, STATE_SIZE))
    states[0] = start
    targets = drive_speed(parameters.drivetrain, commands)
    _roll_out(_coefficients(parameters), np.asarray(steps, dtype=float), targets, states)
    return states


@compiled
def _holding_force(drive, lower, upper, hold):  # noqa: ANN001, ANN202
    """Writes the friction (4,) within [-lower, upper] that best keeps the robot at rest.

    Friction ``drive + n _NULL`` has the resultants of the drive forces, for any number n. The n
    that stays furthest within the bounds is a weighted centre of four points on a line: that of
    the two points that are furthest apart for the sum of their widths.
    """
    furthest, n = -1.0, 0.0
    for i in range(3):
        centre = _NULL[i] * (0.5 * (upper[i] - lower[i]) - drive[i])
        width = 0.5 * (upper[i] + lower[i]) + 1e-12
        for j in range(i + 1, 4):
            other = _NULL[j] * (0.5 * (upper[j] - lower[j]) - drive[j])
            other_width = 0.5 * (upper[j] + lower[j]) + 1e-12
            ratio = abs(centre - other) / (width + other_width)
            if ratio > furthest:
                furthest = ratio
                n = (centre * other_width + other * width) / (width + other_width)
    for i in range(4):
        hold[i] = min(max(drive[i] + n * _NULL[i], -lower[i]), upper[i])


@compiled
def _derivative(c, state, target, rate, work):  # noqa: ANN001, ANN202
    """Writes the derivative (10,) at one state (10,) with the drive speeds' targets (4,).

    ``work`` (5, 4) is scratch: to allocate it here would take as long as the rest.
    """
    rim, drive, lower, upper, hold = work
    cos, sin = np.cos(state[2]), np.sin(state[2])
    vx, vy, yaw_rate = state[3], state[4], state[5]
    for i in range(4):
        rim[i] = _J[i, 0] * vx + _J[i, 1] * vy + _J[i, 2] * yaw_rate
        drive[i] = c.motor * state[6 + i]
        stribeck = 1.0 + c.breakaway * np.exp(-((rim[i] / c.stribeck_speed) ** 2))
        upper[i] = stribeck * c.friction[0, i]
        lower[i] = stribeck * c.friction[1, i]
        rate[6 + i] = (target[i] - state[6 + i]) / c.lag[i]
    _holding_force(drive, lower, upper, hold)
    force_x, force_y, torque = 0.0, 0.0, 0.0
    for i in range(4):
        sliding = min(abs(rim[i]) / STICK_SPEED, 1.0)
        bound = upper[i] if rim[i] > 0.0 else -lower[i]
        friction = sliding * bound + (1.0 - sliding) * hold[i]
        rim_force = drive[i] - friction - (c.motor + c.viscous) * rim[i] / WHEEL_RADIUS
        lateral = vy + _AXLES[i] * yaw_rate
        roller = c.roller_friction * lateral / np.sqrt(lateral**2 + c.roller_speed**2)
        force_x += _J[i, 0] * rim_force
        force_y += _J[i, 1] * rim_force - roller
        torque += _J[i, 2] * rim_force - _AXLES[i] * roller
    rate[0], rate[1], rate[2] = cos * vx - sin * vy, sin * vx + cos * vy, yaw_rate
    rate[3] = force_x / c.mass + yaw_rate * vy
    rate[4] = force_y / c.mass - yaw_rate * vx
    rate[5] = torque / c.yaw_inertia


@compiled
def _roll_out(c, steps, targets, states):  # noqa: ANN001, ANN202
    """Fills states (N + 1, 10) from its first row on."""
    n = states.shape[1]
    k, point, work = np.empty((4, n)), np.empty(n), np.empty((5, 4))
    for i in range(len(steps)):
        x, dt, target = states[i], steps[i], targets[i]
        _derivative(c, x, target, k[0], work)
        for stage in range(1, 4):
            reach = dt if stage == 3 else 0.5 * dt
            for j in range(n):
                point[j] = x[j] + reach * k[stage - 1, j]
            _derivative(c, point, target, k[stage], work)
        for j in range(n):
            mean = k[0, j] + 2.0 * k[1, j] + 2.0 * k[2, j] + k[3, j]
            states[i + 1, j] = x[j] + dt / 6.0 * mean
