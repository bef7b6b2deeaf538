"""Which odometry to believe, and how old it is: pure functions over an immutable track.

The clocks of robot and controller differ by an unknown offset. It is estimated as the least of
arrival - stamp over the last messages, so the fastest of them counts as fresh and every other one
is as old as it came later. What happens when

- the robot's clock steps forward: the offset follows at once; a delay that comes with the step
  cannot be told from it, up to the size of the step;
- it steps back by less than the time between messages: odometry counts as older by the step until
  the window has forgotten the clock before it, which errs on the safe side;
- it steps back further: odometry is out of order, and rejected until the clock has caught up or
  ``restart_after`` is over;
- the robot restarts: the same. The track then begins anew, whatever its clock and its pose say;
- the first message of a track is late: it counts as fresh until a faster one has come;
- every message is late by the same time: nothing here can see it.
"""

import dataclasses as dc
import math

import numpy as np

from mirte_drake.angles import pose_error, unwrap_near
from mirte_drake.checks import check_array, check_number
from mirte_drake.hardware.messages import Odometry
from mirte_drake.vectors import POSE_SIZE, YAW

NS = 1e-9  # [s]
MAX_STAMP = 2**63 - 1  # [ns]


@dc.dataclass
class OdometryLimits:
    """What a MIRTE Master can do; all beyond is an error of the odometry."""

    max_coordinate: float = 1e4  # [m, rad] Of each entry of the pose.
    # At 100 pwm the wheels make 0.96 m/s and 4.3 rad/s (2-3), (2-5); readings jump by 5 to 12 %
    # (rms), each taken back by the next (`OdometrySensor`).
    max_speed: float = 1.5  # [m/s]
    max_yaw_rate: float = 6.0  # [rad/s]
    tick_age: float = 0.02  # [s] Encoders tick at 50 Hz: a pose may be older than its stamp.
    window: int = 50  # Messages that the offset of the clocks is estimated over: 5 s.
    # [s] After so long without a message to accept, the track begins anew. Whoever drives has
    # stopped long before.
    restart_after: float = 1.0

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        for name in ("max_coordinate", "max_speed", "max_yaw_rate", "restart_after"):
            check_number(name, getattr(self, name), above=0)
        check_number("tick_age", self.tick_age, minimum=0)
        check_number("window", self.window, minimum=1, maximum=1000)


@dc.dataclass(frozen=True)
class OdometryTrack:
    """What is known from the odometry that was accepted."""

    last: Odometry  # Its yaw is unwrapped.
    delays: tuple[float, ...]  # [s] arrival - stamp over the window, the clocks' offset included.
    unchanged_since: float  # [s] arrival of the first message with the last one's values.

    def age(self, now: float, stamp: int | None = None) -> float:
        """Returns how long ago [s] the last odometry was measured, never less than its arrival.

        Args:
            now: [s] time.monotonic().
            stamp: [ns] of another odometry; if it is newer than the last, its age may be negative.
        """
        age = now - self.last.arrival + (self.delays[-1] - min(self.delays))
        return age if stamp is None else age + NS * (self.last.stamp - stamp)


def check(
    track: OdometryTrack | None, odometry: Odometry, limits: OdometryLimits
) -> tuple[OdometryTrack | None, str | None]:
    """Returns the track with a message, or the same track and why the message is rejected.

    Args:
        track: What was accepted so far; None: nothing.
        odometry: The message, with its arrival.
        limits: The limits.
    """
    try:
        check_number("stamp", odometry.stamp, minimum=0, maximum=MAX_STAMP)
        check_array("pose", odometry.pose, (POSE_SIZE,))
        check_array("body_velocity", odometry.body_velocity, (POSE_SIZE,))
    except ValueError as error:
        return track, str(error)
    pose = np.array(odometry.pose, dtype=float)
    velocity = np.array(odometry.body_velocity, dtype=float)
    odometry = dc.replace(odometry, pose=pose, body_velocity=velocity)
    gone = track is None or odometry.arrival - track.last.arrival > limits.restart_after
    before = None if gone else track
    reason = _out_of_range(odometry, limits)
    if reason is None and before is not None:
        reason = _contradiction(before, odometry, limits)
    if reason is not None:
        return track, reason
    delay = odometry.arrival - NS * odometry.stamp
    if before is None:
        return OdometryTrack(odometry, (delay,), odometry.arrival), None
    pose[YAW] = unwrap_near(pose[YAW], before.last.pose[YAW])
    delays = (*before.delays, delay)[-limits.window :]
    unchanged_since = before.unchanged_since if _same(odometry, before.last) else odometry.arrival
    return OdometryTrack(odometry, delays, unchanged_since), None


def _same(odometry: Odometry, last: Odometry) -> bool:
    """Tells whether pose and velocity are the same to the last bit, as no moving robot's are."""
    return np.array_equal(odometry.pose, last.pose) and np.array_equal(
        odometry.body_velocity, last.body_velocity
    )


def _out_of_range(odometry: Odometry, limits: OdometryLimits) -> str | None:
    """Returns what no odometry says, or None."""
    largest = np.max(np.abs(odometry.pose))
    if largest > limits.max_coordinate:
        return f"pose: {largest:.4g} is out of range (limit {limits.max_coordinate:g})"
    vx, vy, yaw_rate = odometry.body_velocity
    speed, turning = math.hypot(vx, vy), abs(yaw_rate)
    if speed > limits.max_speed:
        return f"speed: {speed:.4g} m/s is out of range (limit {limits.max_speed:g} m/s)"
    if turning > limits.max_yaw_rate:
        return (
            f"yaw rate: {turning:.4g} rad/s is out of range (limit {limits.max_yaw_rate:g} rad/s)"
        )
    return None


def _contradiction(track: OdometryTrack, odometry: Odometry, limits: OdometryLimits) -> str | None:
    """Returns what does not follow the odometry before, or None."""
    step = NS * (odometry.stamp - track.last.stamp)
    if step <= 0:
        return f"stamp: {-step:.3f} s older than the last one's" if step else "stamp: came before"
    # The stamps say how long the robot had to get here. It was not longer than since the last
    # odometry was measured, so that a clock that steps forward lets no jump in.
    elapsed = min(step, track.age(odometry.arrival)) + limits.tick_age
    jump = pose_error(odometry.pose, track.last.pose)
    distance, turn = math.hypot(jump[0], jump[1]), abs(jump[YAW])
    if distance > limits.max_speed * elapsed:
        return f"jump of {distance:.3g} m in {elapsed:.3f} s (limit {limits.max_speed:g} m/s)"
    if turn > limits.max_yaw_rate * elapsed:
        return f"jump of {turn:.3g} rad in {elapsed:.3f} s (limit {limits.max_yaw_rate:g} rad/s)"
    return None
