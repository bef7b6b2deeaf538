import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mirte_drake.control.reference_paths import (
    CirclePath,
    RectanglePath,
    VelocityCirclePath,
    VelocityLeg,
    VelocityLegsPath,
    integrate_body_velocity,
    sample_times,
    slew,
    window,
)

TS = 0.1


def test_sample_times_reach_the_end():
    np.testing.assert_allclose(sample_times(0.3, TS), [0.0, 0.1, 0.2, 0.3])
    assert len(sample_times(2.9, TS)) == 30  # 2.9 / 0.1 is just below 29.


@pytest.mark.parametrize(
    ("path", "samples"),
    [
        (RectanglePath(), 251),
        (CirclePath(), 301),
        (CirclePath(radius=0.6, heading="tangent"), 301),
    ],
)
def test_paths_of_the_study_have_their_samples_and_close(path, samples):
    path.validate()
    poses = path.poses(TS)
    assert poses.shape == (samples, 3)
    np.testing.assert_allclose(poses[0, :2], poses[-1, :2], atol=1e-15)


def test_rectangle_goes_right_up_left_down():
    poses = RectanglePath().poses(TS)
    corners = [[-0.3, -0.2], [0.3, -0.2], [0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2]]
    at_corner = [0, 62, 125, 187, 250]  # 0, 6.2, 12.5, 18.7, 25 s.
    np.testing.assert_allclose(poses[at_corner, :2], corners, atol=1e-15)
    np.testing.assert_array_equal(poses[:, 2], 0.0)


def test_rectangle_rests_for_the_last_part_of_each_side():
    times, poses = sample_times(25.0, TS), RectanglePath().poses(TS)
    for side, corner in enumerate([[0.3, -0.2], [0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2]]):
        end = 6.25 * (side + 1)
        rest = (times >= end - 0.4 - 1e-9) & (times <= end + 1e-9)
        assert rest.sum() in (4, 5)
        np.testing.assert_allclose(poses[rest, :2], np.tile(corner, (rest.sum(), 1)), atol=1e-14)
        drive = (times > end - 6.25) & (times < end - 0.4 - 1e-9)
        assert np.all(np.any(np.abs(poses[drive, :2] - corner) > 1e-3, axis=1))


def test_rectangle_drives_each_side_at_constant_speed():
    velocity = np.diff(RectanglePath().poses(TS)[:58], axis=0) / TS
    np.testing.assert_allclose(velocity, np.tile([0.6 / 5.85, 0.0, 0.0], (57, 1)), atol=1e-12)


def test_rectangle_without_rest_keeps_moving():
    steps = np.diff(RectanglePath(duration=20.0, rest=0.0).poses(TS), axis=0)
    assert np.all(np.linalg.norm(steps, axis=1) > 0.007)


def test_circle_at_constant_heading():
    poses = CirclePath().poses(TS)
    np.testing.assert_allclose(np.hypot(poses[:, 0], poses[:, 1]), 0.4)
    np.testing.assert_allclose(poses[[0, 75, 150], :2], [[0.4, 0], [0, 0.4], [-0.4, 0]], atol=1e-15)
    np.testing.assert_array_equal(poses[:, 2], 0.0)


def test_tangent_heading_is_the_direction_of_travel_and_unwrapped():
    poses = CirclePath(radius=0.6, heading="tangent").poses(TS)
    ahead = poses[2:, :2] - poses[:-2, :2]  # Central difference: along the tangent.
    direction = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
    np.testing.assert_allclose(poses[1:-1, 2], direction, atol=1e-9)
    np.testing.assert_allclose(poses[-1, 2] - poses[0, 2], 2 * np.pi)


def test_robot_rectangle_has_the_leg_lengths_of_its_ramp():
    # 1/20 of 5 s at half the speed on average, the rest at full: 4.875 s.
    path = VelocityLegsPath()
    path.validate()
    period = 0.05  # Divides the ramp, so that the samples catch it exactly.
    poses = path.poses(period)
    assert poses.shape == (419, 3)
    ends = poses[[0, 100, 106, 206, 212, 312, 318, 418]]
    forward, left = 0.3 * 4.875, 0.2 * 4.875
    np.testing.assert_allclose(forward, 1.4625)
    corners = [[0, 0], [forward, 0], [forward, left], [0, left], [0, 0]]
    np.testing.assert_allclose(ends[::2, :2], corners[:-1], atol=1e-12)
    np.testing.assert_allclose(ends[1::2, :2], corners[1:], atol=1e-12)
    np.testing.assert_array_equal(poses[:, 2], 0.0)


def test_robot_rectangle_at_the_controllers_period():
    poses = VelocityLegsPath().poses(TS)
    assert len(poses) == 210
    np.testing.assert_allclose(poses[50, :2], [1.4625, 0.0], atol=1e-12)
    np.testing.assert_allclose(poses[-1], [0.0, 0.0, 0.0], atol=1e-12)


def test_leg_turns_and_starts_where_told():
    leg = VelocityLeg(2.0, np.array([0.5, 0.0, np.pi / 4]))
    start = np.array([1.0, 2.0, np.pi / 2])
    poses = VelocityLegsPath([leg], ramp_fraction=0.0, start=start).poses(TS)
    radius = 0.5 / (np.pi / 4)
    np.testing.assert_allclose(poses[0], start)
    np.testing.assert_allclose(poses[-1], [1.0 - radius, 2.0 + radius, np.pi], atol=1e-12)


