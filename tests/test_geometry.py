import numpy as np
import pytest

from mirte_drake.geometry import (
    FORWARD_KINEMATICS,
    HALF_TRACK,
    HALF_WHEELBASE,
    ROLLER_AXES,
    WHEEL_POSITIONS,
    WHEEL_RADIUS,
    body_velocity,
    pwm_to_wheel_speed,
    wheel_speed_to_pwm,
    wheel_speeds,
)


def test_forward_kinematics_is_the_printed_matrix():
    reach = HALF_WHEELBASE + HALF_TRACK
    rows = [[1, 1, 1, 1], [-1, 1, -1, 1], np.array([-1, 1, 1, -1]) / reach]
    np.testing.assert_allclose(FORWARD_KINEMATICS, WHEEL_RADIUS / 4 * np.array(rows), atol=1e-15)


def test_kinematics_follows_from_wheels_and_rollers():
    """At the ground a wheel's speed and the body's agree along the roller's axis."""
    velocity = np.array([0.3, -0.2, 0.7])
    for speed, (x, y), axis in zip(
        wheel_speeds(velocity), WHEEL_POSITIONS, ROLLER_AXES, strict=True
    ):
        of_body = velocity[:2] + velocity[2] * np.array([-y, x])
        assert axis @ of_body == pytest.approx(axis @ [WHEEL_RADIUS * speed, 0.0])


@pytest.mark.parametrize(
    ("signs", "direction"),
    [
        ((1, 1, 1, 1), (1, 0, 0)),
        ((-1, 1, -1, 1), (0, 1, 0)),
        ((-1, 1, 1, -1), (0, 0, 1)),
        ((0, 1, 0, 1), (1, 1, 0)),
        ((1, 0, 1, 0), (1, -1, 0)),
    ],
)
def test_wheels_drive_forward_left_and_counter_clockwise(signs, direction):
    velocity = body_velocity(pwm_to_wheel_speed(50.0 * np.array(signs)))
    np.testing.assert_array_equal(np.sign(np.round(velocity, 12)), direction)


def test_kinematics_is_undone_over_a_batch():
    velocity = np.random.default_rng(0).normal(size=(5, 2, 3))
    np.testing.assert_allclose(body_velocity(wheel_speeds(velocity)), velocity, atol=1e-14)


def test_commands_saturate():
    np.testing.assert_allclose(
        wheel_speed_to_pwm(pwm_to_wheel_speed(np.array([-250.0, 30.0, 250.0]))), [-100, 30, 100]
    )
