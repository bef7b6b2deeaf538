"""A robot whose body velocity follows its wheels' commands with a lag.

State: pose x, y, yaw [m, m, rad] (world), body velocity vx, vy, yaw rate [m/s, m/s, rad/s] (body).
With commands u held,

    d(x, y)/dt = R(yaw) (vx, vy),   d yaw/dt = yaw rate,   dv_i/dt = (F_i(u) - v_i) / lag_i,
    F(u) = diag(axis_gain) J+ s(u),   s_j = wheel_gain_j sign(u_j) max(|u_j| - deadband, 0).

s are wheel speeds, their gain that of the direction in which u_j drives wheel j, and J+ is (2-3): F
is the velocity that the robot settles at, ``axis_gain`` of what wheels that roll would give. A
delay of whole samples belongs to the model but not to its state: who plans with it plans from where
the commands already sent take the robot.

A controller plans in effective commands w = s(u) / (mean wheel gain) [pwm], in which F is linear,
and ``command_for`` gives the commands for them: no optimiser meets deadband or direction.

The step is exact in velocity and yaw; the position is Simpson's rule on R(yaw) v, whose error is
of fifth order in the turn within the step.
"""

import dataclasses as dc

import numpy as np

from mirte_drake.angles import rotation
from mirte_drake.checks import check_array, check_number
from mirte_drake.compiled import compiled
from mirte_drake.geometry import FORWARD_KINEMATICS, PWM_SPEED
from mirte_drake.model.drivetrain import BY_DIRECTION
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.model.term_table import dense
from mirte_drake.vectors import POSE_SIZE, YAW

BODY_VELOCITY = slice(POSE_SIZE, 2 * POSE_SIZE)  # Entries of the state.
MAX_DELAY = 20  # [samples]
SMALLEST_GAIN = 1e-3  # Of an axis, or of a wheel [rad/s per pwm].


@dc.dataclass
class LaggedParameters:
    """What a LaggedModel consists of; the defaults are ideal wheels (2-5)."""

    # (3,) Of the velocity of wheels that roll without slip: forward, sideways, turning.
    axis_gain: np.ndarray = dc.field(default_factory=lambda: np.ones(POSE_SIZE))
    # (2, 4) [rad/s per pwm] Forward and backward, beyond the deadband.
    wheel_gain: np.ndarray = dc.field(default_factory=lambda: np.full(BY_DIRECTION, PWM_SPEED))
    deadband: float = 0.0  # [pwm] Of every wheel.
    lag: np.ndarray = dc.field(default_factory=lambda: np.full(POSE_SIZE, 0.1))  # (3,) [s]
    delay: int = 0  # [samples] From command to motion, beyond the lag.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_array("axis_gain", self.axis_gain, (POSE_SIZE,), minimum=SMALLEST_GAIN)
        check_array("wheel_gain", self.wheel_gain, BY_DIRECTION, minimum=SMALLEST_GAIN)
        check_number("deadband", self.deadband, minimum=0, maximum=99)
        check_array("lag", self.lag, (POSE_SIZE,), minimum=1e-3)
        check_number("delay", self.delay, minimum=0, maximum=MAX_DELAY)


