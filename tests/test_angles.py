import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mirte_drake.angles import (
    pose_error,
    quaternion_yaw,
    rotation,
    unwrap_near,
    wrap_angle,
    yaw_quaternion,
)

angles = st.floats(-100.0, 100.0)


@settings(max_examples=50)
@given(angles)
def test_wrapped_angle_is_the_same_direction_within_half_a_turn(angle):
    wrapped = float(wrap_angle(angle))
    turns = (angle - wrapped) / (2 * np.pi)
    assert abs(wrapped) <= np.pi
    np.testing.assert_allclose(turns, round(turns), atol=1e-12)


def test_half_a_turn_wraps_to_minus_pi():
    np.testing.assert_array_equal(wrap_angle([np.pi, -np.pi, 0.0]), [-np.pi, -np.pi, 0.0])


def test_wraps_by_hand():
    np.testing.assert_allclose(wrap_angle([3.5, -3.5]), [3.5 - 2 * np.pi, 2 * np.pi - 3.5])


@settings(max_examples=50)
@given(angles, angles)
def test_unwrapped_angle_is_the_same_direction_nearest_to_the_other(angle, near):
    unwrapped = float(unwrap_near(angle, near))
    turns = (angle - unwrapped) / (2 * np.pi)
    assert abs(unwrapped - near) <= np.pi + 1e-12
    np.testing.assert_allclose(turns, round(turns), atol=1e-12)


def test_measured_yaw_that_wraps_is_unwrapped_sample_by_sample():
    truth = np.linspace(0.0, 15.0, 100)
    unwrapped = [0.0]
    for measured in wrap_angle(truth[1:]):
        unwrapped.append(float(unwrap_near(measured, unwrapped[-1])))
    np.testing.assert_allclose(unwrapped, truth, atol=1e-12)


def test_pose_error_wraps_yaw_alone():
    pose, reference = np.array([5.0, -4.0, 3.0, 9.0]), np.array([1.0, 1.0, -3.0, 2.0])
    before = pose.copy()
    np.testing.assert_allclose(pose_error(pose, reference), [4.0, -5.0, 6.0 - 2 * np.pi, 7.0])
    np.testing.assert_array_equal(pose, before)


def test_pose_error_of_integers_and_batches():
    poses, reference = np.array([[[1, 2, 7], [0, 0, 0]]]), np.zeros(3, dtype=int)
    expected = [[[1.0, 2.0, 7 - 2 * np.pi], [0.0, 0.0, 0.0]]]
    np.testing.assert_allclose(pose_error(poses, reference), expected)


def test_rotation_by_a_quarter_turn_takes_forward_to_left():
    np.testing.assert_allclose(rotation(np.pi / 2) @ [1.0, 0.0, 5.0], [0.0, 1.0, 5.0], atol=1e-15)


def test_rotations_of_a_batch_equal_single_ones_and_are_orthogonal():
    yaw = np.array([[0.1, -2.0], [3.0, 40.0]])
    matrices = rotation(yaw)
    assert matrices.shape == (2, 2, 3, 3)
    for index in np.ndindex(2, 2):
        np.testing.assert_array_equal(matrices[index], rotation(yaw[index]))
        np.testing.assert_allclose(matrices[index] @ matrices[index].T, np.eye(3), atol=1e-15)
        np.testing.assert_allclose(np.linalg.det(matrices[index]), 1.0)


@settings(max_examples=50)
@given(angles, st.floats(1e-3, 1e200))
def test_yaw_goes_to_a_quaternion_and_back_whatever_its_length(angle, length):
    quaternion = np.array(yaw_quaternion(angle))
    np.testing.assert_allclose(np.linalg.norm(quaternion), 1.0, rtol=1e-15)
    turned = quaternion_yaw(*(length * quaternion)) - angle
    np.testing.assert_allclose(np.sin(turned / 2), 0.0, atol=1e-12)


def test_yaw_of_a_tilted_robot_by_hand():
    """Rolled by half a turn about x, then turned by a quarter: q_z q_x = (1, 1, 0, 0)/sqrt 2."""
    np.testing.assert_allclose(quaternion_yaw(1.0, 1.0, 0.0, 0.0), np.pi / 2)


def test_quaternions_without_a_direction_have_no_yaw():
    for broken in ([0, 0, 0, 0], [0, 0, np.inf, 1], [0, 0, np.nan, 1]):
        assert np.isnan(quaternion_yaw(*broken))
