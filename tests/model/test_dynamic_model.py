import dataclasses as dc

import numpy as np
import pytest

from mirte_drake.geometry import HALF_TRACK, HALF_WHEELBASE, INVERSE_KINEMATICS, WHEEL_RADIUS
from mirte_drake.model.drivetrain import DrivetrainParameters, command_for, drive_speed
from mirte_drake.model.dynamic_model import (
    BODY_VELOCITY,
    DRIVE_SPEED,
    MASS,
    STATE_SIZE,
    STICK_SPEED,
    DynamicParameters,
    derivative,
    roll_out,
)
from mirte_drake.vectors import POSE

FORWARD = np.array([1, 1, 1, 1])
LEFT = np.array([-1, 1, -1, 1])
COUNTER_CLOCKWISE = np.array([-1, 1, 1, -1])
REACH = HALF_WHEELBASE + HALF_TRACK
FREE = DynamicParameters()  # Without friction.


def with_friction(friction=2.0, **changes) -> DynamicParameters:
    """Friction of the wheels in rad/s; 0.19 rad/s per pwm make 2 rad/s about 10.6 pwm."""
    drivetrain = DrivetrainParameters(friction=np.full((2, 4), friction))
    return DynamicParameters(drivetrain=drivetrain, **changes)


ROUGH = with_friction(breakaway=0.5, roller_friction=3.0, viscous_friction=0.01)


def drive(parameters, command, seconds=3.0, start=None) -> np.ndarray:
    """States every 10 ms under a held command."""
    steps = round(seconds / 0.01)
    start = np.zeros(STATE_SIZE) if start is None else start
    return roll_out(parameters, start, np.tile(command, (steps, 1)), np.full(steps, 0.01))


def test_steady_motion_without_friction_is_the_kinematic_model():
    command = 50.0 * FORWARD
    final = drive(FREE, command)[-1]
    np.testing.assert_allclose(
        final[BODY_VELOCITY], [WHEEL_RADIUS * 50 * 6 * np.pi / 100, 0, 0], atol=1e-4
    )


@pytest.mark.parametrize("robot", [FREE, ROUGH], ids=["free", "rough"])
@pytest.mark.parametrize(
    ("command", "signs"),
    [
        (FORWARD, [1, 0, 0]),
        (-FORWARD, [-1, 0, 0]),
        (LEFT, [0, 1, 0]),
        (-LEFT, [0, -1, 0]),
        (COUNTER_CLOCKWISE, [0, 0, 1]),
        (-COUNTER_CLOCKWISE, [0, 0, -1]),
        ([0, 1, 0, 1], [1, 1, 0]),  # Diagonally to the front left.
        ([1, 0, 1, 0], [1, -1, 0]),
        ([-1, 0, -1, 0], [-1, 1, 0]),
        ([0, -1, 0, -1], [-1, -1, 0]),
    ],
)
def test_signs_of_motion(robot, command, signs):
    velocity = drive(robot, 60.0 * np.array(command))[-1, BODY_VELOCITY]
    np.testing.assert_array_equal(np.sign(np.round(velocity, 9)), signs)


def test_derivative_by_hand():
    robot = dc.replace(ROUGH, mass=10.0, yaw_inertia=0.5, breakaway=0.0)
    state = np.array([1.0, 2.0, np.pi / 2, 0.4, 0.1, 0.5, 9.0, 10.0, 11.0, 12.0])
    rate = derivative(robot, state, np.full(4, 50.0))
    rim = np.array([0.4 - 0.1 - 0.1125, 0.4 + 0.1 + 0.1125, 0.4 - 0.1 + 0.1125, 0.4 + 0.1 - 0.1125])
    force = (
        13.0 * (WHEEL_RADIUS * state[DRIVE_SPEED] - rim)
        - 13.0 * WHEEL_RADIUS * 2.0
        - 0.01 * rim / WHEEL_RADIUS
    )
    lateral = 0.1 + 0.5 * HALF_WHEELBASE * np.array([1, 1, -1, -1])
    roller = 3.0 * lateral / np.hypot(lateral, 0.1)
    np.testing.assert_allclose(rate[POSE], [-0.1, 0.4, 0.5], atol=1e-15)
    np.testing.assert_allclose(
        rate[BODY_VELOCITY],
        [
            force.sum() / 10 + 0.5 * 0.1,
            (force @ LEFT - roller.sum()) / 10 - 0.5 * 0.4,
            (REACH * force @ COUNTER_CLOCKWISE - HALF_WHEELBASE * roller @ [1, 1, -1, -1]) / 0.5,
        ],
    )
    np.testing.assert_allclose(
        rate[DRIVE_SPEED], (50 * 6 * np.pi / 100 - state[DRIVE_SPEED]) / 0.02
    )


