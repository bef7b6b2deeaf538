import dataclasses as dc

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from mirte_drake.control.dlqr import (
    check_stabilisable,
    design_dlqr,
    discretise_euler,
    solve_dlqr,
    steady_input,
    straight_line_terminal_weight,
)
from mirte_drake.model.model_file import load_model
from mirte_drake.model.sparse_model import SparseModel

Q, R = 1000 * np.eye(3), 0.001 * np.eye(4)


def riccati_residual(A, B, Q, R, P) -> np.ndarray:
    S = R + B.T @ P @ B
    return A.T @ P @ A - P - A.T @ P @ B @ np.linalg.solve(S, B.T @ P @ A) + Q


def random_pair(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(3, 3)), rng.normal(size=(3, 2))


def test_euler_by_hand():
    A, B = np.array([[0.0, 1.0], [-2.0, 0.0]]), np.array([[0.0], [3.0]])
    A_k, B_k = discretise_euler(A, B, 0.1)
    np.testing.assert_allclose(A_k, [[1.0, 0.1], [-0.2, 1.0]])
    np.testing.assert_allclose(B_k, [[0.0], [0.3]])


def test_scalar_by_hand():
    # p = 1 + p - p^2 / (1 + p): the golden ratio.
    K, P = solve_dlqr(*np.ones((4, 1, 1)))
    golden = (1 + np.sqrt(5)) / 2
    np.testing.assert_allclose(P, [[golden]])
    np.testing.assert_allclose(K, [[golden / (1 + golden)]])


