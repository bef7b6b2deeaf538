import numpy as np
import pytest

from mirte_drake.angles import pose_error
from mirte_drake.benchmark.closed_loop import run_closed_loops
from mirte_drake.benchmark.first_call import STAGES, first_call
from mirte_drake.benchmark.problems import drive, tracking_problem
from mirte_drake.benchmark.solvers import make_solver
from mirte_drake.run import simulate
from mirte_drake.scenario_file import load_scenario


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("rectangle", ["duration=1.5", "nominal_nmpc.solver=snopt"])


def test_the_samples_are_those_of_a_simulation(scenario):
    samples, log = list(drive(scenario)), simulate(scenario, "rectangle").log
    assert len(samples) == scenario.steps
    np.testing.assert_array_equal([s.pose for s in samples], log["pose"])
    np.testing.assert_array_equal([s.plan.inputs for s in samples], log["nominal_plan"])
    np.testing.assert_array_equal([s.data.half_width for s in samples], log["half_width"])


def test_problem_and_guess_are_the_controllers_own(scenario):
    """Solved again they give the plan of the run, to the last digit."""
    program = make_solver(tracking_problem(scenario), "snopt")
    for sample in drive(scenario):
        solution = program.solve(sample.data, sample.guess)
        np.testing.assert_array_equal(solution.inputs, sample.plan.inputs)


def test_closed_loops_with_two_solvers_agree(scenario):
    problem = tracking_problem(scenario)
    ticks = []
    solvers = {
        "snopt": make_solver(problem, "snopt"),
        "ipopt": make_solver(problem, "ipopt"),
    }
    loops = run_closed_loops(scenario, solvers, on_sample=lambda: ticks.append(1))
    log = simulate(scenario, "rectangle").log
    error = pose_error(log["pose"], log["reference"])
    np.testing.assert_array_equal(loops["snopt"].error, error)
    np.testing.assert_allclose(loops["snopt"].rmse, np.sqrt(np.mean(error**2, axis=0)))
    np.testing.assert_allclose(loops["ipopt"].error, error, atol=1e-4)
    assert np.any(loops["ipopt"].error != error)  # It was the other solver.
    for loop in loops.values():
        assert loop.success.all() and np.all(loop.solve_time > 0) and np.all(loop.iterations > 0)
    assert len(ticks) == scenario.steps


@pytest.mark.parametrize("compiled", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_first_call_has_its_stages(scenario, compiled):
    sample = next(iter(drive(scenario)))
    problem = tracking_problem(scenario)
    stages = first_call("snopt", problem, sample.data, sample.guess, compiled=compiled)
    assert tuple(stages) == STAGES
    assert all(seconds > 0 for seconds in stages.values())


def test_first_call_that_fails_says_why(scenario):
    sample = next(iter(drive(scenario)))
    with pytest.raises(RuntimeError, match=r"fresh process failed: .*acados"):
        first_call("acados", tracking_problem(scenario), sample.data, sample.guess)
