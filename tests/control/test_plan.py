import dataclasses as dc

import numpy as np
import pytest

from mirte_drake.control.nmpc_solution import NmpcSolution
from mirte_drake.control.plan import MAX_SHIFTS, Plan, SolveStatus, idle_plan, next_plan, warm_start
from mirte_drake.control.tracking_problem import split
from mirte_drake.model.model_file import load_model

INPUTS = 5.0 * np.arange(10)[:, None] + np.array([1.0, -1.0, 2.0, 0.0])
START = np.array([0.012, -0.018, 0.031])
REST = np.zeros(4)


def solution(success: bool = True, **changes: bool) -> NmpcSolution:
    message = "" if success else "no luck"
    states = load_model("extended_kinematic").roll_out(START, INPUTS, 0.1)
    return NmpcSolution(success, message, states, INPUTS, 12.0, 34, 0.05, **changes)


@pytest.fixture
def solved(problem, make_data) -> Plan:
    return next_plan(problem, idle_plan(problem), make_data(), solution(), REST)


def fail(problem, previous: Plan, data, times: int = 1, applied_input=REST) -> Plan:
    for _ in range(times):
        previous = next_plan(problem, previous, data, solution(False), applied_input)
    return previous


def test_idle_plan_is_at_rest(problem):
    plan = idle_plan(problem)
    assert (plan.sample, plan.status, plan.failures) == (-1, SolveStatus.STOPPING, 0)
    assert (plan.states.shape, plan.inputs.shape) == ((11, 3), (10, 4))
    assert not np.any(plan.states) and not np.any(plan.inputs)
    assert plan.data.is_finite()


def test_solved_plan_is_the_solution(problem, make_data, solved):
    assert (solved.sample, solved.status, solved.message) == (0, SolveStatus.SOLVED, "")
    assert (solved.failures, solved.cost, solved.iterations, solved.solve_time) == (0, 12, 34, 0.05)
    np.testing.assert_array_equal(solved.inputs, INPUTS)
    np.testing.assert_array_equal(solved.nominal_state, START)
    np.testing.assert_array_equal(solved.nominal_input, INPUTS[0])
    step = problem.model.step(START, INPUTS[0], 0.1)
    np.testing.assert_allclose(solved.nominal_next, step, atol=1e-14)
    np.testing.assert_allclose(solved.states, problem.model.roll_out(START, INPUTS, 0.1))
    np.testing.assert_array_equal(solved.data.state, make_data().state)


@pytest.mark.parametrize(
    ("changes", "status"),
    [
        ({"relaxed": True}, SolveStatus.RELAXED),
        ({"early": True}, SolveStatus.EARLY),
        ({"relaxed": True, "early": True}, SolveStatus.RELAXED_EARLY),
    ],
)
def test_status_tells_what_a_solve_gave_up(problem, make_data, changes, status):
    plan = next_plan(problem, idle_plan(problem), make_data(), solution(**changes), REST)
    assert (plan.status, plan.failures) == (status, 0)
    assert not plan.status.failed
    assert plan.status.relaxed == changes.get("relaxed", False)
    assert plan.status.early == changes.get("early", False)


def test_failed_states_are_those_without_a_solution():
    assert [s.name for s in SolveStatus if s.failed] == ["SHIFTED", "STOPPING"]


def test_first_failures_move_the_plan_on(problem, make_data, solved):
    data = make_data(state=np.ones(3))
    plan = solved
    for failures in range(1, MAX_SHIFTS + 1):
        plan = fail(problem, plan, data)
        assert (plan.status, plan.failures) == (SolveStatus.SHIFTED, failures)
        assert (plan.sample, plan.message) == (failures, "no luck")
        assert plan.data is data
        last = np.tile(INPUTS[-1], (failures, 1))
        np.testing.assert_array_equal(plan.inputs, np.vstack([INPUTS[failures:], last]))
        known = 11 - failures
        np.testing.assert_allclose(plan.states[:known], solved.states[failures:], atol=1e-13)
    assert MAX_SHIFTS == 3


def test_fourth_failure_ramps_the_applied_input_to_zero(problem, make_data, solved):
    applied = np.array([100.0, -45.0, 30.0, 0.0])
    plan = fail(problem, solved, make_data(), 3)
    plan = next_plan(problem, plan, make_data(), solution(False), applied)
    assert (plan.status, plan.failures) == (SolveStatus.STOPPING, 4)
    expected = [[70, -15, 0, 0], [40, 0, 0, 0], [10, 0, 0, 0], [0, 0, 0, 0]]
    np.testing.assert_array_equal(plan.inputs[:4], expected)
    assert not np.any(plan.inputs[4:])


