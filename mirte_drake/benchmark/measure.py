"""Times solvers on the same problems, interleaved, and says how good their solutions are."""

import dataclasses as dc
import gc
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from mirte_drake.benchmark.evaluation import rate_violation, true_cost
from mirte_drake.benchmark.problems import Pair, Sample
from mirte_drake.control.nmpc_solution import NmpcSolution
from mirte_drake.control.nmpc_solver import NmpcSolver
from mirte_drake.control.tracking_problem import TrackingData, TrackingProblem

PERCENTILES = {"p50": 50.0, "p99": 99.0, "p99_9": 99.9, "max": 100.0}

# A solution may exceed its rate constraints by this much and still serve as the optimum [pwm].
FEASIBLE = 1e-9


@dc.dataclass(frozen=True)
class Measurement:
    """What one solver did; one entry for each solve."""

    solve_time: np.ndarray  # [s] wall clock.
    processor_time: np.ndarray  # [s] of all threads of the process.
    iterations: np.ndarray
    gap: np.ndarray  # (cost - optimum) / optimum; NaN where the solve failed.
    rate_violation: np.ndarray  # [pwm] beyond the rate constraints; the bounds are met exactly.
    success: np.ndarray  # bool


class _Solve(NamedTuple):
    problem: int  # Its index.
    wall_time: float  # [s]
    processor_time: float  # [s]
    solution: NmpcSolution


def measure(
    problem: TrackingProblem,
    solvers: Mapping[str, NmpcSolver],
    pairs: Sequence[Pair],
    *,
    repeats: int = 1,
    reference: NmpcSolver | None = None,
    time_budget: float = np.inf,
    on_problem: Callable[[], object] = lambda: None,
) -> dict[str, Measurement]:
    """Times every solver on every problem.

    The solvers take turns on each problem, in an order that rotates, so that whatever else the
    machine does meets all alike. Each timed solve follows an untimed one of the sample before, as
    in a controller. The first problem is solved once untimed to warm up. Python's garbage
    collection is off while timing.

    Args:
        problem: The problem that the solvers were made for.
        solvers: By name.
        pairs: Samples to solve, each with the one before.
        repeats: Rounds over all problems.
        reference: Finds the optimum. The optimum is the lowest cost that any solver, this one or
            a measured one, reached within the constraints.
        time_budget: [s] A solver that has used it sits out further rounds; it takes part in the
            first one in any case.
        on_problem: Called after all solvers had their turn at a problem, for a progress bar.
    """
    names = list(solvers)
    optimum = np.full(len(pairs), np.inf)
    if reference is not None:
        for index, pair in enumerate(pairs):
            solution = _solve_in_order(reference, pair, index).solution
            optimum[index] = _optimum(problem, pair[1].data, solution)
    records: dict[str, list[_Solve]] = {name: [] for name in names}
    spent = dict.fromkeys(names, 0.0)
    for name in names:
        _solve_in_order(solvers[name], pairs[0], 0)
    turn = 0
    with collection_off():
        for _ in range(repeats):
            taking_part = [name for name in names if spent[name] < time_budget]
            for index, pair in enumerate(pairs):
                for name in _rotated(taking_part, turn):
                    solve = _solve_in_order(solvers[name], pair, index)
                    records[name].append(solve)
                    spent[name] += solve.wall_time
                turn += 1
                on_problem()
    for rows in records.values():
        for solve in rows:
            cost = _optimum(problem, pairs[solve.problem][1].data, solve.solution)
            optimum[solve.problem] = min(optimum[solve.problem], cost)
    return {name: _evaluate(problem, pairs, optimum, rows) for name, rows in records.items()}


@contextmanager
def collection_off() -> Iterator[None]:
    """Collects garbage once, and then not before the block ends."""
    gc.collect()
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def percentiles(values: np.ndarray) -> dict[str, float]:
    """Returns median, tails and maximum of values, by the names of ``PERCENTILES``."""
    return {
        name: float(value)
        for name, value in zip(
            PERCENTILES, np.percentile(values, list(PERCENTILES.values())), strict=True
        )
    }


def _rotated(names: Sequence[str], turn: int) -> list[str]:
    first = turn % len(names) if names else 0
    return [*names[first:], *names[:first]]


def _solve_in_order(solver: NmpcSolver, pair: tuple[Sample, Sample], index: int) -> _Solve:
    """Solves the sample before and then, timed, the sample."""
    before, sample = pair
    solver.solve(before.data, before.guess)
    processor, wall = time.process_time(), time.perf_counter()
    solution = solver.solve(sample.data, sample.guess)
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    return _Solve(index, wall, processor, solution)


def _optimum(problem: TrackingProblem, data: TrackingData, solution: NmpcSolution) -> float:
    """Returns the cost of a solution, infinite where it does not meet the constraints."""
    if not solution.success or rate_violation(problem, data, solution) > FEASIBLE:
        return np.inf
    return true_cost(problem, data, solution)


def _evaluate(
    problem: TrackingProblem,
    pairs: Sequence[Pair],
    optimum: np.ndarray,
    rows: Sequence[_Solve],
) -> Measurement:
    gap, violation = np.full(len(rows), np.nan), np.full(len(rows), np.nan)
    for row, solve in enumerate(rows):
        if solve.solution.success:
            data, best = pairs[solve.problem][1].data, optimum[solve.problem]
            gap[row] = (true_cost(problem, data, solve.solution) - best) / best
            violation[row] = rate_violation(problem, data, solve.solution)
    return Measurement(
        np.array([solve.wall_time for solve in rows]),
        np.array([solve.processor_time for solve in rows]),
        np.array([solve.solution.iterations for solve in rows]),
        gap,
        violation,
        np.array([solve.solution.success for solve in rows], dtype=bool),
    )
