import gc

import numpy as np
import pytest

from mirte_drake.benchmark import measure as module
from mirte_drake.benchmark.evaluation import FEASIBLE, rate_violation, true_cost
from mirte_drake.benchmark.measure import collection_off, measure, percentiles
from mirte_drake.benchmark.problems import Block, Sample, choose_blocks
from mirte_drake.control.nmpc_program import NmpcProgram
from mirte_drake.control.nmpc_solution import NmpcSolution
from mirte_drake.control.plan import idle_plan
from mirte_drake.control.tracking_problem import join


class Clock:
    """Stands still but for what solvers take."""

    def __init__(self) -> None:
        self.now = 0.0
        self.slept = 0

    def perf_counter(self) -> float:
        return self.now

    def process_time(self) -> float:
        return 0.5 * self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        self.slept += 1


class Scripted:
    """Takes a given time, and applies the same input at every stage."""

    def __init__(self, name, clock, log, seconds, level, success=True, preparation=0.0) -> None:
        self.name, self.clock, self.log = name, clock, log
        self.seconds, self.level, self.success = seconds, level, success
        self.preparation, self.prepared = preparation, None

    def prepare(self, guess) -> None:
        self.prepared = (guess[0], self.clock.slept)

    def solve(self, data, guess) -> NmpcSolution:
        ahead = self.preparation if self.prepared and self.prepared[0] == guess[0] else 0.0
        pauses = self.clock.slept - self.prepared[1] if ahead else None
        self.log.append((self.name, data.state[0], pauses, gc.isenabled()))
        self.clock.now += self.seconds - ahead
        self.prepared = None
        inputs = np.full((10, 4), self.level)
        states = np.tile(data.state, (11, 1))
        return NmpcSolution(self.success, "", states, inputs, 0.0, 7, self.seconds, ahead)


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

    return [sample(k) for k in range(14)]


def numbers(samples) -> list[int]:
    return [int(sample.data.state[0]) for sample in samples]


@pytest.fixture
def blocks(samples) -> list[Block]:
    return [Block(samples[0:2], samples[2:4]), Block(samples[6:8], samples[8:10])]


def test_blocks_are_spread_over_the_run_each_with_the_samples_before(samples, monkeypatch):
    monkeypatch.setattr("mirte_drake.benchmark.problems.BLOCK", 2)
    chosen = choose_blocks(samples, 5)
    assert [numbers(block.timed) for block in chosen] == [[5, 6], [9, 10], [13]]
    assert [numbers(block.lead) for block in chosen] == [
        [0, 1, 2, 3, 4], [4, 5, 6, 7, 8], [8, 9, 10, 11, 12],
    ]  # fmt: skip
    every = [k for block in choose_blocks(samples, 100) for k in numbers(block.timed)]
    assert every == list(range(5, 14))


@pytest.mark.parametrize("length", [1, 2, 6])
def test_a_short_run_has_one_block(samples, length):
    (block,) = choose_blocks(samples[:length], 1)
    assert numbers(block.lead) == list(range(length - 1))
    assert numbers(block.timed) == [length - 1]


def test_solvers_take_turns_by_blocks_in_the_order_of_the_run(problem, blocks, clock):
    log = []
    solvers = {name: Scripted(name, clock, log, 1.0, 0.0) for name in "abc"}
    measure(problem, solvers, blocks, repeats=2)
    assert [name for name, *_ in log[:3]] == ["a", "b", "c"]  # Whether they prepare anything.
    one, other = [0, 1, 2, 3], [6, 7, 8, 9]
    turns = [("abc", one), ("bca", other), ("cab", one), ("abc", other)]
    expected = [(name, k) for order, block in turns for name in order for k in block]
    assert [(name, k) for name, k, *_ in log[3:]] == expected
    assert not any(enabled for *_, enabled in log[3:])
    assert gc.isenabled() and clock.slept == 0


def test_after_a_pause_with_and_without_preparation(problem, blocks, clock):
    log = []
    solvers = {
        "plain": Scripted("plain", clock, log, 3.0, 0.0),
        "ahead": Scripted("ahead", clock, log, 2.0, 0.0, preparation=0.5),
    }
    measured = measure(problem, solvers, blocks, repeats=1, pause_repeats=2)
    for name, seconds in (("plain", 3.0), ("ahead", 2.0)):
        np.testing.assert_allclose(measured[name].solve_time, np.full(4, seconds))
        np.testing.assert_allclose(measured[name].after_pause, np.full(8, seconds))
    assert measured["plain"].feedback.size == measured["plain"].preparation.size == 0
    np.testing.assert_allclose(measured["ahead"].feedback, np.full(8, 1.5))
    np.testing.assert_allclose(measured["ahead"].preparation, np.full(8, 0.5))
    # Two rounds over four problems, in three turns. Between preparation and solve is one pause,
    # but at the first look at whether it prepares anything.
    assert clock.slept == 2 * 4 * 3
    assert [pauses for _, _, pauses, _ in log if pauses is not None] == [0, *[1] * 8]
    # Timed solves after the steady ones, each block's first: turns with and without preparation
    # rotate together.
    turns = [(name, pauses) for name, k, pauses, _ in log[18:] if k in (2, 8)]
    one, two, three = ("plain", None), ("ahead", None), ("ahead", 1)
    assert turns[:6] == [one, two, three, two, three, one]


def test_only_the_timed_solves_count(problem, blocks, clock):
    solvers = {"slow": Scripted("slow", clock, [], 3.0, 0.0)}
    measured = measure(problem, solvers, blocks, repeats=2)["slow"]
    np.testing.assert_array_equal(measured.solve_time, np.full(8, 3.0))
    np.testing.assert_array_equal(measured.processor_time, np.full(8, 1.5))
    np.testing.assert_array_equal(measured.iterations, np.full(8, 7))


def test_a_solver_past_its_time_budget_sits_out(problem, blocks, clock):
    solvers = {
        "slow": Scripted("slow", clock, [], 5.0, 0.0),
        "fast": Scripted("fast", clock, [], 1.0, 0.0),
    }
    calls = []
    measured = measure(
        problem,
        solvers,
        blocks,
        repeats=3,
        time_budget=12.0,
        on_problems=calls.append,
    )
    assert {name: len(m.solve_time) for name, m in measured.items()} == {"slow": 4, "fast": 12}
    assert calls == [2] * 6


def test_gap_is_relative_to_the_best_feasible_cost(problem, samples, clock):
    sample = samples[5]
    data = sample.data
    optimum = NmpcProgram(problem, solver="snopt", tolerance=1e-10)

    class Reference:
        def solve(self, data, guess) -> NmpcSolution:
            return optimum.solve(data, guess)

    solvers = {
        "still": Scripted("still", clock, [], 1.0, 0.0),
        "jumps": Scripted("jumps", clock, [], 1.0, 31.5),  # The rate limit is 30.
        "fails": Scripted("fails", clock, [], 1.0, 0.0, success=False),
    }
    measured = measure(problem, solvers, [Block([], [sample])], reference=Reference())
    best = optimum.solve(data, sample.guess)
    still = solvers["still"].solve(data, sample.guess)
    costs = {"still": true_cost(problem, data, still)}
    costs["best"] = min(true_cost(problem, data, best), costs["still"])
    # SNOPT meets rates within a tolerance; such a cost may not serve as the optimum.
    if rate_violation(problem, data, best) > FEASIBLE:
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
