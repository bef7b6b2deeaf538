import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mirte_drake.frames import path_frame, to_odometry_frame, to_path_frame

NUMBER = st.floats(-50.0, 50.0)
POSE = st.tuples(NUMBER, NUMBER, NUMBER).map(np.array)


def test_a_robot_that_is_turned_left_drives_the_paths_x_along_its_own_left():
    # The robot stands at (5, 2) and looks along y where the path begins at (1, 0) along x.
    frame = path_frame(np.array([5.0, 2.0, np.pi / 2]), np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(frame, [5.0, 1.0, np.pi / 2], atol=1e-15)
    # One metre further along the path, half a metre to its left and turned by 0.3 rad.
    ahead = to_odometry_frame(np.array([2.0, 0.5, 0.3]), frame)
    np.testing.assert_allclose(ahead, [4.5, 3.0, np.pi / 2 + 0.3], atol=1e-15)


def test_a_path_that_begins_turned_is_turned_back():
    # The path's start looks along its y; the robot's odometry begins at zero.
    frame = path_frame(np.zeros(3), np.array([0.6, 0.0, np.pi / 2]))
    np.testing.assert_allclose(frame, [0.0, 0.6, -np.pi / 2], atol=1e-15)


@given(POSE, POSE)
def test_both_starts_are_the_same_place(odometry_pose, path_pose):
    frame = path_frame(odometry_pose, path_pose)
    np.testing.assert_allclose(to_odometry_frame(path_pose, frame), odometry_pose, atol=1e-12)
    np.testing.assert_allclose(to_path_frame(odometry_pose, frame), path_pose, atol=1e-12)


@given(POSE, st.lists(POSE, min_size=1, max_size=4).map(np.array))
def test_there_and_back_over_a_batch(frame, poses):
    there = to_odometry_frame(poses, frame)
    np.testing.assert_allclose(to_path_frame(there, frame), poses, atol=1e-12)
    for pose, one in zip(poses, there, strict=True):
        np.testing.assert_allclose(to_odometry_frame(pose, frame), one, atol=1e-12)


@given(POSE)
def test_whole_turns_of_yaw_are_kept(frame):
    poses = np.array([[1.0, 2.0, 0.1], [1.0, 2.0, 0.1 + 2 * np.pi]])
    there = to_odometry_frame(poses, frame)
    np.testing.assert_allclose(there[1] - there[0], [0.0, 0.0, 2 * np.pi], atol=1e-12)
