import numpy as np
import pytest

from mirte_drake.angles import rotation
from mirte_drake.control.lagged_axis import axis_model, feedback_gains, observer_gains
from mirte_drake.control.lagged_tube import (
    EllipsoidTube,
    ModeTube,
    box_of_state,
    input_room,
    lagged_loop,
)

T, LAG = 0.1, np.array([0.3, 0.16, 0.15])
K = feedback_gains(LAG, T, np.full(3, 16.0), np.full(3, 3.0), np.ones(3))
L = observer_gains(LAG, T, np.full(3, 0.001), np.tile([0.0003, 0.01, 0.005], (3, 1)))
BOUND, MISSED = np.array([0.004, 0.003, 0.01]), np.array([0.002, 0.001, 0.01])
LOOP = lagged_loop(LAG, T, K, L, 0)
# Poles that swing: a law of position alone.
SWINGING = lagged_loop(LAG, T, np.column_stack([np.full(3, 5.0), np.zeros(3)]), L, 0)


def advance(loop, errors, w, q, turn):
    """The errors (runs, 3, 2) a sample later, as the module says."""
    errors = np.einsum("aij,raj->rai", loop.closed_loop, errors)
    errors += w[..., None] * loop.entry + q[..., None] * loop.command
    return np.einsum("ab,rbi->rai", rotation(-turn), errors)


def extremes(loop, tube, turns, seed=0):
    """Errors of runs with innovations at their bounds, and the tube's state."""
    rng = np.random.default_rng(seed)
    errors, state = np.zeros((400, 3, 2)), tube.start()
    for turn in turns:
        w, q = (bound * rng.choice([-1.0, 1.0], (400, 3)) for bound in (BOUND, MISSED))
        w[:40], q[:40] = BOUND, MISSED  # Always the same way.
        errors, state = advance(loop, errors, w, q, turn), tube.advance(state, turn, BOUND)
        yield errors, state


@pytest.mark.parametrize("loop", [LOOP, SWINGING], ids=["lqr", "swinging"])
@pytest.mark.parametrize("turn", [0.0, 0.05])
def test_no_bounded_innovation_leaves_the_tube_of_modes(loop, turn):
    tube = ModeTube(loop, MISSED)
    inverse = np.linalg.inv(loop.modes[1])
    for errors, widths in extremes(loop, tube, [turn] * 60):
        moduli = np.abs(np.einsum("aij,raj->rai", inverse, errors))
        assert np.all(moduli <= widths + 1e-12)
        assert np.all(np.abs(errors) <= tube.components(widths) + 1e-12)
        added = np.abs(np.sum(K * errors, axis=-1))
        assert np.all(added <= tube.support(widths, K) + 1e-12)


def test_tube_of_modes_settles_and_is_no_larger_than_it_must_be():
    tube = ModeTube(LOOP, MISSED)
    *_, (errors, widths) = extremes(LOOP, tube, [0.0] * 200)
    moduli, vectors = LOOP.modes
    push = sum(
        np.abs(np.einsum("aij,aj->ai", np.linalg.inv(vectors), entry)) * bound[:, None]
        for entry, bound in ((LOOP.entry, BOUND), (LOOP.command, MISSED))
    )
    np.testing.assert_allclose(widths, push / (1 - moduli), rtol=1e-6)
    # The room for the inputs is what the worst sequence of innovations takes, no more.
    worst = np.zeros(3)
    for e in (LOOP.entry * BOUND[:, None], LOOP.command * MISSED[:, None]):
        for _ in range(200):
            worst += np.abs(np.sum(K * e, axis=1))
            e = np.einsum("aij,aj->ai", LOOP.closed_loop, e)
    np.testing.assert_allclose(tube.support(widths, K), worst, rtol=1e-6)
    assert np.all(np.abs(errors) <= tube.components(widths))


