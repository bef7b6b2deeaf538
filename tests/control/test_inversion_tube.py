import itertools

import numpy as np
import pytest
from disturbed_robot import disturbed_successor
from hypothesis import given, settings
from hypothesis import strategies as st

from mirte_drake.angles import pose_error
from mirte_drake.control.input_inversion import invert, jacobian, velocity
from mirte_drake.control.inversion_tube import (
    check_linear_position,
    disturbance_reach,
    propagate_inversion_tube,
    required_room,
    swept_bound,
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


def law(nominal, x) -> np.ndarray:
    xhat, ubar, _ = nominal
    wanted = velocity(MAPPING.at(xhat[2]), ubar) - FEEDBACK * (x - xhat)
    found = invert(MAPPING.at(x[2]), wanted, ubar, -LIMIT, LIMIT)
    assert found.fraction == 1.0
    return found.input


def propagate(nominal, x, u, half_width=HALF_WIDTH) -> np.ndarray:
    return propagate_inversion_tube(
        MODEL, MAPPING, nominal, x, u, half_width, W_MAX, FEEDBACK, PERIOD
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
    swept = PERIOD * swept_bound(W_MAX, 0.6, 0.1 + 0.009)
    expected = 0.5 * PERIOD**2 * 0.09 * 0.2 + PERIOD**5 / 2880 * 2.0**4 * 0.2
    np.testing.assert_allclose(reach[:2] - swept[:2], expected, rtol=1e-9)
    assert reach[2] == swept[2]


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
    half_width = propagate(nominal, np.full(3, np.nan), nominal[1])
    for corner in CORNERS:
        x = nominal[0] + HALF_WIDTH * corner
        ends = disturbed_successor(MODEL, x, nominal[1], CORNERS * W_MAX, PERIOD)
        assert np.all(np.abs(ends - nominal[2]) <= half_width + 1e-12)


def test_yaw_is_exactly_linear():
    rng = np.random.default_rng(0)
    for _ in range(20):
        nominal = draw_plan(rng)
        x = nominal[0] + HALF_WIDTH * rng.uniform(-1, 1, 3)
        expected = 0.1 * HALF_WIDTH[2] + 0.009
        assert propagate(nominal, x, law(nominal, x))[2] == pytest.approx(expected, abs=1e-12)


def test_what_remains_of_the_law_is_small():
    """The turn of the velocity within a sample, at the inputs that the studies come to."""
    rng, worst = np.random.default_rng(1), np.zeros(3)
    for _ in range(200):
        nominal = draw_plan(rng, reach=25.0)
        x = nominal[0] + HALF_WIDTH * rng.choice([-1.0, 1.0], 3)
        remainder = propagate(nominal, x, law(nominal, x)) - (
            0.1 * HALF_WIDTH + disturbance_reach(MAPPING, x[2], law(nominal, x), W_MAX, PERIOD)
        )
        worst = np.maximum(worst, remainder)
    assert np.all(worst[:2] < 5e-4) and np.all(worst[:2] > 1e-5)


def test_without_disturbance_the_tube_shrinks_to_nothing_on_a_straight_line():
    nominal = np.zeros(3), np.zeros(4), np.zeros(3)
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


def room_at(yaw, ubar, half_width=HALF_WIDTH, limit=100.0) -> np.ndarray:
    return required_room(MAPPING, yaw, ubar, half_width, FEEDBACK, limit)


def test_room_by_hand():
    # Nothing turns and nothing multiplies: k d over the gain of each wheel.
    mapping = turning_map(make_model())
    room = required_room(mapping, 0.3, np.full(4, 7.0), HALF_WIDTH, FEEDBACK, 100.0)
    np.testing.assert_allclose(room, [4.5, 3.6, 9.0, 0.0], rtol=1e-5)


def test_room_of_a_product_by_hand():
    # Yaw rate 0.01 u3 + 1e-4 u1^2. Moves of wheel 1 by 4.5 add up to 0.002 to a yaw rate of 0.09
    # that is asked for, so wheel 3 moves by up to 9.2, which turns the other way when it must.
    mapping = turning_map(make_model(theta={"u3": 0.01, "u1*u1": 1e-4}))
    room = required_room(mapping, 0.0, np.zeros(4), HALF_WIDTH, FEEDBACK, 100.0)
    assert room[0] == pytest.approx(4.5, rel=1e-5)
    assert 9.0 + 100 * 1e-4 * 4.5**2 == pytest.approx(room[2], rel=0.03)


def test_no_error_needs_no_room():
    np.testing.assert_array_equal(room_at(0.3, np.full(4, 20.0), np.zeros(3)), np.zeros(4))


@settings(max_examples=40, deadline=None)
@given(seeds)
def test_within_the_room_the_law_gets_what_it_asks_for(seed):
    rng = np.random.default_rng(seed)
    yaw, ubar = rng.uniform(-np.pi, np.pi), rng.uniform(-45, 45, 4)
    half_width = HALF_WIDTH * rng.uniform(0.2, 1.3, 3)
    room = room_at(yaw, ubar, half_width)
    assert np.all(np.isfinite(room))
    for share in (*CORNERS, *rng.uniform(-1, 1, (12, 3))):
        error = half_width * share
        wanted = velocity(MAPPING.at(yaw), ubar) - FEEDBACK * error
        found = invert(MAPPING.at(yaw + error[2]), wanted, ubar, ubar - room, ubar + room)
        assert found.fraction == 1.0


def test_room_is_not_much_more_than_is_needed():
    """Against the largest move of any wheel, searched at the corners of the tube."""
    rng = np.random.default_rng(3)
    for _ in range(15):
        yaw, ubar = rng.uniform(-np.pi, np.pi), rng.uniform(-25, 25, 4)
        room = room_at(yaw, ubar).max()

        def reached(move, yaw=yaw, ubar=ubar) -> bool:
            return all(
                invert(
                    MAPPING.at(yaw + error[2]),
                    velocity(MAPPING.at(yaw), ubar) - FEEDBACK * error,
                    ubar,
                    ubar - move,
                    ubar + move,
                ).fraction
                == 1.0
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