def test_coasting_without_forces_keeps_the_velocity_in_the_world():
    # A motor so weak that it does nothing: Newton's first law, turning body or not.
    free = DynamicParameters(motor_damping=1e-12)
    start = np.array([0, 0, 0, 0.3, 0.1, 1.0, 0, 0, 0, 0.0])
    final = drive(free, np.zeros(4), seconds=2.0, start=start)[-1]
    np.testing.assert_allclose(final[POSE], [0.6, 0.2, 2.0], atol=1e-8)


def test_time_constants_are_mass_and_inertia_over_damping():
    # One lag of the velocity is left once the drive speed stands: m / (4 beta), I / (4 r^2 beta).
    robot = DynamicParameters(drivetrain=DrivetrainParameters(lag=np.full(4, 1e-3)))
    state = np.zeros(STATE_SIZE)
    state[BODY_VELOCITY] = [0.3, -0.2, 0.5]
    rate = derivative(robot, state, np.zeros(4))[BODY_VELOCITY]
    coriolis = 0.5 * np.array([-0.2, -0.3, 0.0])
    expected = coriolis - state[BODY_VELOCITY] * 4 * 13.0 * np.array([1, 1, REACH**2]) / np.array(
        [MASS, MASS, 0.45]
    )
    np.testing.assert_allclose(rate, expected)


@pytest.mark.parametrize(
    "command",
    [
        np.zeros(4),
        10.0 * FORWARD,  # Below 2 rad/s = 10.6 pwm.
        10.0 * LEFT,
        10.0 * COUNTER_CLOCKWISE,
        [10.0, 0, 10.0, 0],  # A diagonal turns two wheels only.
        [20.0, 20.0, 0, 0],  # Two wheels must drag the other two: twice as much.
        [20.0, 0, 0, 0],  # One wheel pushes against its diagonal partner.
    ],
)
def test_below_breakaway_the_robot_stands_exactly_still(command):
    states = drive(with_friction(), np.asarray(command, dtype=float))
    np.testing.assert_allclose(states[:, BODY_VELOCITY], 0.0, atol=1e-15)


@pytest.mark.parametrize(
    "command", [11.0 * FORWARD, [11.0, 0, 11.0, 0], [22.0, 22.0, 0, 0], [22.0, 0, 0, 0]]
)
def test_above_breakaway_it_moves(command):
    velocity = drive(with_friction(), np.asarray(command, dtype=float))[-1, BODY_VELOCITY]
    assert np.linalg.norm(velocity) > 1e-3


def test_at_rest_it_stays_exactly_where_friction_within_its_bounds_can_hold_it():
    robot = with_friction()
    robot.drivetrain.friction[:] = [[1.0, 2.0, 1.5, 2.5], [2.0, 1.0, 2.5, 1.5]]
    forward, backward = robot.drivetrain.friction
    draw, held = np.random.default_rng(7), 0
    for _ in range(300):
        state = np.zeros(STATE_SIZE)
        state[DRIVE_SPEED] = draw.uniform(-4, 4, 4)
        # Friction drive + n (1, 1, -1, -1) balances the drive; is there an n within the bounds?
        sign = np.array([1, 1, -1, -1])
        ends = np.sort([(forward - state[6:]) * sign, (-backward - state[6:]) * sign], axis=0)
        can_hold = ends[0].max() <= ends[1].min()
        held += can_hold
        rate = derivative(robot, state, np.zeros(4))[BODY_VELOCITY]
        assert (np.abs(rate).max() < 1e-12) == can_hold
    assert 30 < held < 270


def test_static_friction_beyond_sliding_friction_raises_the_breakaway():
    robot = with_friction(breakaway=0.5)
    np.testing.assert_allclose(drive(robot, 15.5 * FORWARD)[-1, BODY_VELOCITY], 0.0, atol=1e-15)
    assert drive(robot, 16.5 * FORWARD)[-1, 3] > 1e-3


def test_directions_may_break_away_apart():
    robot = with_friction()
    robot.drivetrain.friction[1] = 4.0
    np.testing.assert_allclose(drive(robot, -20.0 * FORWARD)[-1, BODY_VELOCITY], 0.0, atol=1e-15)
    assert drive(robot, 20.0 * FORWARD)[-1, 3] > 0.05


