import dataclasses as dc
import time

import numpy as np
import pytest

from mirte_drake.control.nmpc_program import SOLVERS, NmpcProgram, shift
from mirte_drake.control.tracking_problem import cost_and_gradient, join

GUESS = np.zeros(43)
MEETS = 1e-5  # [pwm] Tolerance of the solvers on the rate constraints.


@pytest.fixture(scope="module", params=SOLVERS)
def program(problem, request) -> NmpcProgram:
    return NmpcProgram(problem, solver=request.param)


@pytest.fixture(scope="module")
def both(problem) -> list[NmpcProgram]:
    return [NmpcProgram(problem, solver=name) for name in SOLVERS]


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
def test_solvers_agree_and_obey_bounds_and_rates(problem, make_data, both, seed):
    data = make_data(**random_changes(seed))
    snopt, ipopt = (program.solve(data, GUESS) for program in both)
    np.testing.assert_allclose(snopt.cost, ipopt.cost, rtol=1e-5)
    for solution in (snopt, ipopt):
        assert solution.success and solution.message == ""
        assert solution.iterations > 0 and solution.solve_time > 0
        z = join(solution.initial_state, solution.inputs)
        np.testing.assert_allclose(solution.cost, cost_and_gradient(problem, data, z)[0], rtol=1e-6)
        assert np.all(np.abs(solution.initial_state - data.state) <= data.half_width + 1e-15)
        assert np.all(np.abs(solution.inputs) <= 90.0)
        assert np.all(np.abs(moves(data, solution)) <= 30.0 + MEETS)


def test_solution_is_a_minimum_among_its_neighbours(problem, make_data, program):
    # Where no bound is active the gradient vanishes.
    wide = dc.replace(problem, rate_limit=np.full(4, 1e3))
    data = make_data(
        half_width=np.full(3, 1.0),
        input_lower=np.full((10, 4), -1e3),
        input_upper=np.full((10, 4), 1e3),
    )
    solution = NmpcProgram(wide).solve(data, GUESS)
    assert solution.success
    z = join(solution.initial_state, solution.inputs)
    value, gradient = cost_and_gradient(wide, data, z)
    assert np.max(np.abs(gradient[3:])) < 1e-2
    rng = np.random.default_rng(0)
    for _ in range(20):
        assert cost_and_gradient(wide, data, z + 0.1 * rng.normal(size=43))[0] > value


def test_tube_of_width_zero_fixes_the_initial_state(make_data, program):
    data = make_data(half_width=np.zeros(3))
    solution = program.solve(data, GUESS)
    assert solution.success
    np.testing.assert_array_equal(solution.initial_state, data.state)


def test_input_bounds_are_met_and_active(make_data, program):
    upper = np.full((10, 4), 20.0)
    upper[:, 2] = 4.0
    data = make_data(reference=np.tile([1.0, 0.0, 0.0], (11, 1)), input_upper=upper)
    solution = program.solve(data, GUESS)
    assert solution.success
    assert np.all(solution.inputs <= upper)
    np.testing.assert_allclose(solution.inputs[3:6, 0], 20.0, atol=1e-3)
    np.testing.assert_allclose(solution.inputs[3:6, 2], 4.0, atol=1e-3)


def test_rate_bounds_are_met_and_active(make_data, program):
    data = make_data(reference=np.tile([1.0, 0.0, 0.0], (11, 1)), previous_input=np.full(4, -60.0))
    solution = program.solve(data, GUESS)
    assert solution.success
    assert np.all(np.abs(moves(data, solution)) <= 30.0 + MEETS)
    np.testing.assert_allclose(solution.inputs[:3, 0], [-30.0, 0.0, 30.0], atol=1e-3)


def test_no_freedom_at_all_is_solved(make_data, program):
    fixed = np.tile(np.linspace(5.0, 50.0, 10)[:, None], 4)
    data = make_data(half_width=np.zeros(3), input_lower=fixed, input_upper=fixed)
    solution = program.solve(data, GUESS)
    assert solution.success
    np.testing.assert_array_equal(solution.inputs, fixed)