class LaggedModel(PredictionModel):
    """Derivative, zero-order-hold step and Jacobians; see the module.

    Attributes:
        name: Name of the model.
        states: Names of the states.
        inputs: Names of the inputs, wheel commands [PWM percent].
        parameters: The parameters; not to be written to.
        delay: [samples] From command to motion, beyond the lag; in no method.
        wheel_shares: (2, 4) What a command beyond the deadband has of an effective one, forward
            and backward; not to be written to.
    """

    states = ("x", "y", "theta", "vx", "vy", "yaw_rate")
    inputs = ("u1", "u2", "u3", "u4")

    def __init__(self, name: str, parameters: LaggedParameters) -> None:
        """Builds the model.

        Raises:
            ValueError: when a parameter is out of range.
        """
        parameters.validate()
        self.name, self.parameters, self.delay = name, parameters, parameters.delay
        kinematics = np.asarray(parameters.axis_gain)[:, None] * FORWARD_KINEMATICS
        self._gain = dense(kinematics * np.asarray(parameters.wheel_gain)[:, None, :])
        self.wheel_shares = parameters.wheel_gain / np.mean(parameters.wheel_gain, axis=0)
        self._lag, self._deadband = dense(parameters.lag), float(parameters.deadband)

    def effective(self) -> "LaggedModel":
        """Returns the model whose inputs are effective commands: F is linear in them."""
        mean = np.broadcast_to(np.mean(self.parameters.wheel_gain, axis=0), BY_DIRECTION)
        linear = dc.replace(self.parameters, wheel_gain=mean, deadband=0.0)
        return LaggedModel(self.name, linear)

    def effective_command(self, u: np.ndarray) -> np.ndarray:
        """Returns the effective commands w (..., 4) [pwm] of commands u (..., 4) [pwm]."""
        driven = np.sign(u) * np.maximum(np.abs(u) - self._deadband, 0.0)
        return driven * np.where(driven >= 0, *self.wheel_shares)

    def command_for(self, w: np.ndarray) -> np.ndarray:
        """Returns the commands u (..., 4) [pwm] for effective ones (..., 4) [pwm], without limits.

        The inverse of ``effective_command``, but for w smaller than the deadband: there the
        deadband is added in proportion, so that a w that wavers about zero is doubled, not thrown
        from one side of the deadband to the other.
        """
        driven = w / np.where(np.asarray(w) >= 0, *self.wheel_shares)
        if self._deadband == 0.0:
            return driven
        return driven + self._deadband * np.clip(driven / self._deadband, -1.0, 1.0)

    def effective_limit(self, limit: float) -> float:
        """Returns the largest effective command [pwm] that commands up to a limit [pwm] give."""
        ends = np.full((2, self.num_inputs), [[limit], [-limit]])
        return float(np.min(np.abs(self.effective_command(ends))))

    def steady_velocity(self, u: np.ndarray) -> np.ndarray:
        """Returns F(u) (..., 3) [m/s, m/s, rad/s], where the body velocity settles."""
        forward, backward = self._gain
        ahead, back = (_positive(way - self._deadband) for way in (u, -np.asarray(u)))
        return ahead @ forward.T - back @ backward.T

    def steady_velocity_jacobian(self, u: np.ndarray) -> np.ndarray:
        """Returns dF/du (..., 3, 4); at rest that of driving forward, zero within the deadband."""
        u = np.asarray(u, dtype=float)[..., None, :]
        slope = np.where(u >= 0, self._gain[0], self._gain[1])
        moving = np.abs(u) > self._deadband if self._deadband else True
        return np.where(moving, slope, 0.0)

    def derivative(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Returns xdot (..., n) at states x (..., n) and inputs u (..., m)."""
        velocity = np.asarray(x)[..., BODY_VELOCITY]
        pose_rate = np.einsum("...ij,...j->...i", rotation(np.asarray(x)[..., YAW]), velocity)
        return np.concatenate([pose_rate, (self.steady_velocity(u) - velocity) / self._lag], -1)

    def linearise(self, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns f, df/dx and df/du, of shapes (..., n), (..., n, n), (..., n, m); (4-11)."""
        f, n = self.derivative(x, u), self.num_states
        A, B = np.zeros((*f.shape, n)), np.zeros((*f.shape, self.num_inputs))
        A[..., 0, YAW], A[..., 1, YAW] = -f[..., 1], f[..., 0]
        A[..., :POSE_SIZE, BODY_VELOCITY] = rotation(np.asarray(x)[..., YAW])
        A[..., BODY_VELOCITY, BODY_VELOCITY] = -np.diag(1.0 / self._lag)
        B[..., BODY_VELOCITY, :] = self.steady_velocity_jacobian(u) / self._lag[:, None]
        return f, A, B

    def step(self, x: np.ndarray, u: np.ndarray, dt: float | np.ndarray) -> np.ndarray:
        """Returns the state (..., n) after ``dt`` [s], a number or (..., 1), with u held."""
        x, u = dense(x), dense(u)
        durations = np.array(np.broadcast_to(dt, (*x.shape[:-1], 1)), dtype=float).ravel()
        end = _steps(
            *self._table, x.reshape(-1, x.shape[-1]), u.reshape(-1, u.shape[-1]), durations
        )
        return end.reshape(x.shape)

    def step_jacobians(self, x: np.ndarray, u: np.ndarray, dt: float) -> np.ndarray:
        """Returns the exact Jacobian (..., n, n + m) of ``step`` by x and u."""
        x, u = dense(x), dense(u)
        jacobians = _step_jacobians(
            *self._table, x.reshape(-1, x.shape[-1]), u.reshape(-1, u.shape[-1]), dt
        )
        return jacobians.reshape(*x.shape, -1)

    def roll_out(self, x: np.ndarray, inputs: np.ndarray, dt: float) -> np.ndarray:
        """Returns the states (N + 1, n) under held inputs (N, m), beginning with x (n,)."""
        return _roll_out(*self._table, dense(x), dense(inputs), dt)

    def roll_out_jacobians(
        self, x: np.ndarray, inputs: np.ndarray, dt: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns ``roll_out`` and the Jacobian (N, n, n + m) of each of its steps."""
        return _roll_out_jacobians(*self._table, dense(x), dense(inputs), dt)

    @property
    def _table(self) -> tuple[np.ndarray, float, np.ndarray]:
        return self._gain, self._deadband, self._lag


def _positive(x: np.ndarray) -> np.ndarray:
    """Returns max(x, 0) without a comparison, for Drake's symbolic expressions, too."""
    return 0.5 * (x + np.abs(x))


@compiled
def _step(
    gain: np.ndarray,
    deadband: float,
    lag: np.ndarray,
    x: np.ndarray,
    u: np.ndarray,
    dt: float,
    end: np.ndarray,
    jacobian: np.ndarray,
) -> None:
    """Writes the state (6,) after dt, and the Jacobian (6, 10), or none into one without rows.

    At each of Simpson's points, a share of dt into the step, velocity and yaw are known:
    v_i = F_i + decay_i (v_i(0) - F_i), and of the yaw the integral.
    """
    wanted = len(jacobian) > 0
    target, slope = np.zeros(3), np.zeros((3, 4))
    for j in range(4):
        driven = max(abs(u[j]) - deadband, 0.0)
        if u[j] < 0.0:
            driven = -driven
        for i in range(3):
            by_pwm = gain[0, i, j] if u[j] >= 0.0 else gain[1, i, j]
            target[i] += by_pwm * driven
            slope[i, j] = by_pwm if driven != 0.0 or deadband == 0.0 else 0.0
    end[:] = x
    if wanted:
        jacobian[:] = 0.0
        for r in range(3):
            jacobian[r, r] = 1.0
    for point in range(3):
        t, weight = 0.5 * point * dt, dt / 6.0 * (4.0 if point == 1 else 1.0)
        decay = np.exp(-t / lag)
        vx = target[0] + decay[0] * (x[3] - target[0])
        vy = target[1] + decay[1] * (x[4] - target[1])
        by_rate = lag[2] * (1.0 - decay[2])  # Of the yaw, by the initial yaw rate.
        yaw = x[2] + target[2] * t + by_rate * (x[5] - target[2])
        cos, sin = np.cos(yaw), np.sin(yaw)
        along, across = cos * vx - sin * vy, sin * vx + cos * vy
        end[0] += weight * along
        end[1] += weight * across
        if wanted:
            jacobian[0, 2] -= weight * across
            jacobian[1, 2] += weight * along
            jacobian[0, 3] += weight * cos * decay[0]
            jacobian[0, 4] -= weight * sin * decay[1]
            jacobian[0, 5] -= weight * across * by_rate
            jacobian[1, 3] += weight * sin * decay[0]
            jacobian[1, 4] += weight * cos * decay[1]
            jacobian[1, 5] += weight * along * by_rate
            for j in range(4):
                vx_by = (1.0 - decay[0]) * slope[0, j]
                vy_by = (1.0 - decay[1]) * slope[1, j]
                yaw_by = (t - by_rate) * slope[2, j]
                jacobian[0, 6 + j] += weight * (cos * vx_by - sin * vy_by - across * yaw_by)
                jacobian[1, 6 + j] += weight * (sin * vx_by + cos * vy_by + along * yaw_by)
    decay = np.exp(-dt / lag)
    by_rate = lag[2] * (1.0 - decay[2])
    end[2] += target[2] * dt + by_rate * (x[5] - target[2])
    for i in range(3):
        end[3 + i] = target[i] + decay[i] * (x[3 + i] - target[i])
    if wanted:
        jacobian[2, 5] = by_rate
        for j in range(4):
            jacobian[2, 6 + j] = (dt - by_rate) * slope[2, j]
        for i in range(3):
            jacobian[3 + i, 3 + i] = decay[i]
            for j in range(4):
                jacobian[3 + i, 6 + j] = (1.0 - decay[i]) * slope[i, j]


@compiled
def _steps(
    gain: np.ndarray,
    deadband: float,
    lag: np.ndarray,
    x: np.ndarray,
    u: np.ndarray,
    dt: np.ndarray,
) -> np.ndarray:
    end, none = np.empty(x.shape), np.empty((0, 10))
    for b in range(len(x)):
        _step(gain, deadband, lag, x[b], u[b], dt[b], end[b], none)
    return end


@compiled
def _step_jacobians(
    gain: np.ndarray, deadband: float, lag: np.ndarray, x: np.ndarray, u: np.ndarray, dt: float
) -> np.ndarray:
    end, jacobians = np.empty(6), np.empty((len(x), 6, 10))
    for b in range(len(x)):
        _step(gain, deadband, lag, x[b], u[b], dt, end, jacobians[b])
    return jacobians


@compiled
def _roll_out(
    gain: np.ndarray,
    deadband: float,
    lag: np.ndarray,
    x: np.ndarray,
    inputs: np.ndarray,
    dt: float,
) -> np.ndarray:
    states, none = np.empty((len(inputs) + 1, 6)), np.empty((0, 10))
    states[0] = x
    for k in range(len(inputs)):
        _step(gain, deadband, lag, states[k], inputs[k], dt, states[k + 1], none)
    return states


@compiled
def _roll_out_jacobians(
    gain: np.ndarray,
    deadband: float,
    lag: np.ndarray,
    x: np.ndarray,
    inputs: np.ndarray,
    dt: float,
) -> tuple[np.ndarray, np.ndarray]:
    N = len(inputs)
    states, jacobians = np.empty((N + 1, 6)), np.empty((N, 6, 10))
    states[0] = x
    for k in range(N):
        _step(gain, deadband, lag, states[k], inputs[k], dt, states[k + 1], jacobians[k])
    return states, jacobians
