import itertools

import numpy as np
import pytest
from scipy.optimize import minimize

from mirte_drake.control.input_inversion import (
    InputMap,
    input_map,
    invert,
    jacobian,
    null_vector,
    velocity,
)
from mirte_drake.model.model_file import load_model
from mirte_drake.model.sparse_model import SparseModel

MODEL = load_model("extended_kinematic")
LIMIT = np.full(4, 100.0)
DISTURBANCE = np.array([0.05, 0.05, 0.09])  # [m/s, m/s, rad/s] The study's, in any direction.


def map_at(yaw: float) -> InputMap:
    return input_map(MODEL, np.array([0.3, -0.2, yaw]))


def cases(seed: int, count: int, reach: float, near: float):
    """Maps, inputs within +-near, and changes of velocity within reach * DISTURBANCE."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield (
            map_at(rng.uniform(-np.pi, np.pi)),
            rng.uniform(-near, near, 4),
            reach * DISTURBANCE * rng.uniform(-1, 1, 3),
        )


@pytest.mark.parametrize("name", ["kinematic", "extended_kinematic"])
def test_map_is_the_model(name):
    model, rng = load_model(name), np.random.default_rng(0)
    for _ in range(20):
        state, u = rng.normal(size=3), rng.uniform(-100, 100, 4)
        mapping = input_map(model, state)
        f, _, B = model.linearise(state, u)
        np.testing.assert_allclose(velocity(mapping, u), f, rtol=0, atol=1e-13)
        np.testing.assert_allclose(jacobian(mapping, u), B, rtol=0, atol=1e-15)


def test_jacobian_is_that_of_finite_differences():
    for mapping, u, _ in cases(1, 10, 0.0, 100.0):
        h = 1e-3 * np.eye(4)
        numerical = [(velocity(mapping, u + s) - velocity(mapping, u - s)) / 2e-3 for s in h]
        np.testing.assert_allclose(jacobian(mapping, u), np.transpose(numerical), atol=1e-11)


def test_null_vector_by_hand():
    J = np.array([[1.0, 0.0, 0.0, -1.0], [0.0, 1.0, 0.0, 2.0], [0.0, 0.0, 1.0, 0.0]])
    expected = np.array([1.0, -2.0, 0.0, 1.0]) / np.sqrt(6)
    n = null_vector(J)
    np.testing.assert_allclose(n * np.sign(n[0]), expected)


def test_null_vector_is_that_of_the_singular_value_decomposition():
    rng = np.random.default_rng(2)
    for J in rng.normal(size=(20, 3, 4)):
        n, svd = null_vector(J), np.linalg.svd(J)[2][-1]
        np.testing.assert_allclose(n * np.sign(n[0]), svd * np.sign(svd[0]), atol=1e-12)


def test_linear_map_is_inverted_by_the_pseudo_inverse():
    rng = np.random.default_rng(3)
    linear, near, target = rng.normal(size=(3, 4)), rng.normal(size=4), rng.normal(size=3)
    mapping = InputMap(np.array([1.0, 2.0, 3.0]), linear, np.zeros((3, 4, 4)))
    expected = near + np.linalg.pinv(linear) @ (target - velocity(mapping, near))
    found = invert(mapping, target, near, -LIMIT, LIMIT)
    assert found.fraction == 1.0
    np.testing.assert_allclose(found.input, expected)


def test_quadratic_map_by_hand():
    # v = (u1, u2, u3 + u3^2 / 8 + u4): from rest the third input and the fourth move alike.
    linear, quadratic = np.eye(3, 4), np.zeros((3, 4, 4))
    linear[2, 3], quadratic[2, 2, 2] = 1.0, 0.125
    found = invert(
        InputMap(np.zeros(3), linear, quadratic), np.array([1, 2, 10.0]), np.zeros(4), -LIMIT, LIMIT
    )
    # u3 = u4 = s with 2 s + s^2 / 8 = 10.
    s = -8.0 + np.sqrt(64.0 + 80.0)
    np.testing.assert_allclose(found.input, [1.0, 2.0, s, s])


def test_corrections_of_the_size_of_the_disturbance_are_found_near_every_input():
    for mapping, near, change in cases(4, 2000, 1.0, 45.0):
        target = velocity(mapping, near) + change
        u, fraction = invert(mapping, target, near, -LIMIT, LIMIT)
        assert fraction == 1.0
        assert np.all(np.abs(u) <= LIMIT)
        np.testing.assert_allclose(velocity(mapping, u), target, rtol=0, atol=1e-12)
        # Along the rows of the Jacobian: nothing is spent in the null space.
        if np.all(np.abs(u) < LIMIT):
            assert abs(null_vector(jacobian(mapping, near)) @ (u - near)) < 1e-9


def test_the_null_space_is_used_only_as_far_as_limits_ask():
    moved = 0
    for mapping, near, change in cases(5, 1000, 1.5, 90.0):
        target = velocity(mapping, near) + change
        wide, _ = invert(mapping, target, near, -10 * LIMIT, 10 * LIMIT)
        u, fraction = invert(mapping, target, near, -LIMIT, LIMIT)
        if np.all(np.abs(wide) <= LIMIT):
            np.testing.assert_allclose(u, wide, rtol=0, atol=1e-9)
        elif fraction == 1.0:
            assert np.any(np.abs(u) >= LIMIT[0] - 1e-9)
            np.testing.assert_allclose(velocity(mapping, u), target, rtol=0, atol=1e-12)
            moved += 1
    assert moved >= 10


def test_agrees_with_a_general_solver_on_the_same_equations():
    for mapping, near, change in cases(6, 15, 2.0, 40.0):
        target = velocity(mapping, near) + change
        n = null_vector(jacobian(mapping, near))
        constraints = [
            {"type": "eq", "fun": lambda u, m=mapping, t=target: 1e2 * (velocity(m, u) - t)},
            {"type": "ineq", "fun": lambda u: 100.0 - u},
            {"type": "ineq", "fun": lambda u: 100.0 + u},
        ]
        solved = minimize(
            lambda u, n=n, near=near: (n @ (u - near)) ** 2,
            near,
            constraints=constraints,
            method="SLSQP",
            options={"ftol": 1e-16, "maxiter": 200},
        )
        u, fraction = invert(mapping, target, near, -LIMIT, LIMIT)
        assert fraction == 1.0
        np.testing.assert_allclose(u, solved.x, rtol=0, atol=1e-3)


def test_what_is_beyond_the_limits_is_given_in_its_direction():
    short = 0
    for mapping, near, change in cases(7, 200, 10.0, 60.0):
        start = velocity(mapping, near)
        u, fraction = invert(mapping, start + change, near, -LIMIT, LIMIT)
        assert np.all(np.abs(u) <= LIMIT)
        np.testing.assert_allclose(velocity(mapping, u), start + fraction * change, atol=1e-9)
        short += fraction < 1.0
    assert 100 < short < 200


def largest_fraction(mapping, start, change, guess) -> float:
    solved = minimize(
        lambda z: -z[4],
        guess,
        constraints={
            "type": "eq",
            "fun": lambda z: 1e2 * (velocity(mapping, z[:4]) - start - z[4] * change),
        },
        bounds=[(-100, 100)] * 4 + [(0, 1)],
        method="SLSQP",
        options={"ftol": 1e-12, "maxiter": 500},
    )
    return solved.x[4]


def test_what_is_given_is_nearly_always_the_most_that_a_general_solver_finds():
    less = 0
    for mapping, near, change in cases(8, 60, 20.0, 60.0):
        start = velocity(mapping, near)
        u, fraction = invert(mapping, start + change, near, -LIMIT, LIMIT)
        most = largest_fraction(mapping, start, change, [*u, fraction])
        assert fraction <= most + 1e-6
        less += fraction < most - 1e-4
    assert less <= 4  # Where more of it is found, a smaller change on the way is out of reach.


@pytest.mark.parametrize(("near", "reach"), [(0.0, 2.5), (20.0, 2.0), (40.0, 1.25)])
def test_reach_in_every_direction_shrinks_with_the_given_input(near, reach):
    """In multiples of the study's disturbance; near 70 pwm it falls below one."""
    for mapping, given, _ in cases(9, 25, 0.0, near):
        for signs in itertools.product((-1, 1), repeat=3):
            target = velocity(mapping, given) + reach * DISTURBANCE * signs
            assert invert(mapping, target, given, -LIMIT, LIMIT).fraction == 1.0


