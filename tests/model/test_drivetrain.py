import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mirte_drake.geometry import pwm_to_wheel_speed
from mirte_drake.model.drivetrain import (
    DrivetrainParameters,
    command_for,
    drive_speed,
    lagged_speed,
    steady_speed,
)

UNEVEN = DrivetrainParameters(
    gain=np.array([[0.1, 0.2, 0.3, 0.4], [0.2, 0.2, 0.2, 0.2]]),
    deadband=np.array([[10.0, 0.0, 5.0, 8.0], [20.0, 10.0, 0.0, 0.0]]),
    friction=np.array([[0.5, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, 2.0]]),
    lag=np.array([0.1, 0.2, 0.4, 0.5]),
)


def test_the_default_is_the_ideal_drivetrain():
    command = np.array([50.0, -50.0, 0.0, 100.0])
    ideal = DrivetrainParameters()
    np.testing.assert_allclose(drive_speed(ideal, command), pwm_to_wheel_speed(command))
    np.testing.assert_allclose(steady_speed(ideal, command), pwm_to_wheel_speed(command))


def test_speeds_by_hand():
    command = np.array([[30.0, 30.0, 30.0, 30.0], [-30.0, -30.0, -30.0, -30.0]])
    drive = [[2.0, 6.0, 7.5, 8.8], [-2.0, -4.0, -6.0, -6.0]]
    np.testing.assert_allclose(drive_speed(UNEVEN, command), drive)
    steady = [[1.5, 6.0, 6.5, 8.8], [-1.0, -4.0, -6.0, -4.0]]
    np.testing.assert_allclose(steady_speed(UNEVEN, command), steady)


def test_nothing_turns_within_the_deadband_or_below_friction():
    assert np.all(drive_speed(UNEVEN, np.array([10.0, 0.0, -0.0, 8.0])) == 0)
    assert steady_speed(UNEVEN, np.array([14.0, 0.0, 0.0, 0.0]))[0] == 0  # 0.4 against 0.5 rad/s.


def test_commands_saturate():
    np.testing.assert_array_equal(
        drive_speed(UNEVEN, np.full(4, 500.0)), drive_speed(UNEVEN, np.full(4, 100.0))
    )
    np.testing.assert_array_equal(command_for(UNEVEN, np.full(4, -1e3)), np.full(4, -100.0))


@given(st.lists(st.floats(-5.0, 5.0), min_size=4, max_size=4))
def test_the_inverse_gives_the_wanted_speed(speed):
    wanted = np.where(np.abs(speed) < 1e-6, 0.0, speed)
    np.testing.assert_allclose(
        steady_speed(UNEVEN, command_for(UNEVEN, wanted)), wanted, atol=1e-12
    )


def test_standing_still_takes_no_command():
    np.testing.assert_array_equal(command_for(UNEVEN, np.zeros(4)), np.zeros(4))


def test_lagged_speed_by_hand():
    speed, target = np.array([1.0, 1.0, 1.0, 0.0]), np.array([2.0, 1.0, 0.0, -4.0])
    halves = UNEVEN.lag * np.log(2)  # After these each wheel has gone half of the way.
    for wheel, step in enumerate(halves):
        after = lagged_speed(UNEVEN, speed, target, step)
        assert after[wheel] == pytest.approx(0.5 * (speed + target)[wheel])
    np.testing.assert_array_equal(lagged_speed(UNEVEN, speed, target, 0.0), speed)


def test_functions_take_leading_axes():
    command = np.random.default_rng(1).uniform(-100, 100, (3, 2, 4))
    for function in (drive_speed, steady_speed, command_for):
        each = [[function(UNEVEN, u) for u in row] for row in command]
        np.testing.assert_array_equal(function(UNEVEN, command), each)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("gain", np.zeros((2, 4))),
        ("gain", np.ones(4)),
        ("deadband", np.full((2, 4), -1.0)),
        ("friction", np.full((2, 4), np.nan)),
        ("lag", np.zeros(4)),
        ("lag", np.ones(3)),
        ("delay", -0.1),
    ],
)
def test_rejects_bad_parameters(field, value):
    with pytest.raises(ValueError, match=rf"^{field}: "):
        DrivetrainParameters(**{field: value}).validate()