@pytest.mark.parametrize("seed", range(5))
def test_solution_equals_scipys_and_stabilises(seed):
    A, B = random_pair(seed)
    weights = np.diag([1.0, 10.0, 0.1]), np.diag([1.0, 0.01])
    K, P = solve_dlqr(A, B, *weights)
    expected = solve_discrete_are(A, B, *weights)
    gain = np.linalg.solve(weights[1] + B.T @ expected @ B, B.T @ expected @ A)
    np.testing.assert_allclose(P, expected, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(K, gain, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(riccati_residual(A, B, *weights, P), 0, atol=1e-9 * np.max(P))
    assert np.max(np.abs(np.linalg.eigvals(A - B @ K))) < 1


@pytest.mark.parametrize("yaw", [0.0, 1.0, 20.0])
def test_design_at_an_operating_point_of_the_robot(model, yaw):
    x, u = np.array([0.3, -0.1, yaw]), np.array([40.0, 20.0, 50.0, 10.0])
    design = design_dlqr(model, x, u, 0.1, Q, R)
    _, A, B = model.linearise(x, u)
    A_k, B_k = np.eye(3) + 0.1 * A, 0.1 * B
    P = solve_discrete_are(A_k, B_k, Q, R)
    K = np.linalg.solve(R + B_k.T @ P @ B_k, B_k.T @ P @ A_k)
    assert design.yaw == yaw
    np.testing.assert_allclose(design.gain, K, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(design.closed_loop, A_k - B_k @ design.gain, atol=1e-14)
    assert np.max(np.abs(np.linalg.eigvals(design.closed_loop))) < 1


def test_design_is_frozen(model):
    design = design_dlqr(model, np.zeros(3), np.zeros(4), 0.1, Q, R)
    with pytest.raises(dc.FrozenInstanceError):
        design.yaw = 1.0


# Drake's solver ends the process on these, so a return at all shows that it was not asked.
@pytest.mark.parametrize(
    ("A", "B", "eigenvalue"),
    [
        (np.diag([1.25, 0.5]), [[0.0], [1.0]], "1.25"),
        (np.diag([1.0, 0.5]), [[0.0], [1.0]], "1"),
        ([[1.0, 1.0], [0.0, 1.0]], [[1.0], [0.0]], "1"),
        (np.diag([-2.0, 0.5]), np.zeros((2, 1)), "-2"),
        ([[0.0, 1.0], [-4.0, 0.0]], np.zeros((2, 1)), "2j"),
    ],
)
def test_mode_that_no_input_reaches_is_named(A, B, eigenvalue):
    with pytest.raises(ValueError, match="no input reaches") as caught:
        solve_dlqr(np.array(A), np.array(B), np.eye(2), np.eye(1))
    assert eigenvalue in str(caught.value).rpartition("eigenvalue")[2]


def test_stable_mode_needs_no_input():
    check_stabilisable(np.diag([0.9, 2.0]), np.array([[0.0], [1.0]]))
    K, _ = solve_dlqr(np.diag([0.9, 2.0]), np.array([[0.0], [1.0]]), np.eye(2), np.eye(1))
    assert abs(2.0 - K[0, 1]) < 1


@pytest.mark.parametrize("position", range(4))
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_matrix_that_is_not_finite(position, value):
    matrices = [np.eye(2) for _ in range(4)]
    matrices[position][0, 0] = value
    with pytest.raises(ValueError, match="not finite"):
        solve_dlqr(*matrices)


def test_operating_point_that_is_not_finite(model):
    with pytest.raises(ValueError, match="not finite"):
        design_dlqr(model, np.array([0, 0, np.nan]), np.zeros(4), 0.1, Q, R)


@pytest.mark.parametrize("name", ["kinematic", "extended_kinematic"])
@pytest.mark.parametrize("velocity", [[0.1, 0, 0], [0.0, 0.1, 0], [0.1, -0.05, 0.2], [0, 0, 0]])
def test_steady_input_drives_at_the_velocity(name, velocity):
    model = load_model(name)
    u = steady_input(model, np.array(velocity))
    np.testing.assert_allclose(model.derivative(np.zeros(3), u), velocity, atol=1e-11)


def test_steady_input_of_a_linear_model_is_the_smallest():
    model = load_model("kinematic")
    _, _, B = model.linearise(np.zeros(3), np.zeros(4))
    velocity = np.array([0.1, 0.05, -0.1])
    np.testing.assert_allclose(steady_input(model, velocity), np.linalg.pinv(B) @ velocity)


@pytest.mark.parametrize(
    ("name", "velocity"), [("dynamic", [0.1, 0, 0]), ("kinematic", [np.nan, 0, 0])]
)
def test_velocity_that_no_input_gives(name, velocity):
    with pytest.raises(ValueError, match="no input drives at"):
        steady_input(load_model(name), np.array(velocity))


def test_direction_in_which_no_input_drives():
    forward = {"x": {"u1": 1.0}, "y": {"u2": 1.0}, "theta": {"u1*u1": 1.0}}
    model = SparseModel("one-way", ["x", "y", "theta"], ["u1", "u2"], forward)
    with pytest.raises(ValueError, match="one-way: no input drives at"):
        steady_input(model, np.array([0.0, 0.0, -1.0]))


def test_straight_line_terminal_weight_is_the_riccati_matrix_of_its_linearisation(model):
    P = straight_line_terminal_weight(model, 0.1, Q, R, speed=0.2)
    u = steady_input(model, np.array([0.2, 0.0, 0.0]))
    _, A, B = model.linearise(np.zeros(3), u)
    expected = solve_discrete_are(np.eye(3) + 0.1 * A, 0.1 * B, Q, R)
    np.testing.assert_allclose(P, expected, rtol=1e-8, atol=1e-6)
    assert np.all(np.linalg.eigvalsh(P) > 1000)  # More than the first stage alone.


def test_terminal_weight_is_near_the_published_one(model, problem):
    P = straight_line_terminal_weight(model, 0.1, Q, R)
    np.testing.assert_allclose(np.diag(P), np.diag(problem.terminal_weight), rtol=0.25)


@pytest.mark.parametrize("bad", [np.zeros((3, 3)), -np.eye(3), np.triu(np.ones((3, 3)))])
def test_weight_that_is_not_positive_definite(bad, model):
    _, A, B = model.linearise(np.zeros(3), np.zeros(4))
    with pytest.raises(ValueError, match="Q must be symmetric and positive definite"):
        solve_dlqr(np.eye(3) + 0.1 * A, 0.1 * B, bad, R)
