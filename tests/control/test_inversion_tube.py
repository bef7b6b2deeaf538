import itertools

import numpy as np
import pytest
from disturbed_robot import disturbed_successor
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mirte_drake.angles import pose_error
from mirte_drake.control.input_inversion import Inversion, invert, jacobian, velocity
from mirte_drake.control.inversion_tube import (
    check_linear_position,
    disturbance_reach,
    propagate_inversion_tube,
    required_room,
    swept_bound,
    turning_speed,
)
from mirte_drake.control.tube import rotated_bound
from mirte_drake.control.turning_map import turning_map
from mirte_drake.model.model_file import load_model
from mirte_drake.model.sparse_model import SparseModel

MODEL = load_model("extended_kinematic")
MAPPING = turning_map(MODEL)
W_MAX = np.array([0.04, 0.03, 0.09])
HALF_WIDTH = np.array([0.005, 0.004, 0.01])
LIMIT = np.full(4, 100.0)
FEEDBACK, PERIOD = 9.0, 0.1
CORNERS = np.array(list(itertools.product((-1, 1), repeat=3)))
seeds = st.integers(0, 2**32 - 1)


def make_model(**derivatives) -> SparseModel:
    """Each of three wheels drives one axis, 0.01 per pwm, whatever the yaw."""
    names = {"x": {"u1": 0.01}, "y": {"u2": 0.01}, "theta": {"u3": 0.01}} | derivatives
    return SparseModel("by hand", ["x", "y", "theta"], ["u1", "u2", "u3", "u4"], names)


