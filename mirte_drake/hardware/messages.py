"""What crosses the wire, whatever the middleware: frozen values in SI units and PWM percent."""

import dataclasses as dc
import enum

import numpy as np

from mirte_drake.vectors import POSE_SIZE, WHEELS


def _zeros(size: int) -> np.ndarray:
    return dc.field(default_factory=lambda: np.zeros(size))


@dc.dataclass(frozen=True)
class Odometry:
    """What the robot says of its motion. Values are as received: nothing is checked yet."""

    stamp: int = 0  # [ns] on the robot's clock.
    pose: np.ndarray = _zeros(POSE_SIZE)  # (3,) [m, m, rad] odometry frame, yaw wrapped.
    body_velocity: np.ndarray = _zeros(POSE_SIZE)  # (3,) [m/s, m/s, rad/s]
    arrival: float = 0.0  # [s] time.monotonic() when it was received; not sent.


@dc.dataclass(frozen=True)
class WheelCommand:
    """Command of the four wheels, which the robot holds until the next one."""

    command: np.ndarray = _zeros(len(WHEELS))  # (4,) [pwm] whole numbers; order of `WHEELS`.
    arrival: float = 0.0  # [s] time.monotonic() when it was received; not sent.


@dc.dataclass(frozen=True)
class DriveCommand:
    """What the controller asks of the guard once per sample; also the controller's heartbeat."""

    session: int = 0  # Random number of the controller's process, below 2^63.
    sequence: int = 0  # Counts up from 0.
    command: np.ndarray = _zeros(len(WHEELS))  # (4,) [pwm]
    reference: np.ndarray = _zeros(POSE_SIZE)  # (3,) [m, m, rad] odometry frame.
    odometry_stamp: int = 0  # [ns] of the odometry that the command answers.
    solve_failed: bool = False  # The command is a fallback.
    done: bool = False  # The drive is over: stop, without an alarm.
    arrival: float = 0.0  # [s] time.monotonic() when it was received; not sent.


@dc.dataclass(frozen=True)
class GuardStatus:
    """What the guard did last and whether it has stopped the robot; also its heartbeat."""

    session: int = 0  # The controller that it listens to; 0: none yet.
    sequence: int = 0  # Of the last DriveCommand passed on.
    command: np.ndarray = _zeros(len(WHEELS))  # (4,) [pwm] last sent to the robot.
    stopped: bool = False  # Latched until reset.
    reason: str = ""  # Why it stopped, in words; empty while it drives or waits.
    odometry_age: float = 0.0  # [s] of the last odometry that it accepted.
    rejected: int = 0  # Odometry messages that it rejected so far.
    arrival: float = 0.0  # [s] time.monotonic() when it was received; not sent.


class Request(enum.IntEnum):
    """What an operator can ask of the guard."""

    STOP = 1
    RESET = 2


@dc.dataclass(frozen=True)
class OperatorRequest:
    """A request of the command line to the guard."""

    request: Request = Request.STOP


@dc.dataclass(frozen=True)
class PlanView:
    """What an onlooker wants to see, all in the odometry frame; sent once per sample."""

    reference: np.ndarray = dc.field(  # (N+1, 3) [m, m, rad] r_k, ..., r_{k+N}.
        default_factory=lambda: np.zeros((1, POSE_SIZE))
    )
    nominal: np.ndarray = dc.field(  # (N+1, 3) [m, m, rad] the plan from xhat_k on.
        default_factory=lambda: np.zeros((1, POSE_SIZE))
    )
    half_width: np.ndarray = _zeros(POSE_SIZE)  # (3,) [m, m, rad] d_k; zeros without a tube.


Message = Odometry | WheelCommand | DriveCommand | GuardStatus | OperatorRequest | PlanView
