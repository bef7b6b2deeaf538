"""What all solvers of the optimal control problem have in common."""

import dataclasses as dc
import time

import numpy as np
import pytest

from mirte_drake.control.nmpc_program import BY_PROGRAM, NmpcProgram
from mirte_drake.control.nmpc_solver import SOLVERS, NmpcSolver, make_nmpc_solver
from mirte_drake.control.tracking_problem import cost_and_gradient, join

GUESS = np.zeros(43)
MEETS = 1e-9  # [pwm] Rounding on the rate constraints.
OPTIMAL = [name for name in SOLVERS if name != "realtime"]


@pytest.fixture(scope="module", params=SOLVERS)
def solver(problem, request) -> NmpcSolver:
    return make_nmpc_solver(problem, request.param)


@pytest.fixture(scope="module", params=OPTIMAL)
def optimal(problem, request) -> NmpcSolver:
    return make_nmpc_solver(problem, request.param)


@pytest.fixture(scope="module")
def each(problem) -> list[NmpcSolver]:
    return [make_nmpc_solver(problem, name) for name in OPTIMAL]


def moves(data, solution) -> np.ndarray:
    return np.diff(solution.inputs, axis=0, prepend=data.previous_input[None])


def random_changes(seed: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    velocity = rng.uniform([-0.2, -0.2, -0.3], [0.2, 0.2, 0.3])
    start = rng.uniform([-1.0, -1.0, -3.0], [1.0, 1.0, 3.0])
    return {
        "state": start + rng.uniform(-0.05, 0.05, 3),
        "reference": start + 0.1 * np.arange(11)[:, None] * velocity,
        "half_width": rng.uniform(0.0, 0.02, 3),
        "previous_input": rng.uniform(-40.0, 40.0, 4),
    }


@pytest.mark.parametrize("seed", range(4))
def test_solvers_agree_and_obey_bounds_and_rates(problem, make_data, each, seed):
    data = make_data(**random_changes(seed))
    solutions = [solver.solve(data, GUESS) for solver in each]
    np.testing.assert_allclose([s.cost for s in solutions], solutions[0].cost, rtol=1e-5)
    for solution in solutions:
        assert solution.success and solution.message == ""
        assert solution.iterations > 0 and solution.solve_time > 0
        z = join(solution.initial_state, solution.inputs)
        np.testing.assert_allclose(solution.cost, cost_and_gradient(problem, data, z)[0], rtol=1e-6)
        assert np.all(np.abs(solution.initial_state - data.state) <= data.half_width + 1e-15)
        assert np.all(np.abs(solution.inputs) <= 90.0)
        assert np.all(np.abs(moves(data, solution)) <= 30.0 + MEETS)


@pytest.mark.parametrize("name", OPTIMAL)
def test_solution_is_a_minimum_among_its_neighbours(problem, make_data, name):
    # Where no bound is active the gradient vanishes.
    wide = dc.replace(problem, rate_limit=np.full(4, 1e3))
    data = make_data(
        half_width=np.full(3, 1.0),
        input_lower=np.full((10, 4), -1e3),
        input_upper=np.full((10, 4), 1e3),
    )
    solution = make_nmpc_solver(wide, name).solve(data, GUESS)
    assert solution.success
    z = join(solution.initial_state, solution.inputs)
    value, gradient = cost_and_gradient(wide, data, z)
    assert np.max(np.abs(gradient[3:])) < 1e-2
    rng = np.random.default_rng(0)
    for _ in range(20):
        assert cost_and_gradient(wide, data, z + 0.1 * rng.normal(size=43))[0] > value


def test_tube_of_width_zero_fixes_the_initial_state(make_data, solver):
    data = make_data(half_width=np.zeros(3))
    solution = solver.solve(data, GUESS)
    assert solution.success
    np.testing.assert_array_equal(solution.initial_state, data.state)


def test_input_bounds_are_met_and_active(make_data, optimal):
    upper = np.full((10, 4), 20.0)
    upper[:, 2] = 4.0
    data = make_data(reference=np.tile([1.0, 0.0, 0.0], (11, 1)), input_upper=upper)
    solution = optimal.solve(data, GUESS)
    assert solution.success
    assert np.all(solution.inputs <= upper)
    np.testing.assert_allclose(solution.inputs[3:6, 0], 20.0, atol=1e-3)
    np.testing.assert_allclose(solution.inputs[3:6, 2], 4.0, atol=1e-3)


def test_rate_bounds_are_met_and_active(make_data, optimal):
    data = make_data(reference=np.tile([1.0, 0.0, 0.0], (11, 1)), previous_input=np.full(4, -60.0))
    solution = optimal.solve(data, GUESS)
    assert solution.success
    assert np.all(np.abs(moves(data, solution)) <= 30.0 + MEETS)
    np.testing.assert_allclose(solution.inputs[:3, 0], [-30.0, 0.0, 30.0], atol=1e-3)


def test_no_freedom_at_all_is_solved(make_data, solver):
    fixed = np.tile(np.linspace(5.0, 50.0, 10)[:, None], 4)
    data = make_data(half_width=np.zeros(3), input_lower=fixed, input_upper=fixed)
    solution = solver.solve(data, GUESS)
    assert solution.success
    np.testing.assert_array_equal(solution.inputs, fixed)


def test_turns_of_the_reference_do_not_change_the_solution(make_data, solver):
    data = make_data()
    turned = make_data(reference=data.reference - np.array([0, 0, 4 * np.pi]))
    one, other = solver.solve(data, GUESS), solver.solve(turned, GUESS)
    np.testing.assert_allclose(other.cost, one.cost, rtol=1e-6)


def test_rate_gives_way_to_bounds_that_contradict_it(make_data, solver):
    data = make_data(input_lower=np.full((10, 4), 60.0), previous_input=np.zeros(4))
    solution = solver.solve(data, GUESS)
    assert solution.success and solution.relaxed
    assert solution.message == "bounds ask for a move of 60 pwm"
    np.testing.assert_array_equal(solution.inputs[0], np.full(4, 60.0))
    assert np.all(solution.inputs >= 60.0)
    assert np.all(np.abs(moves(data, solution)[1:]) <= 30.0 + MEETS)
    assert not solver.solve(make_data(), GUESS).relaxed


def test_bounds_that_cross_fail_with_a_message(make_data, solver):
    data = make_data(input_lower=np.full((10, 4), 10.0), input_upper=np.full((10, 4), 5.0))
    solution = solver.solve(data, GUESS)
    assert not solution.success
    assert solution.message


@pytest.mark.parametrize("field", ["state", "reference", "previous_input", "input_lower"])
def test_data_that_is_not_finite_fails_with_a_message(make_data, solver, field):
    array = getattr(make_data(), field).copy()
    array.flat[0] = np.nan
    solution = solver.solve(make_data(**{field: array}), GUESS)
    assert not solution.success
    assert solution.message == "measurement or problem data not finite"


def test_guess_that_is_not_finite_fails_with_a_message(make_data, solver):
    solution = solver.solve(make_data(), np.full(43, np.nan))
    assert not solution.success
    assert "not finite" in solution.message


@pytest.mark.parametrize("name", BY_PROGRAM)
def test_tiny_time_limit_fails_with_a_message(problem, make_data, name):
    solution = NmpcProgram(problem, solver=name, time_limit=1e-6).solve(make_data(), GUESS)
    assert not solution.success
    assert solution.message


def test_tiny_time_limit_gives_the_first_iterate(problem, make_data):
    data = make_data(**random_changes(5))
    solution = make_nmpc_solver(problem, "converged", time_limit=1e-9).solve(data, GUESS)
    assert solution.success and solution.early
    assert solution.message == "time limit of 1e-09 s reached"
    one_iteration = make_nmpc_solver(problem, "realtime").solve(data, GUESS)
    np.testing.assert_array_equal(solution.inputs, one_iteration.inputs)
    assert not one_iteration.early


@pytest.mark.parametrize("name", BY_PROGRAM)
def test_time_limit_ends_a_slow_solve(problem, make_data, name, monkeypatch):
    def slow_evaluation(*arguments):
        end = time.perf_counter() + 0.05
        while time.perf_counter() < end:
            pass
        return cost_and_gradient(*arguments)

    monkeypatch.setattr("mirte_drake.control.nmpc_program.cost_and_gradient", slow_evaluation)
    solution = NmpcProgram(problem, solver=name, time_limit=0.2).solve(make_data(), GUESS)
    assert not solution.success
    assert solution.solve_time < 0.8


def test_earlier_solves_leave_no_trace(make_data, solver):
    a, b = make_data(**random_changes(10)), make_data(**random_changes(11))
    infeasible = make_data(input_lower=np.full((10, 4), 95.0))
    first = solver.solve(a, GUESS)
    for between in (b, infeasible, make_data(state=np.full(3, np.nan))):
        solver.solve(between, GUESS)
    again = solver.solve(a, GUESS)
    np.testing.assert_array_equal(again.initial_state, first.initial_state)
    np.testing.assert_array_equal(again.inputs, first.inputs)
    assert (again.cost, again.iterations) == (first.cost, first.iterations)


def test_failed_solve_does_not_report_the_evaluations_of_the_one_before(make_data, solver):
    solver.solve(make_data(), GUESS)
    assert solver.solve(make_data(state=np.full(3, np.nan)), GUESS).iterations == 0


def test_solve_leaves_data_and_guess_alone(make_data, solver):
    data, guess = make_data(), np.full(43, 200.0)
    before = {field.name: getattr(data, field.name).copy() for field in dc.fields(data)}
    solver.solve(data, guess)
    np.testing.assert_array_equal(guess, 200.0)
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(data, name), value)


def test_warm_start_at_the_solution_needs_fewer_evaluations(make_data, optimal):
    cold = optimal.solve(make_data(), GUESS)
    warm = optimal.solve(make_data(), join(cold.initial_state, cold.inputs))
    assert warm.iterations < cold.iterations
    np.testing.assert_allclose(warm.cost, cold.cost, rtol=1e-5)


def test_unknown_solver(problem):
    known = "realtime, converged, snopt, ipopt"
    with pytest.raises(ValueError, match=f"solver: must be one of {known}, got 'acados'"):
        make_nmpc_solver(problem, "acados")
