import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mirte_drake.angles import wrap_angle
from mirte_drake.control.waypoint_path import WaypointPath
from mirte_drake.scenario_file import load_scenario
from mirte_drake.typed_yaml import write_typed

TS = 0.1
CORNER = [[0.0, 0.0], [0.6, 0.0], [0.6, 0.4]]


def make_path(waypoints=CORNER, **kwargs) -> WaypointPath:
    path = WaypointPath([np.array(waypoint) for waypoint in waypoints], **kwargs)
    path.validate()
    return path


def distances(poses, waypoint):
    return np.hypot(*(poses[:, :2] - np.asarray(waypoint)[:2]).T)


def test_straight_line_by_hand():
    # 0.5 s to reach 0.15 m/s, 3.5 s at it, 0.5 s to brake: 0.0375 + 0.525 + 0.0375 m.
    poses = make_path([[0.0, 0.0], [0.6, 0.0]]).poses(TS)
    assert len(poses) == 46
    expected = [0.0, 0.0015, 0.0375, 0.2925, 0.5625, 0.5985, 0.6]
    np.testing.assert_allclose(poses[[0, 1, 5, 22, 40, 44, 45], 0], expected, atol=1e-5)
    np.testing.assert_array_equal(poses[:, 1:], 0.0)


def test_short_way_does_not_reach_its_speed():
    # Half the way at 0.3 m/s^2 takes sqrt(2 * 0.005 / 0.3) = 0.183 s, so 0.365 s in all.
    poses = make_path([[0.0, 0.0], [0.01, 0.0]]).poses(TS)
    assert len(poses) == 5  # Stretched to 0.4 s.
    np.testing.assert_allclose(poses[2, 0], 0.005, atol=1e-12)
    np.testing.assert_allclose(poses[[0, -1], 0], [0.0, 0.01], atol=1e-15)


def test_turn_on_the_spot_takes_as_long_as_its_yaw_rate_allows():
    path = make_path([[1.0, 2.0, 0.0], [1.0, 2.0, 1.0]], heading="given")
    poses = path.poses(TS)
    # Yaw follows the same ramps: 0.5 s each at the ends and 1.5 s at 0.5 rad/s.
    assert len(poses) == 26
    np.testing.assert_array_equal(poses[:, :2], np.tile([1.0, 2.0], (26, 1)))
    np.testing.assert_allclose(np.max(np.diff(poses[:, 2])), 0.05, atol=1e-6)
    np.testing.assert_allclose(poses[-1, 2], 1.0)


def test_constant_heading_is_that_of_the_first_waypoint():
    poses = make_path([[0.0, 0.0, 0.7], [1.0, 1.0]]).poses(TS)
    np.testing.assert_array_equal(poses[:, 2], 0.7)
    np.testing.assert_array_equal(make_path().poses(TS)[:, 2], 0.0)


def test_given_heading_turns_evenly_along_a_leg():
    poses = make_path([[0, 0, 0.5], [1, 0, 1.5]], heading="given", yaw_rate=10.0).poses(TS)
    np.testing.assert_allclose(poses[:, 2], 0.5 + poses[:, 0], atol=1e-12)


def test_tangent_heading_turns_on_the_spot_at_stops():
    poses = make_path(heading="tangent").poses(TS)
    at_corner = distances(poses, CORNER[1]) < 1e-12
    assert at_corner.sum() > 20  # pi / 2 at 0.5 rad/s takes 3 s.
    assert poses[0, 2] == 0.0
    np.testing.assert_allclose(poses[at_corner][[0, -1], 2], [0.0, np.pi / 2])
    np.testing.assert_allclose(poses[-1], [0.6, 0.4, np.pi / 2])


def test_tangent_heading_of_a_smooth_path_is_the_direction_of_travel():
    poses = make_path(heading="tangent", corners="smooth").poses(0.01)
    ahead = poses[2:, :2] - poses[:-2, :2]
    direction = np.arctan2(ahead[:, 1], ahead[:, 0])
    np.testing.assert_allclose(wrap_angle(poses[1:-1, 2] - direction), 0.0, atol=2e-3)


def test_a_round_trip_is_unwrapped():
    square = [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]
    for corners in "stop", "smooth":
        poses = make_path(square, heading="tangent", corners=corners).poses(TS)
        assert np.all(np.abs(np.diff(poses[:, 2])) <= 0.05 + 1e-6)
        assert poses[-1, 2] - poses[0, 2] > 1.4 * np.pi


def test_smooth_corners_are_passed_without_a_stop_but_slower():
    path = make_path(corners="smooth", acceleration_limit=0.05)
    step = np.linalg.norm(np.diff(path.poses(TS), axis=0), axis=1)
    corner = np.argmin(distances(path.poses(TS), CORNER[1]))
    assert 0.005 < step[corner] < 0.013
    assert np.max(step) > 0.0135


coordinates = st.floats(-2.0, 2.0).map(lambda value: round(value, 3))
waypoints = st.lists(
    st.tuples(coordinates, coordinates, st.floats(-6.0, 6.0)), min_size=2, max_size=5
)


