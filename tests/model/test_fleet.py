import numpy as np

from mirte_drake.geometry import PWM_SPEED, WHEEL_RADIUS
from mirte_drake.model.dynamic_model import STATE_SIZE, DynamicParameters, roll_out
from mirte_drake.model.fleet import clean, fleet, loaded, scaled
from mirte_drake.model.robot_file import load_robot_file

FITTED = load_robot_file("fitted").parameters


def velocity(robot: DynamicParameters, command, seconds=3.0) -> np.ndarray:
    steps = round(seconds / 0.01)
    states = roll_out(
        robot, np.zeros(STATE_SIZE), np.tile(command, (steps, 1)), np.full(steps, 0.01)
    )
    return states[-1, 3:6]


def test_all_robots_are_valid_and_differ():
    robots = fleet(FITTED)
    for robot in robots.values():
        robot.validate()
    finals = np.array([velocity(r, np.array([60.0, 40.0, 50.0, 55.0])) for r in robots.values()])
    distances = np.abs(finals[:, None] - finals).max(axis=-1) + np.eye(len(finals))
    assert distances.min() > 1e-3


def test_same_seed_same_fleet():
    first, second, other = fleet(FITTED, 3), fleet(FITTED, 3), fleet(FITTED, 4)
    for name in first:
        np.testing.assert_array_equal(first[name].drivetrain.gain, second[name].drivetrain.gain)
    assert not np.allclose(first["mixed_1"].drivetrain.gain, other["mixed_1"].drivetrain.gain)


def test_making_a_fleet_leaves_the_robot_alone():
    before = FITTED.drivetrain.gain.copy(), FITTED.mass
    fleet(FITTED)
    np.testing.assert_array_equal(FITTED.drivetrain.gain, before[0])
    assert FITTED.mass == before[1]


def test_clean_robot_is_the_kinematic_one():
    actual = velocity(clean(FITTED), np.full(4, 50.0))
    np.testing.assert_allclose(actual, [50 * PWM_SPEED * WHEEL_RADIUS, 0, 0], atol=1e-4)


def test_strong_wheels_friction_and_payload_do_what_they_say():
    command = np.full(4, 50.0)
    speeds = {name: velocity(robot, command)[0] for name, robot in fleet(FITTED).items()}
    fitted = velocity(FITTED, command)[0]
    assert speeds["weak_wheels"] < fitted < speeds["strong_wheels"]
    assert speeds["high_friction"] < fitted < speeds["low_friction"]
    early = velocity(loaded(FITTED, 5.0), command, seconds=0.2)[0]
    assert early < 0.9 * velocity(FITTED, command, seconds=0.2)[0]


def test_one_sided_robot_turns_to_its_weak_side():
    straight, one_sided = (
        velocity(robot, np.full(4, 50.0))[2] for robot in (FITTED, fleet(FITTED)["one_sided"])
    )
    assert one_sided < straight - 0.02  # Clockwise: the right wheels are weaker.


def test_loaded_by_hand():
    robot = loaded(FITTED, 6.8)
    assert robot.mass == FITTED.mass + 6.8
    # A rectangle of 0.18 m by 0.27 m.
    assert robot.yaw_inertia == FITTED.yaw_inertia + (0.18**2 + 0.27**2) / 12 * 6.8
    assert robot.roller_friction == 1.5 * FITTED.roller_friction


def test_scaled_takes_a_factor_for_each_wheel():
    factor = np.array([0.5, 1.0, 1.0, 2.0])
    robot = scaled(FITTED, gain=factor, friction=3.0)
    np.testing.assert_array_equal(robot.drivetrain.gain, FITTED.drivetrain.gain * factor)
    np.testing.assert_array_equal(robot.drivetrain.friction, 3.0 * FITTED.drivetrain.friction)
    assert robot.roller_friction == FITTED.roller_friction
