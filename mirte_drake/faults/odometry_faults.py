"""What can become of odometry on its way: pure functions of one message and those before it."""

import dataclasses as dc

import numpy as np

from mirte_drake.angles import rotation, wrap_angle
from mirte_drake.faults.injector import OdometryFault, Passing, Sending
from mirte_drake.hardware.messages import Odometry
from mirte_drake.vectors import YAW

JUMP = 0.5  # [m]
PUSH = 1.2  # [m/s] Less than what a MIRTE Master cannot do, so that no message is rejected.
NS = 1e-9  # [s]


def silent(passing: Passing) -> list[Sending]:
    """Odometry stops."""
    return []


def frozen(passing: Passing) -> list[Sending]:
    """Pose and velocity stay what they were; stamps go on."""
    pose, velocity = passing.before.pose, passing.before.body_velocity
    return [_altered(passing.odometry, pose=pose, body_velocity=velocity)]


def repeated(passing: Passing) -> list[Sending]:
    """The last message before the fault comes again and again."""
    return [Sending(passing.before, passing.odometry, good=False)]


def jumping(passing: Passing) -> list[Sending]:
    """The position is off from now on."""
    pose = _moved(passing.odometry.pose, JUMP * passing.direction)
    return [_altered(passing.odometry, pose=pose, good=False)]


def not_a_number(passing: Passing) -> list[Sending]:
    """One entry of pose or velocity is NaN."""
    return [_with_entry(passing, np.nan)]


def infinite(passing: Passing) -> list[Sending]:
    """One entry of position or velocity is infinite."""
    return [_with_entry(passing, passing.sign * np.inf)]


def huge(passing: Passing) -> list[Sending]:
    """One entry of position or velocity is beyond all bounds."""
    return [_with_entry(passing, passing.sign * 1e9)]


def swapped(passing: Passing) -> list[Sending]:
    """Messages come in pairs, the later one first."""
    if passing.number % 2 == 0:
        return []
    previous = passing.previous
    return [Sending(passing.odometry, passing.odometry), Sending(previous, previous, good=False)]


def old_stamps(passing: Passing) -> list[Sending]:
    """Stamps are 10 s old."""
    stamp = passing.odometry.stamp - 10_000_000_000
    return [_altered(passing.odometry, stamp=stamp, good=False)]


def doubled(passing: Passing) -> list[Sending]:
    """Every message comes twice."""
    once = Sending(passing.odometry, passing.odometry)
    return [once, _altered(passing.odometry)]


def late_by(shortest: float, longest: float) -> OdometryFault:
    """Returns a fault: every message is late by a time that is drawn anew, so order may change.

    Args:
        shortest: [s]
        longest: [s]
    """

    def late(passing: Passing) -> list[Sending]:
        delay = passing.rng.uniform(shortest, longest)
        return [Sending(passing.odometry, passing.odometry, delay)]

    return late


def lost(share: float) -> OdometryFault:
    """Returns a fault: every message is lost with a probability."""

    def losing(passing: Passing) -> list[Sending]:
        gone = passing.rng.uniform() < share
        return [] if gone else [Sending(passing.odometry, passing.odometry)]

    return losing


def clock_steps_by(step: float, *, either_way: bool = False) -> OdometryFault:
    """Returns a fault: the robot's clock is off from now on.

    Args:
        step: [s]
        either_way: Whether it goes forward in some trials and back in others.
    """

    def stepped(passing: Passing) -> list[Sending]:
        sign = passing.sign if either_way else 1
        stamp = passing.odometry.stamp + round(1e9 * sign * step)
        # A clock that goes back a long way makes every stamp one that has been.
        return [_altered(passing.odometry, stamp=stamp, good=step > -1.0)]

    return stepped


def once(fault: OdometryFault) -> OdometryFault:
    """Returns a fault that meets one message alone."""

    def met(passing: Passing) -> list[Sending]:
        if passing.number > 0:
            return [Sending(passing.odometry, passing.odometry)]
        return fault(passing)

    return met


def turned(passing: Passing) -> list[Sending]:
    """The odometry's frame is turned by half a turn: a path along x has its yaw at +-pi."""
    pose = rotation(np.pi) @ passing.odometry.pose
    pose[YAW] = wrap_angle(passing.odometry.pose[YAW] + np.pi)
    return [_altered(passing.odometry, pose=pose)]


def pushed(passing: Passing) -> list[Sending]:
    """Something pushes the robot away, steadily."""
    elapsed = NS * (passing.odometry.stamp - passing.before.stamp)
    pose = _moved(passing.odometry.pose, PUSH * elapsed * passing.direction)
    return [_altered(passing.odometry, pose=pose)]


def _moved(pose: np.ndarray, by: np.ndarray) -> np.ndarray:
    return np.array([*(pose[:YAW] + by), pose[YAW]])


def _with_entry(passing: Passing, value: float) -> Sending:
    """Returns the message with one of x, y, vx, vy and yaw rate replaced."""
    pose, velocity = passing.odometry.pose.copy(), passing.odometry.body_velocity.copy()
    entry = passing.rng.integers(5)
    if entry < YAW:
        pose[entry] = value
    else:
        velocity[entry - YAW] = value
    return _altered(passing.odometry, pose=pose, body_velocity=velocity, good=False)


def _altered(odometry: Odometry, *, good: bool = True, **values: object) -> Sending:
    return Sending(dc.replace(odometry, **values), odometry, good=good)  # type: ignore[arg-type]