@settings(max_examples=40, deadline=None)
@given(
    waypoints,
    st.sampled_from(("constant", "tangent", "given")),
    st.floats(0.05, 0.5),
    st.floats(0.1, 2.0),
    st.floats(0.1, 1.0),
)
def test_stops_are_on_samples_and_limits_hold(waypoints, heading, speed, yaw_rate, acceleration):
    waypoints = np.array(waypoints)
    assume(np.all(np.linalg.norm(np.diff(waypoints[:, :2], axis=0), axis=1) > 0.05))
    listed = waypoints if heading == "given" else waypoints[:, :2]
    poses = make_path(
        listed, heading=heading, speed=speed, yaw_rate=yaw_rate, acceleration_limit=acceleration
    ).poses(TS)
    np.testing.assert_allclose(poses[[0, -1], :2], waypoints[[0, -1], :2], atol=1e-12)
    first = 0
    for waypoint in listed:  # Each one after the other.
        reached = np.flatnonzero(distances(poses[first:], waypoint) < 1e-9)
        assert len(reached) > 0
        first += int(reached[0])
    velocity = np.diff(poses, axis=0, prepend=poses[:1], append=poses[-1:]) / TS
    assert np.max(np.hypot(velocity[:, 0], velocity[:, 1])) <= speed * (1 + 1e-6)
    assert np.max(np.abs(velocity[:, 2])) <= yaw_rate * (1 + 1e-6)
    change = np.diff(velocity, axis=0) / TS
    # At rest at both ends too: a stop shared by two legs changes direction at no speed.
    assert np.max(np.hypot(change[:, 0], change[:, 1])) <= acceleration * (1 + 1e-3)


@settings(max_examples=20, deadline=None)
@given(waypoints, st.sampled_from(("constant", "given")), st.floats(0.05, 0.5))
def test_smooth_paths_pass_their_waypoints_within_limits(waypoints, heading, speed):
    waypoints = np.array(waypoints)
    assume(np.all(np.linalg.norm(np.diff(waypoints[:, :2], axis=0), axis=1) > 0.2))
    listed = waypoints if heading == "given" else waypoints[:, :2]
    path = make_path(listed, heading=heading, speed=speed, corners="smooth")
    period = 0.02
    poses = path.poses(period)
    np.testing.assert_allclose(poses[[0, -1], :2], waypoints[[0, -1], :2], atol=1e-12)
    for waypoint in listed:
        assert np.min(distances(poses, waypoint)) <= 0.5 * speed * period + 1e-6
    velocity = np.diff(poses, axis=0) / period
    assert (
        np.max(np.hypot(velocity[:, 0], velocity[:, 1])) <= speed * 1.01
    )  # A cusp is met by the grid.
    assert np.max(np.abs(velocity[:, 2])) <= path.yaw_rate * 1.01
    for end in velocity[0], velocity[-1]:
        assert np.hypot(end[0], end[1]) <= path.acceleration_limit * period


def test_runs_from_yaml_and_is_written_as_it_was_read(tmp_path):
    path = tmp_path / "mine.scenario.yaml"
    path.write_text(
        "extends: circle\n"
        "reference: !WaypointPath {waypoints: [[0, 0, 0.5], [1, 0]], corners: smooth}\n"
    )
    scenario = load_scenario(str(path), ["reference.speed=0.3"])
    np.testing.assert_array_equal(scenario.first_pose, [0.0, 0.0, 0.5])
    assert scenario.reference.corners == "smooth"
    write_typed(scenario, tmp_path / "again.yaml")
    again = load_scenario(str(tmp_path / "again.yaml"))
    np.testing.assert_array_equal(again.reference.poses(TS), scenario.reference.poses(TS))


@pytest.mark.parametrize(
    ("path", "problem"),
    [
        (WaypointPath(speed=0.0), "speed: must be > 0"),
        (WaypointPath(yaw_rate=-1.0), "yaw_rate: must be > 0"),
        (WaypointPath(acceleration_limit=np.nan), "acceleration_limit: must be a finite number"),
        (WaypointPath(corners="round"), "corners: must be one of stop, smooth"),
        (WaypointPath(heading="north"), "heading: must be one of constant, tangent, given"),
        (WaypointPath([np.zeros(2)]), "waypoints: must be at least two, got 1"),
        (WaypointPath([np.zeros(2), np.zeros(1)]), r"waypoints\[1\]: must have shape"),
        (WaypointPath([np.zeros(2), np.array([np.inf, 0])]), r"waypoints\[1\]: must be finite"),
        (WaypointPath([np.zeros(2), np.zeros(2)]), r"waypoints\[1\]: is the one before again"),
        (WaypointPath([np.zeros(3), np.ones(3)]), r"waypoints\[1\]: has a yaw, which is for head"),
        (WaypointPath([np.zeros(3), np.ones(2)], heading="tangent"), r"waypoints\[0\]: has a yaw"),
        (WaypointPath([np.zeros(3), np.ones(2)], heading="given"), r"waypoints\[1\]: must have sh"),
    ],
)
def test_bad_paths_are_named(path, problem):
    with pytest.raises(ValueError, match=problem):
        path.validate()