def draw_plan(rng, reach=45.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    xhat, ubar = rng.uniform(-3, 3, 3), rng.uniform(-reach, reach, 4)
    return xhat, ubar, MODEL.step(xhat, ubar, PERIOD)


def ask(nominal, x, lower=-LIMIT, upper=LIMIT) -> Inversion:
    """What the law does."""
    xhat, ubar, successor = nominal
    wanted = (successor - xhat) / PERIOD - FEEDBACK * (x - xhat)
    return invert(MAPPING.over(x[2], wanted[2], PERIOD), wanted, ubar, lower, upper)


def law(nominal, x) -> np.ndarray:
    found = ask(nominal, x)
    assert found.fraction == 1.0
    return found.input


def propagate(nominal, x, u, half_width=HALF_WIDTH) -> np.ndarray:
    return propagate_inversion_tube(
        MODEL, MAPPING, nominal[::2], x, u, half_width, W_MAX, FEEDBACK, PERIOD
    )


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_swept_bound_is_the_largest_rotated_bound_of_the_sweep(seed):
    rng = np.random.default_rng(seed)
    bound, yaw, spread = rng.uniform(0, 1, 3), rng.uniform(-7, 7), rng.uniform(0, 2)
    swept = swept_bound(bound, yaw, spread)
    on_the_way = [rotated_bound(bound, yaw + s) for s in np.linspace(-spread, spread, 401)]
    largest = np.max(on_the_way, axis=0)
    assert np.all(largest <= swept + 1e-12)
    np.testing.assert_allclose(largest, swept, rtol=0, atol=1e-4)


def test_swept_bound_without_a_sweep_is_the_rotated_bound():
    for yaw in np.linspace(-7, 7, 50):
        np.testing.assert_allclose(swept_bound(W_MAX, yaw, 0.0), rotated_bound(W_MAX, yaw))


def test_reach_by_hand():
    # Velocities that do not turn, at standstill: the disturbance over a sweep of 0.009 rad.
    mapping = turning_map(make_model())
    reach = disturbance_reach(mapping, 0.0, np.zeros(4), W_MAX, PERIOD)
    cos, sin = np.cos(0.009), np.sin(0.009)
    expected = [0.004 * cos + 0.003 * sin, 0.003 * cos + 0.004 * sin, 0.009]
    np.testing.assert_allclose(reach, expected)


def test_reach_counts_the_turn_of_the_velocity_and_the_error_of_the_integration():
    # 0.2 m/s along the heading and 2 rad/s: over a yaw error of 0.09 rad/s t, 0.2 m/s turns.
    model = make_model(
        x={"cos(theta)*u1": 0.01}, y={"sin(theta)*u1": 0.01, "u2": 0.01}, theta={"u3": 0.01}
    )
    u = np.array([20.0, 0.0, 200.0, 0.0])
    reach = disturbance_reach(turning_map(model), 0.5, u, W_MAX, PERIOD)
    swept = 0.1 + 0.009
    box = PERIOD * swept_bound(W_MAX, 0.6, swept)
    turn = 0.5 * PERIOD**2 * 0.09 * 0.2 * np.array([np.sin(0.6 + swept), np.cos(0.6 - swept)])
    expected = turn + PERIOD**5 / 2880 * 2.0**4 * 0.2
    np.testing.assert_allclose(reach[:2] - box[:2], expected, rtol=1e-9)
    assert reach[2] == box[2]


def test_turning_speed_is_the_largest_slope_of_the_sweep():
    rng = np.random.default_rng(6)
    for _ in range(10):
        yaw, spread, u = rng.uniform(-7, 7), rng.uniform(0, 2), rng.uniform(-50, 50, 4)
        yaws = yaw + np.linspace(-spread, spread, 401)
        x = np.zeros((401, 3))
        x[:, 2] = yaws
        _, A, _ = MODEL.linearise(x, np.tile(u, (401, 1)))
        largest = np.abs(A[:, :, 2]).max(axis=0)
        np.testing.assert_allclose(turning_speed(MAPPING, u, yaw, spread), largest, atol=1e-5)
        assert np.all(turning_speed(MAPPING, u) >= largest - 1e-12)


@settings(max_examples=60, deadline=None)
@given(seeds)
def test_reach_holds_every_disturbance_and_is_nearly_reached(seed):
    rng = np.random.default_rng(seed)
    x, u = rng.uniform(-3, 3, 3), rng.uniform(-100, 100, 4)
    predicted = MODEL.step(x, u, PERIOD)
    reach = disturbance_reach(MAPPING, x[2], u, W_MAX, PERIOD)
    moved = np.abs(disturbed_successor(MODEL, x, u, CORNERS * W_MAX, PERIOD) - predicted).max(
        axis=0
    )
    assert np.all(moved <= reach + 1e-12)
    rate = velocity(MAPPING.still, u)[2]
    if abs(rate) < 1.0:
        assert np.all(moved >= 0.9 * reach)


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_successor_of_every_error_under_every_disturbance_is_in_the_tube(seed):
    rng = np.random.default_rng(seed)
    nominal = draw_plan(rng)
    for corner in CORNERS:
        x = nominal[0] + HALF_WIDTH * corner * rng.choice([1.0, rng.uniform()])
        u = law(nominal, x)
        half_width = propagate(nominal, x, u)
        ends = disturbed_successor(MODEL, x, u, CORNERS * W_MAX, PERIOD)
        assert np.all(np.abs(ends - nominal[2]) <= half_width + 1e-12)


@settings(max_examples=30, deadline=None)
@given(seeds)
def test_it_holds_whatever_is_applied(seed):
    """Saturated, rounded, with a deadband or at random: the input counts, not the law."""
    rng = np.random.default_rng(seed)
    nominal = draw_plan(rng)
    x = nominal[0] + HALF_WIDTH * rng.uniform(-1, 1, 3)
    for u in (rng.uniform(-100, 100, 4), np.rint(law(nominal, x)), np.zeros(4)):
        half_width = propagate(nominal, x, u)
        ends = disturbed_successor(MODEL, x, u, CORNERS * W_MAX, PERIOD)
        assert np.all(np.abs(ends - nominal[2]) <= half_width + 1e-12)


@settings(max_examples=30, deadline=None)
@given(seeds)
def test_it_holds_where_the_measurement_is_missing(seed):
    rng = np.random.default_rng(seed)
    nominal = draw_plan(rng)
    for u in (nominal[1], np.rint(nominal[1]), rng.uniform(-50, 50, 4)):
        half_width = propagate(nominal, np.full(3, np.nan), u)
        for corner in CORNERS:
            x = nominal[0] + HALF_WIDTH * corner
            ends = disturbed_successor(MODEL, x, u, CORNERS * W_MAX, PERIOD)
            assert np.all(np.abs(ends - nominal[2]) <= half_width + 1e-12)


def test_error_is_exactly_linear_where_the_law_reaches_what_it_asks_for():
    rng = np.random.default_rng(0)
    for _ in range(20):
        nominal = draw_plan(rng)
        x = nominal[0] + HALF_WIDTH * rng.uniform(-1, 1, 3)
        u = law(nominal, x)
        left = MODEL.step(x, u, PERIOD) - nominal[2]
        np.testing.assert_allclose(left, 0.1 * (x - nominal[0]), rtol=0, atol=1e-12)
        expected = 0.1 * HALF_WIDTH + disturbance_reach(MAPPING, x[2], u, W_MAX, PERIOD)
        np.testing.assert_allclose(propagate(nominal, x, u), expected, rtol=0, atol=1e-12)


def test_what_the_law_falls_short_of_widens_the_tube():
    nominal = draw_plan(np.random.default_rng(1))
    x = nominal[0] + HALF_WIDTH
    u = law(nominal, x) + np.eye(4)[1]
    missed = np.abs(MODEL.step(x, u, PERIOD) - nominal[2] - 0.1 * HALF_WIDTH)
    expected = 0.1 * HALF_WIDTH + missed + disturbance_reach(MAPPING, x[2], u, W_MAX, PERIOD)
    np.testing.assert_allclose(propagate(nominal, x, u), expected, rtol=0, atol=1e-12)
    assert missed.max() > 1e-4


def test_without_disturbance_the_tube_shrinks_to_nothing_on_a_straight_line():
    nominal = np.zeros(3), np.zeros(3)
    half_width = HALF_WIDTH
    for _ in range(3):
        half_width = propagate_inversion_tube(
            MODEL, MAPPING, nominal, np.zeros(3), np.zeros(4), half_width, 0 * W_MAX, 9.0, 0.1
        )
    np.testing.assert_allclose(half_width, 1e-3 * HALF_WIDTH)


def test_whole_turns_of_yaw_do_not_count():
    nominal = draw_plan(np.random.default_rng(2))
    x = nominal[0] + 0.5 * HALF_WIDTH
    u = law(nominal, x)
    turned = x + np.array([0.0, 0.0, 4 * np.pi])
    np.testing.assert_allclose(propagate(nominal, turned, u), propagate(nominal, x, u), atol=1e-12)


def plan_at(yaw, ubar) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    xhat = np.array([0.3, -0.2, yaw])
    return xhat, ubar, MODEL.step(xhat, ubar, PERIOD)


def room_at(yaw, ubar, half_width=HALF_WIDTH, limit=100.0) -> np.ndarray:
    return required_room(MAPPING, yaw, ubar, half_width, FEEDBACK, PERIOD, limit)


def test_room_by_hand():
    # Nothing turns and nothing multiplies: k d over the gain of each wheel.
    mapping = turning_map(make_model())
    room = required_room(mapping, 0.3, np.full(4, 7.0), HALF_WIDTH, FEEDBACK, PERIOD, 100.0)
    np.testing.assert_allclose(room, [4.5, 3.6, 9.0, 0.0], rtol=1e-5)


def test_room_of_a_product_by_hand():
    # Yaw rate 0.01 u3 + 1e-4 u1^2. Moves of wheel 1 by 4.5 add up to 0.002 to a yaw rate of 0.09
    # that is asked for, so wheel 3 moves by up to 9.2, which turns the other way when it must.
    mapping = turning_map(make_model(theta={"u3": 0.01, "u1*u1": 1e-4}))
    room = required_room(mapping, 0.0, np.zeros(4), HALF_WIDTH, FEEDBACK, PERIOD, 100.0)
    assert room[0] == pytest.approx(4.5, rel=1e-5)
    assert 9.0 + 100 * 1e-4 * 4.5**2 == pytest.approx(room[2], rel=0.03)


def test_no_error_needs_no_room():
    np.testing.assert_array_equal(room_at(0.3, np.full(4, 20.0), np.zeros(3)), np.zeros(4))


# The examples need moves along the null space that smaller changes of velocity do not lead to.
@settings(max_examples=40, deadline=None)
@given(seeds)
@example(24)
@example(299)
@example(670)
@example(2560)
def test_within_the_room_the_law_gets_what_it_asks_for(seed):
    rng = np.random.default_rng(seed)
    yaw, ubar = rng.uniform(-np.pi, np.pi), rng.uniform(-45, 45, 4)
    half_width = HALF_WIDTH * rng.uniform(0.2, 1.3, 3)
    room = room_at(yaw, ubar, half_width)
    assert np.all(np.isfinite(room))
    nominal = plan_at(yaw, ubar)
    for share in (*CORNERS, *rng.uniform(-1, 1, (12, 3))):
        found = ask(nominal, nominal[0] + half_width * share, ubar - room, ubar + room)
        assert found.fraction == 1.0


def test_room_is_not_much_more_than_is_needed():
    """Against the largest move of any wheel, searched at the corners of the tube."""
    rng = np.random.default_rng(3)
    for _ in range(15):
        yaw, ubar = rng.uniform(-np.pi, np.pi), rng.uniform(-25, 25, 4)
        room = room_at(yaw, ubar).max()

        nominal = plan_at(yaw, ubar)

        def reached(move, nominal=nominal, ubar=ubar) -> bool:
            return all(
                ask(nominal, nominal[0] + error, ubar - move, ubar + move).fraction == 1.0
                for error in HALF_WIDTH * CORNERS
            )

        assert reached(room)
        assert not reached(0.85 * room)


def test_room_is_no_more_than_the_pseudo_inverse_takes():
    rng, less = np.random.default_rng(4), 0
    for _ in range(30):
        yaw, ubar = rng.uniform(-np.pi, np.pi), rng.uniform(-20, 20, 4)
        C = np.linalg.pinv(jacobian(MAPPING.at(yaw), ubar))
        plain = (np.abs(C) @ (FEEDBACK * HALF_WIDTH)).max()
        less += room_at(yaw, ubar).max() < plain
    assert less > 10


def test_room_that_cannot_be_shown_is_infinite():
    ubar = np.full(4, 10.0)
    needed = room_at(0.3, ubar).max()
    assert np.all(np.isfinite(room_at(0.3, ubar, limit=1.01 * needed)))
    assert np.all(np.isinf(room_at(0.3, ubar, limit=0.99 * needed)))
    assert np.all(np.isinf(room_at(0.3, ubar, 100 * HALF_WIDTH)))


def test_products_of_inputs_that_move_the_position_are_refused():
    check_linear_position(MAPPING, "extended_kinematic")
    mapping = turning_map(make_model(x={"u1": 0.01, "u2*u2": 1e-5}))
    with pytest.raises(ValueError, match="by hand: products of inputs"):
        check_linear_position(mapping, "by hand")


def test_error_of_the_helper_is_that_of_the_robot():
    """The fine integration agrees with the model where nothing disturbs."""
    rng = np.random.default_rng(5)
    x, u = rng.normal(size=3), rng.uniform(-50, 50, 4)
    (end,) = disturbed_successor(MODEL, x, u, np.zeros((1, 3)), PERIOD)
    np.testing.assert_allclose(pose_error(end, MODEL.step(x, u, PERIOD)), 0.0, atol=1e-7)