def test_box_of_modes_would_grow_in_position_and_velocity():
    """The point of the coordinates: (4-19) as published takes |A - B K| of the state."""
    published = np.max(np.abs(np.linalg.eigvals(np.abs(SWINGING.closed_loop[0]))))
    assert published > 1.0 > np.max(SWINGING.modes[0])


def test_ellipsoid_is_the_covariance_of_independent_innovations():
    tube = EllipsoidTube(LOOP, MISSED, 2.0)
    P = tube.start()
    errors, rng = np.zeros((20000, 3, 2)), np.random.default_rng(1)
    for _ in range(30):
        w, q = (bound * rng.choice([-1.0, 1.0], (20000, 3)) for bound in (BOUND, MISSED))
        errors = advance(LOOP, errors, w, q, 0.05)
        P = tube.advance(P, 0.05, BOUND)
    np.testing.assert_allclose(P, np.cov(errors.reshape(-1, 6).T), atol=0.03 * np.max(P))
    np.testing.assert_allclose(
        tube.support(P, K), 2.0 * np.std(np.sum(K * errors, axis=-1), axis=0), rtol=0.05
    )


@pytest.mark.parametrize("make", [ModeTube, lambda *a: EllipsoidTube(*a, 2.0)])
def test_boxes_lie_within_the_tube(make):
    tube = make(LOOP, MISSED)
    state = tube.start()
    np.testing.assert_array_equal(tube.box(state), np.zeros((3, 2)))
    for _ in range(10):
        state = tube.advance(state, 0.02, BOUND)
    box = tube.box(state)
    assert np.all(box > 0) and np.all(box <= tube.components(state))
    for signs in ((1, 1), (1, -1)):
        corner = box * signs
        if isinstance(tube, ModeTube):
            moduli = np.abs(np.einsum("aij,aj->ai", np.linalg.inv(LOOP.modes[1]), corner))
            assert np.all(moduli <= state * (1 + 1e-9))
        else:
            for axis in range(3):
                block = state[2 * axis : 2 * axis + 2, 2 * axis : 2 * axis + 2]
                assert corner[axis] @ np.linalg.solve(block, corner[axis]) <= 4.0 * (1 + 1e-9)


def test_delay_widens_what_the_innovation_does():
    late = lagged_loop(LAG, T, K, L, 2)
    np.testing.assert_array_equal(late.closed_loop, LOOP.closed_loop)
    assert np.all(late.entry[:, 0] > 1.2 * LOOP.entry[:, 0])
    A, _ = axis_model(LAG[0], T)
    np.testing.assert_allclose(LOOP.entry[0], L[0, :2])
    np.testing.assert_allclose(LOOP.closed_loop[0], A - axis_model(LAG[0], T)[1] @ K[:1])


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, 0.6, -2.0])
def test_box_of_the_state_fits_into_the_turned_box(yaw):
    box = np.array([[0.01, 0.1], [0.004, 0.2], [0.02, 0.3]])
    half_width = box_of_state(box, yaw)
    np.testing.assert_array_equal(half_width[3:], box[:, 1])
    corners = half_width[:3] * np.array([[1, 1, 1], [1, -1, 1], [-1, 1, -1]])
    assert np.all(np.abs(corners @ rotation(yaw)) <= box[:, 0] * (1 + 1e-9))
    if yaw in (0.0, np.pi / 2):
        expected = box[:, 0] if yaw == 0 else box[[1, 0, 2], 0]
        np.testing.assert_allclose(half_width[:3], expected)


def test_input_room_by_hand():
    tube = ModeTube(LOOP, MISSED)
    widths = tube.advance(tube.start(), 0.0, BOUND)
    added, yaw = tube.support(widths, K), tube.components(widths)[2, 0]
    inverse = np.array([[1.0, -2, 3], [4, 5, -6], [7, 8, 9], [0, 1, 0]])
    room = input_room(tube, widths, K, np.array([0.3, -0.1, 5.0]), inverse)
    expected = np.abs(inverse) @ (added + np.array([yaw * 0.1, yaw * 0.3, 0.0]))
    np.testing.assert_allclose(room, expected)