def test_without_command_it_comes_to_rest_without_reversing():
    start = np.array([0, 0, 0, 0.5, 0.0, 0.0, 0, 0, 0, 0.0])
    speed = drive(with_friction(), np.zeros(4), start=start)[:, 3]
    assert np.all(np.diff(speed) <= 1e-15) and np.all(speed >= 0)
    assert speed[-1] < 1e-12


def test_a_push_dies_out_below_breakaway():
    start = np.zeros(STATE_SIZE)
    start[BODY_VELOCITY] = [0.05, -0.03, 0.2]
    states = drive(with_friction(), 5.0 * FORWARD, seconds=4.0, start=start)
    np.testing.assert_allclose(states[-1, BODY_VELOCITY], 0.0, atol=1e-6)


def test_friction_never_gives_energy():
    draw = np.random.default_rng(3)
    for _ in range(200):
        state = np.zeros(STATE_SIZE)
        state[BODY_VELOCITY] = draw.normal(size=3) * 10.0 ** draw.uniform(-4, 0)
        rate = derivative(ROUGH, state, np.zeros(4))[BODY_VELOCITY]
        inertia = np.array([ROUGH.mass, ROUGH.mass, ROUGH.yaw_inertia])
        assert np.sum(inertia * state[BODY_VELOCITY] * rate) < 0


def test_derivative_is_continuous_where_wheels_reverse():
    draw = np.random.default_rng(4)
    for _ in range(50):
        state = np.zeros(STATE_SIZE)
        state[BODY_VELOCITY] = draw.normal(size=3) * [0.01, 0.01, 0.05]
        state[DRIVE_SPEED] = 5.0 * draw.normal(size=4)
        near = state.copy()
        near[3:] += 1e-9 * draw.normal(size=7)
        jump = derivative(ROUGH, near, np.zeros(4)) - derivative(ROUGH, state, np.zeros(4))
        np.testing.assert_allclose(jump, 0.0, atol=1e-6)


def test_steady_wheels_turn_as_the_drivetrain_says():
    robot = with_friction(1.0)
    wanted = INVERSE_KINEMATICS @ [0.3, 0.0, 0.0]
    velocity = drive(robot, command_for(robot.drivetrain, wanted))[-1, BODY_VELOCITY]
    np.testing.assert_allclose(velocity, [0.3, 0.0, 0.0], atol=1e-4)


def test_roll_out_converges_with_its_step():
    commands = np.random.default_rng(5).uniform(-70, 70, (20, 4))
    start = np.zeros(STATE_SIZE)
    coarse = roll_out(ROUGH, start, commands.repeat(10, axis=0), np.full(200, 0.01))
    fine = roll_out(ROUGH, start, commands.repeat(80, axis=0), np.full(1600, 0.00125))
    np.testing.assert_allclose(coarse[:, :6], fine[::8, :6], atol=4e-3)


def test_derivative_takes_leading_axes():
    draw = np.random.default_rng(6)
    states, commands = draw.normal(size=(3, 2, STATE_SIZE)), draw.uniform(-90, 90, (2, 4))
    batch = derivative(ROUGH, states, commands)
    each = [[derivative(ROUGH, x, u) for x, u in zip(row, commands, strict=True)] for row in states]
    np.testing.assert_array_equal(batch, each)


def test_drive_speeds_lag_behind_their_target():
    states = drive(FREE, np.full(4, 40.0), seconds=0.02)
    target = drive_speed(FREE.drivetrain, np.full(4, 40.0))
    np.testing.assert_allclose(states[-1, DRIVE_SPEED], (1 - np.exp(-1)) * target, rtol=1e-3)


def test_stick_speed_is_small_beside_driving():
    # Friction is as sharp as this: below it a moving robot is not told from one that sticks.
    assert STICK_SPEED < 0.1 * drive(ROUGH, 50.0 * FORWARD)[-1, 3]


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("mass", 0.0),
        ("yaw_inertia", -1.0),
        ("motor_damping", np.nan),
        ("viscous_friction", -0.1),
        ("breakaway", -0.1),
        ("stribeck_speed", 0.0),
        ("roller_friction", -1.0),
        ("roller_speed", 0.0),
    ],
)
def test_rejects_bad_parameters(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        DynamicParameters(**{field: value}).validate()