def test_ramp_over_a_whole_leg_reaches_half_its_way():
    leg = VelocityLeg(2.0, np.array([0.5, 0.0, 0.0]))
    poses = VelocityLegsPath([leg], ramp_fraction=1.0).poses(TS)
    np.testing.assert_allclose(poses[:, 0], 0.5 * sample_times(2.0, TS) ** 2 / 4, atol=1e-12)


def test_velocity_circle_keeps_heading_and_radius():
    path = VelocityCirclePath(acceleration_limit=100.0)
    path.validate()
    poses = path.poses(TS)
    assert len(poses) == 315  # One round takes 31.4 s.
    assert np.all(poses[:, 2] == 0.0)
    # Turning left from the start: the centre is one radius to the left.
    distance = np.hypot(poses[:, 0], poses[:, 1] - 1.0)
    np.testing.assert_allclose(distance, 1.0, atol=1e-4)
    np.testing.assert_allclose(poses[157, :2], [0.0, 2.0], atol=2e-3)


def test_velocity_circle_starts_within_the_acceleration_limit():
    poses = VelocityCirclePath(acceleration_limit=0.5).poses(TS)
    velocity = np.diff(poses, axis=0) / TS
    change = np.abs(np.diff(velocity, axis=0, prepend=np.zeros((1, 3))))
    assert np.max(change) <= 0.05 + 1e-12
    np.testing.assert_allclose(velocity[:4, 0], [0.05, 0.1, 0.15, 0.2], atol=1e-3)


def test_slew_by_hand():
    value, target = np.array([0.0, 0.0, 5.0, 1.0]), np.array([10.0, -10.0, 5.5, 1.0])
    np.testing.assert_array_equal(slew(value, target, 2.0), [2.0, -2.0, 5.5, 1.0])
    steps = np.array([1.0, 20.0, 0.1, 0.0])
    np.testing.assert_array_equal(slew(value, target, steps), [1.0, -10.0, 5.1, 1.0])


@settings(max_examples=30)
@given(
    st.floats(-1.0, 1.0),
    st.floats(-1.0, 1.0),
    st.floats(0.01, 3.0) | st.floats(-3.0, -0.01),
    st.floats(-5.0, 5.0),
)
def test_integration_of_a_constant_turning_velocity_is_exact(vx, vy, rate, yaw):
    start = np.array([1.0, -2.0, yaw])
    poses = integrate_body_velocity(np.tile([vx, vy, rate], (40, 1)), start, TS)
    heading = yaw + rate * TS * np.arange(41)
    x = 1.0 + (vx * (np.sin(heading) - np.sin(yaw)) + vy * (np.cos(heading) - np.cos(yaw))) / rate
    y = -2.0 + (vy * (np.sin(heading) - np.sin(yaw)) - vx * (np.cos(heading) - np.cos(yaw))) / rate
    np.testing.assert_allclose(poses, np.column_stack([x, y, heading]), rtol=0, atol=1e-11)


def test_integration_without_turning():
    velocities = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    poses = integrate_body_velocity(velocities, np.array([0.0, 0.0, np.pi / 2]), 0.5)
    expected = [[0, 0, np.pi / 2], [0, 0.5, np.pi / 2], [-1.0, 0.5, np.pi / 2]]
    np.testing.assert_allclose(poses, expected, atol=1e-15)


def test_window_stands_still_past_the_end():
    poses = np.arange(15.0).reshape(5, 3)
    np.testing.assert_array_equal(window(poses, 1, 3), poses[1:4])
    np.testing.assert_array_equal(window(poses, 3, 4), poses[[3, 4, 4, 4]])
    np.testing.assert_array_equal(window(poses, 99, 2), poses[[4, 4]])


def test_window_does_not_share_memory_with_the_path():
    poses = np.zeros((5, 3))
    window(poses, 0, 2)[:] = 1.0
    assert not np.any(poses)


@pytest.mark.parametrize(
    ("path", "problem"),
    [
        (RectanglePath(half_width=0.0), "half_width: must be > 0"),
        (RectanglePath(half_height=-1.0), "half_height: must be > 0"),
        (RectanglePath(duration=0.0), "duration: must be > 0"),
        (RectanglePath(rest=-0.1), "rest: must be >= 0"),
        (RectanglePath(duration=1.0, rest=0.25), "rest: must be shorter than a side, 0.25 s"),
        (CirclePath(radius=0.0), "radius: must be > 0"),
        (CirclePath(duration=np.nan), "duration: must be a finite number"),
        (CirclePath(heading="north"), "heading: must be one of constant, tangent"),
        (VelocityLegsPath(legs=[]), "legs: must have at least one leg"),
        (VelocityLegsPath(ramp_fraction=1.1), "ramp_fraction: must be <= 1"),
        (VelocityLegsPath(start=np.zeros(2)), "start: must have shape"),
        (VelocityLegsPath([VelocityLeg(), VelocityLeg(0.0)]), r"legs\[1\].duration: must be > 0"),
        (VelocityLegsPath([VelocityLeg(1.0, np.ones(2))]), r"legs\[0\].velocity: must have shape"),
        (VelocityCirclePath(radius=-1.0), "radius: must be > 0"),
        (VelocityCirclePath(speed=0.0), "speed: must be > 0"),
        (VelocityCirclePath(acceleration_limit=0.0), "acceleration_limit: must be > 0"),
        (VelocityCirclePath(start=np.array([0.0, np.inf, 0.0])), "start: must be finite"),
    ],
)
def test_bad_paths_are_named(path, problem):
    with pytest.raises(ValueError, match=problem):
        path.validate()
