"""Reference poses to track, one row per sample: the study's paths and the robot's.

Every path is a dataclass with ``poses(period)``, an array (N, 3) of x, y, yaw [m, m, rad] in the
world frame at 0, period, 2 period, ..., and is loadable from YAML. Yaw is unwrapped.
"""

import dataclasses as dc

import numpy as np

from mirte_drake.angles import rotation
from mirte_drake.checks import check_array, check_choice, check_number
from mirte_drake.vectors import YAW


def sample_times(duration: float, period: float) -> np.ndarray:
    """Returns 0, period, ..., up to and including ``duration`` [s]."""
    return period * np.arange(round(duration / period) + 1)


@dc.dataclass
class RectanglePath:
    """Rectangle at constant heading: right, up, left, down from the lower left corner.

    Each side takes a quarter of the duration; its last ``rest`` seconds stand still, so that the
    corner is less curved (thesis section 4-2-1).

    Deviation: the thesis's text gives 0.3 s of rest, its program 0.4 s; the figures are the
    program's.
    """

    half_width: float = 0.3  # [m] along x.
    half_height: float = 0.2  # [m] along y.
    duration: float = 25.0  # [s] of one round.
    rest: float = 0.4  # [s] at the end of each side.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_number("half_width", self.half_width, above=0)
        check_number("half_height", self.half_height, above=0)
        check_number("duration", self.duration, above=0)
        check_number("rest", self.rest, minimum=0)
        if self.rest >= self.duration / 4:
            raise ValueError(f"rest: must be shorter than a side, {self.duration / 4} s")

    def poses(self, period: float) -> np.ndarray:
        """Returns the poses (N, 3)."""
        side = self.duration / 4
        w, h = self.half_width, self.half_height
        corners = np.array([[-w, -h], [w, -h], [w, h], [-w, h], [-w, -h]])
        starts = side * np.arange(5)
        knots = np.sort(np.concatenate([starts, starts[1:] - self.rest]))
        at_knots = np.vstack([corners[:1], np.repeat(corners[1:], 2, axis=0)])
        t = sample_times(self.duration, period)
        xy = [np.interp(t, knots, at_knots[:, axis]) for axis in range(2)]
        return np.column_stack([*xy, np.zeros_like(t)])


@dc.dataclass
class CirclePath:
    """Counter-clockwise circle about the origin, from (radius, 0)."""

    radius: float = 0.4  # [m]
    duration: float = 30.0  # [s] of one round.
    heading: str = "constant"  # "constant": yaw 0; "tangent": along the path, unwrapped.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_number("radius", self.radius, above=0)
        check_number("duration", self.duration, above=0)
        check_choice("heading", self.heading, ("constant", "tangent"))

    def poses(self, period: float) -> np.ndarray:
        """Returns the poses (N, 3)."""
        angle = 2 * np.pi * sample_times(self.duration, period) / self.duration
        yaw = angle + np.pi / 2 if self.heading == "tangent" else np.zeros_like(angle)
        return np.column_stack([self.radius * np.cos(angle), self.radius * np.sin(angle), yaw])


@dc.dataclass
class VelocityLeg:
    """One stretch of constant body velocity."""

    duration: float = 5.0  # [s]
    velocity: np.ndarray = dc.field(  # (3,) [m/s, m/s, rad/s] vx, vy, yaw rate.
        default_factory=lambda: np.zeros(3)
    )


def _rectangle_legs() -> list[VelocityLeg]:
    legs = []
    for velocity in ([0.3, 0.0, 0.0], [0.0, 0.2, 0.0], [-0.3, 0.0, 0.0], [0.0, -0.2, 0.0]):
        legs += [VelocityLeg(5.0, np.array(velocity)), VelocityLeg(0.3, np.zeros(3))]
    return legs[:-1]