def test_turns_of_the_reference_do_not_change_the_solution(make_data, program):
    data = make_data()
    turned = make_data(reference=data.reference - np.array([0, 0, 4 * np.pi]))
    one, other = program.solve(data, GUESS), program.solve(turned, GUESS)
    np.testing.assert_allclose(other.cost, one.cost, rtol=1e-6)


def test_rates_that_contradict_the_bounds_fail_with_a_message(make_data, program):
    data = make_data(input_lower=np.full((10, 4), 60.0), previous_input=np.zeros(4))
    solution = program.solve(data, GUESS)
    assert not solution.success
    assert "Infeasible" in solution.message


def test_bounds_that_cross_fail_with_a_message(make_data, program):
    data = make_data(input_lower=np.full((10, 4), 10.0), input_upper=np.full((10, 4), 5.0))
    solution = program.solve(data, GUESS)
    assert not solution.success
    assert solution.message


@pytest.mark.parametrize("field", ["state", "reference", "previous_input", "input_lower"])
def test_data_that_is_not_finite_fails_with_a_message(make_data, program, field):
    array = getattr(make_data(), field).copy()
    array.flat[0] = np.nan
    solution = program.solve(make_data(**{field: array}), GUESS)
    assert not solution.success
    assert solution.message == "measurement or problem data not finite"


def test_guess_that_is_not_finite_fails_with_a_message(make_data, program):
    solution = program.solve(make_data(), np.full(43, np.nan))
    assert not solution.success
    assert "not finite" in solution.message


@pytest.mark.parametrize("name", SOLVERS)
def test_tiny_time_limit_fails_with_a_message(problem, make_data, name):
    solution = NmpcProgram(problem, solver=name, time_limit=1e-6).solve(make_data(), GUESS)
    assert not solution.success
    assert solution.message


@pytest.mark.parametrize("name", SOLVERS)
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


def test_earlier_solves_leave_no_trace(make_data, program):
    a, b = make_data(**random_changes(10)), make_data(**random_changes(11))
    infeasible = make_data(input_lower=np.full((10, 4), 60.0))
    first = program.solve(a, GUESS)
    for between in (b, infeasible, make_data(state=np.full(3, np.nan))):
        program.solve(between, GUESS)
    again = program.solve(a, GUESS)
    np.testing.assert_array_equal(again.initial_state, first.initial_state)
    np.testing.assert_array_equal(again.inputs, first.inputs)
    assert (again.cost, again.iterations) == (first.cost, first.iterations)


def test_failed_solve_does_not_report_the_evaluations_of_the_one_before(make_data, program):
    program.solve(make_data(), GUESS)
    assert program.solve(make_data(state=np.full(3, np.nan)), GUESS).iterations == 0


def test_solve_leaves_data_and_guess_alone(make_data, program):
    data, guess = make_data(), np.full(43, 200.0)
    before = {field.name: getattr(data, field.name).copy() for field in dc.fields(data)}
    program.solve(data, guess)
    np.testing.assert_array_equal(guess, 200.0)
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(data, name), value)


def test_warm_start_at_the_solution_needs_fewer_evaluations(make_data, program):
    cold = program.solve(make_data(), GUESS)
    warm = program.solve(make_data(), join(cold.initial_state, cold.inputs))
    assert warm.iterations < cold.iterations
    np.testing.assert_allclose(warm.cost, cold.cost, rtol=1e-5)


def test_unknown_solver(problem):
    with pytest.raises(ValueError, match="solver: must be one of snopt, ipopt, got 'acados'"):
        NmpcProgram(problem, solver="acados")


def test_shift_drops_the_first_input_and_repeats_the_last(problem):
    inputs = np.arange(40.0).reshape(10, 4)
    shifted = shift(problem, np.array([1.0, 2.0, 3.0]), inputs)
    expected = [1.0, 2.0, 3.0, *range(4, 40), 36.0, 37.0, 38.0, 39.0]
    np.testing.assert_array_equal(shifted, expected)
