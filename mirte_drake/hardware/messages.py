"""What crosses the wire, whatever the middleware: frozen values in SI units and PWM percent."""

import dataclasses as dc
import enum

import numpy as np


@dc.dataclass(frozen=True)
class Odometry:
    """What the robot says of its motion. Values are as received: nothing is checked yet."""

    stamp: int  # [ns] on the robot's clock.
    pose: np.ndarray  # (3,) [m, m, rad] odometry frame, yaw wrapped.
    body_velocity: np.ndarray  # (3,) [m/s, m/s, rad/s]
    arrival: float = 0.0  # [s] time.monotonic() when it was received; not sent.


@dc.dataclass(frozen=True)
class WheelCommand:
    """Command of the four wheels, which the robot holds until the next one."""

    command: np.ndarray  # (4,) [pwm] whole numbers; order of `WHEELS`.
    arrival: float = 0.0  # [s] time.monotonic() when it was received; not sent.


@dc.dataclass(frozen=True)
class DriveCommand:
    """What the controller asks of the guard once per sample; also the controller's heartbeat."""

    session: int  # Random number of the controller's process, below 2^63.
    sequence: int  # Counts up from 0.
    command: np.ndarray  # (4,) [pwm]
    reference: np.ndarray  # (3,) [m, m, rad] odometry frame.
    odometry_stamp: int  # [ns] of the odometry that the command answers.
    solve_failed: bool  # The command is a fallback.
    done: bool = False  # The drive is over: stop, without an alarm.
    arrival: float = 0.0  # [s] time.monotonic() when it was received; not sent.


@dc.dataclass(frozen=True)
class GuardStatus:
    """What the guard did last and whether it has stopped the robot; also its heartbeat."""

    session: int  # The controller that it listens to; 0: none yet.
    sequence: int  # Of the last DriveCommand passed on.
    command: np.ndarray  # (4,) [pwm] last sent to the robot.
    stopped: bool  # Latched until reset.
    reason: str  # Why it stopped, in words; empty while it drives or waits.
    odometry_age: float  # [s] of the last odometry that it accepted.
    rejected: int  # Odometry messages that it rejected so far.
    arrival: float = 0.0  # [s] time.monotonic() when it was received; not sent.


class Request(enum.IntEnum):
    """What an operator can ask of the guard."""

    STOP = 1
    RESET = 2


@dc.dataclass(frozen=True)
class OperatorRequest:
    """A request of the command line to the guard."""

    request: Request


@dc.dataclass(frozen=True)
class PlanView:
    """What an onlooker wants to see, all in the odometry frame; sent once per sample."""

    reference: np.ndarray  # (N+1, 3) [m, m, rad] r_k, ..., r_{k+N}.
    nominal: np.ndarray  # (N+1, 3) [m, m, rad] the plan from xhat_k on.
    half_width: np.ndarray  # (3,) [m, m, rad] d_k; zeros without a tube.


NOTHING: tuple = ()  # On a Drake port where there is no message yet; Drake 1.58 takes no None.

Message = Odometry | WheelCommand | DriveCommand | GuardStatus | OperatorRequest | PlanView