def test_a_given_input_beyond_the_limits_is_taken_into_them():
    mapping, near = map_at(0.0), np.array([120.0, 0.0, 0.0, 0.0])
    inside = np.array([100.0, 0.0, 0.0, 0.0])
    found = invert(mapping, velocity(mapping, inside), near, -LIMIT, LIMIT)
    np.testing.assert_allclose(found.input, inside)
    assert found.fraction == 1.0


def test_dependent_velocities_are_out_of_reach():
    linear = np.array([[1.0, 2.0, 3.0, 4.0], [2.0, 4.0, 6.0, 8.0], [0.0, 1.0, 0.0, 0.0]])
    mapping = InputMap(np.zeros(3), linear, np.zeros((3, 4, 4)))
    u, fraction = invert(mapping, np.ones(3), np.full(4, 5.0), -LIMIT, LIMIT)
    assert fraction == 0.0
    np.testing.assert_array_equal(u, np.full(4, 5.0))


@pytest.mark.parametrize(
    ("inputs", "yaw_rate", "message"),
    [(4, {"u1*u2*u3": 1e-6}, "at most two inputs"), (3, {"u3": 0.01}, "must have 4 inputs")],
)
def test_models_that_are_no_such_map_are_refused(inputs, yaw_rate, message):
    names = [f"u{i + 1}" for i in range(inputs)]
    tables = {"x": {"u1": 0.01}, "y": {"u2": 0.01}, "theta": yaw_rate}
    model = SparseModel("by hand", ["x", "y", "theta"], names, tables)
    with pytest.raises(ValueError, match=message):
        input_map(model, np.zeros(3))
