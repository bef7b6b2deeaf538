import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mirte_drake.angles import rotation
from mirte_drake.control.dlqr import DlqrDesign
from mirte_drake.control.tube import (
    horizon_half_widths,
    propagate_tube,
    rotated_bound,
    tighten,
)

CLOSED_LOOP = np.array([[0.5, -0.1, 0.0], [0.0, 0.4, 0.0], [0.0, 0.2, -0.3]])
DISTURBANCE = np.array([0.004, 0.003, 0.009])
LIMIT = np.full(4, 100.0)


def test_recursion_by_hand():
    actual = propagate_tube(np.array([0.1, 0.2, 0.3]), CLOSED_LOOP, DISTURBANCE)
    np.testing.assert_allclose(actual, [0.05 + 0.02 + 0.004, 0.08 + 0.003, 0.04 + 0.09 + 0.009])


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_successor_of_every_error_in_the_tube_is_in_the_next(seed):
    rng = np.random.default_rng(seed)
    closed_loop, half_width = rng.normal(size=(3, 3)), rng.uniform(0, 1, 3)
    error = half_width * rng.uniform(-1, 1, 3)
    successor = closed_loop @ error + DISTURBANCE * rng.uniform(-1, 1, 3)
    assert np.all(np.abs(successor) <= propagate_tube(half_width, closed_loop, DISTURBANCE))


def test_recursion_is_tight():
    half_width = np.array([0.1, 0.2, 0.3])
    successors = [
        CLOSED_LOOP @ (half_width * e) + DISTURBANCE * w
        for e in itertools.product((-1, 1), repeat=3)
        for w in itertools.product((-1, 1), repeat=3)
    ]
    expected = propagate_tube(half_width, CLOSED_LOOP, DISTURBANCE)
    np.testing.assert_allclose(np.max(np.abs(successors), axis=0), expected)


def test_recursion_settles_at_its_fixed_point():
    fixed_point = np.linalg.solve(np.eye(3) - np.abs(CLOSED_LOOP), DISTURBANCE)
    np.testing.assert_allclose(propagate_tube(fixed_point, CLOSED_LOOP, DISTURBANCE), fixed_point)
    half_width = np.zeros(3)
    for _ in range(60):
        half_width = propagate_tube(half_width, CLOSED_LOOP, DISTURBANCE)
    np.testing.assert_allclose(half_width, fixed_point, rtol=1e-12)


def test_horizon_equals_repeated_propagation():
    designs = [DlqrDesign(0.0, np.zeros((4, 3)), scale * CLOSED_LOOP) for scale in (1.0, 0.5, -2.0)]
    disturbances = np.outer([1.0, 2.0, 3.0], DISTURBANCE)
    widths = horizon_half_widths(np.array([0.1, 0.2, 0.3]), designs, disturbances)
    assert widths.shape == (4, 3)
    np.testing.assert_array_equal(widths[0], [0.1, 0.2, 0.3])
    for k in range(3):
        expected = propagate_tube(widths[k], designs[k].closed_loop, disturbances[k])
        np.testing.assert_array_equal(widths[k + 1], expected)


def test_horizon_needs_a_disturbance_for_each_stage():
    design = DlqrDesign(0.0, np.zeros((4, 3)), CLOSED_LOOP)
    with pytest.raises(ValueError, match="zip"):
        horizon_half_widths(np.zeros(3), [design, design], DISTURBANCE[None])


def test_tightening_by_hand():
    gain = np.array([[100.0, -50.0, 0.0], [0.0, 0.0, 10.0], [0.0, 0.0, 0.0], [-1.0, -1.0, -1.0]])
    lower, upper = tighten(-LIMIT, LIMIT, gain, np.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(lower, [-80.0, -97.0, -100.0, -99.4])
    np.testing.assert_allclose(upper, [80.0, 97.0, 100.0, 99.4])


def test_bounds_meet_in_the_middle_when_there_is_no_room():
    gain = np.diag([1.0, 1.0, 1.0, 0.0])[:, :3]
    bottom, top = np.array([-100.0, -100.0, 0.0, -1.0]), np.array([100.0, 100.0, 40.0, 1.0])
    lower, upper = tighten(bottom, top, gain, np.array([99.0, 101.0, 21.0]))
    np.testing.assert_allclose(lower, [-1.0, 0.0, 20.0, -1.0])
    np.testing.assert_allclose(upper, [1.0, 0.0, 20.0, 1.0])


@settings(max_examples=50)
@given(st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3), st.floats(-10.0, 10.0))
def test_rotated_bound_contains_the_turned_box_and_touches_it(bound, yaw):
    corners = [np.multiply(signs, bound) for signs in itertools.product((-1, 1), repeat=3)]
    turned = np.abs([rotation(yaw) @ corner for corner in corners])
    box = rotated_bound(np.array(bound), yaw)
    assert np.all(turned <= box + 1e-12)
    np.testing.assert_allclose(np.max(turned, axis=0), box, atol=1e-12)


def test_quarter_turn_swaps_the_sides():
    actual = rotated_bound(np.array([0.04, 0.03, 0.09]), np.pi / 2)
    np.testing.assert_allclose(actual, [0.03, 0.04, 0.09])
