"""A path through waypoints, as fast as its limits on speed and acceleration allow."""

import dataclasses as dc
import itertools
from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline

from mirte_drake.checks import check_array, check_choice, check_number
from mirte_drake.control.reference_paths import sample_times
from mirte_drake.vectors import YAW

STEPS = 400  # Of the grid on which a piece between two stops is timed, for each leg in it.

Curve = Callable[[np.ndarray], np.ndarray]  # From (M,) in [0, 1] to poses (M, 3).


def _corner() -> list[np.ndarray]:
    return [np.array([0.0, 0.0]), np.array([0.6, 0.0]), np.array([0.6, 0.4])]


@dc.dataclass
class WaypointPath:
    """Path through waypoints [x, y] or [x, y, yaw], at rest at the first and the last one.

    Turning takes its time as moving does: where yaw changes by much over a short way, the path
    slows down so that ``yaw_rate`` holds. Two waypoints at the same place with different yaw are
    a turn on the spot.
    """

    waypoints: list[np.ndarray] = dc.field(default_factory=_corner)  # [m, m] or [m, m, rad] each.
    speed: float = 0.15  # [m/s] highest.
    yaw_rate: float = 0.5  # [rad/s] highest.
    acceleration_limit: float = 0.3  # [m/s^2] along the path, and across it in smooth corners.
    # "stop": straight from one waypoint to the next, and at rest at each; "smooth": along a cubic
    # spline through all of them, slower where it is curved.
    corners: str = "stop"
    # "constant": the yaw of the first waypoint, 0 where it has none; "tangent": along the path,
    # with turns on the spot at stops; "given": each waypoint's own, as many turns as are written.
    heading: str = "constant"

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        for name in ("speed", "yaw_rate", "acceleration_limit"):
            check_number(name, getattr(self, name), above=0)
        check_choice("corners", self.corners, ("stop", "smooth"))
        check_choice("heading", self.heading, ("constant", "tangent", "given"))
        if len(self.waypoints) < 2:
            raise ValueError(f"waypoints: must be at least two, got {len(self.waypoints)}")
        for i, waypoint in enumerate(self.waypoints):
            self._check_waypoint(f"waypoints[{i}]", waypoint, first=i == 0)
        still = np.flatnonzero(self._travel(self._corners()) == 0)
        if len(still):
            raise ValueError(f"waypoints[{still[0] + 1}]: is the one before again; leave one out")

    def _check_waypoint(self, name: str, waypoint: np.ndarray, *, first: bool) -> None:
        given = self.heading == "given"
        with_yaw = np.shape(waypoint) == (3,)
        if with_yaw and not (given or (first and self.heading == "constant")):
            raise ValueError(f"{name}: has a yaw, which is for heading: given, got {waypoint}")
        check_array(name, waypoint, (3,) if with_yaw or given else (2,))

    def poses(self, period: float) -> np.ndarray:
        """Returns the poses (N, 3); each stop falls on a sample."""
        pieces = [self._timed(curve, legs, period) for curve, legs in self._pieces()]
        return np.vstack([pieces[0][:1], *(piece[1:] for piece in pieces)])

    def _corners(self) -> np.ndarray:
        """Returns the waypoints as poses (M, 3); yaw is that of the first where none is given."""
        yaws = [waypoint[YAW] if len(waypoint) == 3 else 0.0 for waypoint in self.waypoints]
        if self.heading != "given":
            yaws = yaws[:1] * len(yaws)
        return np.column_stack([[waypoint[:2] for waypoint in self.waypoints], yaws])

    def _pieces(self) -> list[tuple[Curve, int]]:
        """Returns the curves between stops, and how many legs each has."""
        corners = self._corners()
        if self.corners == "smooth":
            return [(_spline(corners, self._travel(corners), self.heading), len(corners) - 1)]
        if self.heading == "tangent":
            corners = _facing_ahead(corners)
        legs = itertools.pairwise(corners)
        return [(_line(start, end), 1) for start, end in legs if np.any(start != end)]

    def _travel(self, poses: np.ndarray) -> np.ndarray:
        """Returns the way between poses (M, 3) as (M - 1,) [m], which takes its length / speed.

        A turn counts as the way that takes as long.
        """
        steps = np.diff(poses, axis=0)
        turns = np.abs(steps[:, YAW]) * self.speed / self.yaw_rate
        return np.maximum(np.hypot(steps[:, 0], steps[:, 1]), turns)

    def _timed(self, curve: Curve, legs: int, period: float) -> np.ndarray:
        """Returns the poses of one piece, from rest to rest in a whole number of samples."""
        u = np.linspace(0.0, 1.0, legs * STEPS + 1)
        poses = curve(u)
        way = np.concatenate([[0.0], np.cumsum(self._travel(poses))])
        # Squares of the speed: linear in the way where the acceleration is constant.
        squares = np.minimum(self.speed**2, self.acceleration_limit / _curvature(poses, way))
        squares[[0, -1]] = 0.0
        gain = 2 * self.acceleration_limit * way
        squares = np.minimum.accumulate(squares - gain) + gain
        squares = np.minimum.accumulate((squares + gain)[::-1])[::-1] - gain
        speed = np.sqrt(np.maximum(squares, 0.0))
        times = np.concatenate([[0.0], np.cumsum(2 * np.diff(way) / (speed[1:] + speed[:-1]))])

        duration = period * np.ceil(times[-1] / period - 1e-9)
        t = sample_times(duration, period) * (times[-1] / duration)
        i = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(u) - 2)
        share = (t - times[i]) / (times[i + 1] - times[i])
        # The speed is linear in time within a step of the grid.
        mean = speed[i] + 0.5 * share * (speed[i + 1] - speed[i])
        travelled = way[i] + mean * (t - times[i])
        return curve(np.interp(travelled, way, u))


def _line(start: np.ndarray, end: np.ndarray) -> Curve:
    return lambda u: start + u[:, None] * (end - start)


def _facing_ahead(corners: np.ndarray) -> np.ndarray:
    """Returns corners (M, 3) twice: once facing the leg that ends there, once the next one."""
    steps = np.diff(corners, axis=0)
    directions = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    twice = np.repeat(corners, 2, axis=0)[1:-1]
    twice[:, YAW] = np.repeat(directions, 2)
    return twice


def _spline(corners: np.ndarray, lengths: np.ndarray, heading: str) -> Curve:
    """Returns the natural cubic spline through corners (M, 3), knots by the way between them."""
    knots = np.concatenate([[0.0], np.cumsum(lengths)])
    spline = CubicSpline(knots / knots[-1], corners, bc_type="natural")

    def curve(u: np.ndarray) -> np.ndarray:
        poses = spline(u)
        if heading == "tangent":
            ahead = spline(u, 1)
            poses[:, YAW] = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
        return poses

    return curve


def _curvature(poses: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Returns by how much the direction of travel turns per way, (M,) [rad/m], never zero."""
    steps = np.diff(poses, axis=0)
    turns = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
    curvature = np.abs(turns) / (0.5 * (way[2:] - way[:-2]))
    return np.maximum(np.pad(curvature, 1, mode="edge"), 1e-12)
