import gc

import numpy as np
import pytest

from mirte_drake.benchmark import measure as module
from mirte_drake.benchmark.evaluation import rate_violation, true_cost
from mirte_drake.benchmark.measure import collection_off, measure, percentiles
from mirte_drake.benchmark.problems import Sample, choose_pairs
from mirte_drake.control.nmpc_program import NmpcProgram
from mirte_drake.control.nmpc_solution import NmpcSolution
from mirte_drake.control.plan import idle_plan
from mirte_drake.control.tracking_problem import join


class Clock:
    """Stands still but for what solvers take."""

    def __init__(self) -> None:
        self.now = 0.0

    def perf_counter(self) -> float:
        return self.now

    def process_time(self) -> float:
        return 0.5 * self.now


class Scripted:
    """Takes a given time, and applies the same input at every stage."""

    def __init__(self, name, clock, log, seconds, level, success=True) -> None:
        self.name, self.clock, self.log = name, clock, log
        self.seconds, self.level, self.success = seconds, level, success

    def solve(self, data, guess) -> NmpcSolution:
        self.log.append((self.name, data.state[0], gc.isenabled()))
        self.clock.now += self.seconds
        inputs = np.full((10, 4), self.level)
        states = np.tile(data.state, (11, 1))
        return NmpcSolution(self.success, "", states, inputs, 0.0, 7, self.seconds)


@pytest.fixture
def clock(monkeypatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(module, "time", clock)
    return clock


@pytest.fixture
def samples(problem, make_data):
    def sample(k: int) -> Sample:
        data = make_data(problem, 5)
        data.state[0] = k  # Tells the samples apart.
        data.previous_input[:] = 0.0
        return Sample(data, join(data.state, np.zeros((10, 4))), idle_plan(problem), data.state)

    return [sample(k) for k in range(6)]


def test_pairs_are_spread_over_the_run_each_with_the_sample_before(samples):
    pairs = choose_pairs(samples, 3)
    assert [(a.data.state[0], b.data.state[0]) for a, b in pairs] == [(0, 1), (2, 3), (4, 5)]
    assert len(choose_pairs(samples, 100)) == 5


def test_solvers_take_turns_and_each_solve_follows_the_sample_before(problem, samples, clock):
    log = []
    solvers = {name: Scripted(name, clock, log, 1.0, 0.0) for name in "ab"}
    measure(problem, solvers, choose_pairs(samples, 2), repeats=2)
    warm_up, timed = log[:4], log[4:]
    assert [(name, k) for name, k, _ in warm_up] == [("a", 0), ("a", 1), ("b", 0), ("b", 1)]
    # Rounds over problems 1 and 5, the order of the solvers rotating.
    expected = [(name, k) for order, k in (("ab", 1), ("ba", 5)) * 2 for name in order]
    assert [(name, k) for name, k, _ in timed[1::2]] == expected
    assert [(name, k) for name, k, _ in timed[::2]] == [(name, k - 1) for name, k in expected]
    assert not any(enabled for *_, enabled in timed)
    assert gc.isenabled()


def test_only_the_timed_solve_counts(problem, samples, clock):
    solvers = {"slow": Scripted("slow", clock, [], 3.0, 0.0)}
    measured = measure(problem, solvers, choose_pairs(samples, 4), repeats=2)["slow"]
    np.testing.assert_array_equal(measured.solve_time, np.full(8, 3.0))
    np.testing.assert_array_equal(measured.processor_time, np.full(8, 1.5))
    np.testing.assert_array_equal(measured.iterations, np.full(8, 7))


def test_a_solver_past_its_time_budget_sits_out(problem, samples, clock):
    solvers = {
        "slow": Scripted("slow", clock, [], 5.0, 0.0),
        "fast": Scripted("fast", clock, [], 1.0, 0.0),
    }
    calls = []
    measured = measure(
        problem,
        solvers,
        choose_pairs(samples, 2),
        repeats=3,
        time_budget=8.0,
        on_problem=lambda: calls.append(1),
    )
    assert {name: len(m.solve_time) for name, m in measured.items()} == {"slow": 2, "fast": 6}
    assert len(calls) == 6


def test_gap_is_relative_to_the_best_feasible_cost(problem, samples, clock):
    pairs = choose_pairs(samples, 1)
    data = pairs[0][1].data
    optimum = NmpcProgram(problem, solver="snopt", tolerance=1e-10)

    class Reference:
        def solve(self, data, guess) -> NmpcSolution:
            return optimum.solve(data, guess)

    solvers = {
        "still": Scripted("still", clock, [], 1.0, 0.0),
        "jumps": Scripted("jumps", clock, [], 1.0, 31.5),  # The rate limit is 30.
        "fails": Scripted("fails", clock, [], 1.0, 0.0, success=False),
    }
    measured = measure(problem, solvers, pairs, reference=Reference())
    best = optimum.solve(data, pairs[0][1].guess)
    still = solvers["still"].solve(data, pairs[0][1].guess)
    costs = {"still": true_cost(problem, data, still)}
    costs["best"] = min(true_cost(problem, data, best), costs["still"])
    # SNOPT meets rates within a tolerance; such a cost may not serve as the optimum.
    if rate_violation(problem, data, best) > module.FEASIBLE:
        costs["best"] = costs["still"]
    expected = (costs["still"] - costs["best"]) / costs["best"]
    assert measured["still"].gap[0] == pytest.approx(expected, rel=1e-9)
    assert measured["jumps"].rate_violation[0] == pytest.approx(1.5)
    assert measured["still"].rate_violation[0] == 0.0
    assert np.isnan(measured["fails"].gap[0]) and not measured["fails"].success[0]


def test_percentiles_of_known_numbers():
    values = np.arange(1001.0)
    result = percentiles(values)
    assert result == pytest.approx({"p50": 500.0, "p99": 990.0, "p99_9": 999.0, "max": 1000.0})
    assert list(result) == ["p50", "p99", "p99_9", "max"]


def test_collection_comes_back_after_an_error():
    with pytest.raises(RuntimeError), collection_off():
        assert not gc.isenabled()
        raise RuntimeError
    assert gc.isenabled()