def test_nominal_state_follows_the_measurement_while_stopping(problem, make_data, solved):
    plan = fail(problem, solved, make_data(state=np.array([1.0, 2.0, 3.0])), 4)
    np.testing.assert_array_equal(plan.nominal_state, [1.0, 2.0, 3.0])


def test_wheels_reach_zero_when_each_sample_applies_the_plan(problem, make_data, solved):
    applied = np.array([100.0, -100.0, 50.0, 1.0])
    plan = fail(problem, solved, make_data(), 3)
    for _ in range(4):
        plan = next_plan(problem, plan, make_data(), solution(False), applied)
        assert np.all(np.abs(plan.nominal_input - applied) <= problem.rate_limit)
        applied = plan.nominal_input
    assert not np.any(applied)


def test_rate_limit_of_each_wheel_holds_while_stopping(problem, make_data):
    limited = dc.replace(problem, rate_limit=np.array([1.0, 2.0, 5.0, 50.0]))
    applied = np.array([20.0, -20.0, 20.0, -20.0])
    plan = next_plan(limited, idle_plan(limited), make_data(), solution(False), applied)
    np.testing.assert_array_equal(plan.inputs[0], [19.0, -18.0, 15.0, 0.0])
    np.testing.assert_array_equal(plan.inputs[-1], [10.0, 0.0, 0.0, 0.0])


def test_failure_before_any_solve_stops(problem, make_data):
    plan = fail(problem, idle_plan(problem), make_data())
    assert (plan.sample, plan.status, plan.failures) == (0, SolveStatus.STOPPING, 1)
    assert not np.any(plan.inputs)
    np.testing.assert_allclose(plan.states, np.tile(make_data().state, (11, 1)))


def test_stopping_does_not_shift_again(problem, make_data):
    plan = fail(problem, idle_plan(problem), make_data(), 6)
    assert (plan.status, plan.failures) == (SolveStatus.STOPPING, 6)


@pytest.mark.parametrize("failures", [1, 3, 4, 7])
def test_first_success_ends_the_fallback(problem, make_data, solved, failures):
    plan = fail(problem, solved, make_data(), failures)
    plan = next_plan(problem, plan, make_data(), solution(), REST)
    assert (plan.status, plan.failures, plan.message) == (SolveStatus.SOLVED, 0, "")
    assert plan.sample == failures + 1
    np.testing.assert_array_equal(plan.inputs, INPUTS)
    # And the next failure is a first one.
    assert fail(problem, plan, make_data()).status is SolveStatus.SHIFTED


@pytest.mark.parametrize("failures", [1, 4])
def test_measurement_that_is_not_finite_keeps_the_plan_finite(problem, make_data, solved, failures):
    lost = make_data(state=np.array([0.0, np.nan, 0.0]))
    plan = fail(problem, solved, lost, failures, applied_input=np.array([np.nan, 50, np.inf, 0]))
    assert np.all(np.isfinite(plan.states)) and np.all(np.isfinite(plan.inputs))
    np.testing.assert_allclose(plan.nominal_state, solved.states[failures], atol=1e-12)


def test_applied_input_that_is_not_finite_counts_as_zero(problem, make_data):
    applied = np.array([np.nan, np.inf, -np.inf, 50.0])
    plan = fail(problem, idle_plan(problem), make_data(), applied_input=applied)
    np.testing.assert_array_equal(plan.nominal_input, [0.0, 0.0, 0.0, 20.0])


def test_warm_start_is_the_plan_moved_on(problem, solved):
    x0, inputs = split(problem, warm_start(problem, solved, np.ones(3)))
    np.testing.assert_array_equal(x0, solved.nominal_next)
    np.testing.assert_array_equal(inputs, np.vstack([INPUTS[1:], INPUTS[-1:]]))


def test_warm_start_after_a_stop_is_at_the_measured_state(problem):
    x0, inputs = split(problem, warm_start(problem, idle_plan(problem), np.ones(3)))
    np.testing.assert_array_equal(x0, np.ones(3))
    assert not np.any(inputs)


def test_plans_leave_their_inputs_alone(problem, make_data, solved):
    before = solved.inputs.copy(), solved.states.copy()
    applied = np.array([50.0, 0.0, 0.0, 0.0])
    fail(problem, solved, make_data(), 5, applied_input=applied)
    np.testing.assert_array_equal(solved.inputs, before[0])
    np.testing.assert_array_equal(solved.states, before[1])
    np.testing.assert_array_equal(applied, [50.0, 0.0, 0.0, 0.0])