@dc.dataclass
class VelocityLegsPath:
    """Legs of body-velocity setpoints, integrated to poses (thesis section 5-1).

    The velocity ramps up linearly over the first part of each leg. The default is the robot's
    rectangle: forward, left, back, right, with pauses.
    """

    legs: list[VelocityLeg] = dc.field(default_factory=_rectangle_legs)
    ramp_fraction: float = 0.05  # Part of a leg over which the velocity rises to its setpoint.
    start: np.ndarray = dc.field(default_factory=lambda: np.zeros(3))  # [m, m, rad] first pose.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_number("ramp_fraction", self.ramp_fraction, minimum=0, maximum=1)
        check_array("start", self.start, (3,))
        if not self.legs:
            raise ValueError("legs: must have at least one leg")
        for i, leg in enumerate(self.legs):
            check_number(f"legs[{i}].duration", leg.duration, above=0)
            check_array(f"legs[{i}].velocity", leg.velocity, (3,))

    def poses(self, period: float) -> np.ndarray:
        """Returns the poses (N, 3)."""
        durations = np.array([leg.duration for leg in self.legs])
        ends = np.cumsum(durations)
        times = sample_times(ends[-1], period)
        into_leg = np.clip(times[:, None] - (ends - durations), 0.0, durations)
        # Time driven at full speed that covers the same way: the ramp costs half its length.
        ramp = np.maximum(self.ramp_fraction * durations, 1e-12)
        driven = np.where(into_leg < ramp, into_leg**2 / (2 * ramp), into_leg - ramp / 2)
        velocities = np.array([leg.velocity for leg in self.legs])
        means = np.diff(driven, axis=0) @ velocities / period
        return integrate_body_velocity(means, self.start, period)


@dc.dataclass
class VelocityCirclePath:
    """Circle at constant heading from a turning body-velocity setpoint, slew-limited at start."""

    radius: float = 1.0  # [m]
    speed: float = 0.2  # [m/s]
    acceleration_limit: float = 1.0  # [m/s^2] of each velocity component.
    start: np.ndarray = dc.field(default_factory=lambda: np.zeros(3))  # [m, m, rad] first pose.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        for name in ("radius", "speed", "acceleration_limit"):
            check_number(name, getattr(self, name), above=0)
        check_array("start", self.start, (3,))

    def poses(self, period: float) -> np.ndarray:
        """Returns the poses (N, 3)."""
        angular = self.speed / self.radius
        middles = sample_times(2 * np.pi / angular, period)[:-1] + 0.5 * period
        setpoints = np.zeros((len(middles), 3))
        setpoints[:, 0] = self.speed * np.cos(angular * middles)
        setpoints[:, 1] = self.speed * np.sin(angular * middles)
        limit = np.full(3, self.acceleration_limit)
        velocities = np.zeros_like(setpoints)
        velocity = np.zeros(3)
        for k, setpoint in enumerate(setpoints):
            velocity = slew(velocity, setpoint, limit * period)
            velocities[k] = velocity
        return integrate_body_velocity(velocities, self.start, period)


def slew(value: np.ndarray, target: np.ndarray, step: np.ndarray | float) -> np.ndarray:
    """Returns ``value`` moved towards ``target`` by at most ``step`` in every entry."""
    return value + np.clip(target - value, -step, step)


def integrate_body_velocity(velocities: np.ndarray, start: np.ndarray, period: float) -> np.ndarray:
    """Returns the poses (N + 1, 3) of a robot that holds each body velocity (N, 3) for a period.

    Exact for the held velocity: the chord of the turned arc is travelled at the middle yaw.
    """
    yaw = start[YAW] + period * np.concatenate([[0.0], np.cumsum(velocities[:, YAW])])
    half_turn = 0.5 * period * velocities[:, YAW]
    chord = velocities * np.sinc(half_turn / np.pi)[:, None]
    world = np.einsum("kij,kj->ki", rotation(yaw[:-1] + half_turn), chord)
    xy = start[:2] + period * np.vstack([np.zeros(2), np.cumsum(world[:, :2], axis=0)])
    return np.column_stack([xy, yaw])


def window(poses: np.ndarray, first: int, length: int) -> np.ndarray:
    """Returns ``length`` poses from index ``first`` on; past its end the path stands still."""
    return poses[np.clip(np.arange(first, first + length), 0, len(poses) - 1)]
