"""Times solvers on the same problems, in turns, and says how good their solutions are."""

import dataclasses as dc
import gc
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import NamedTuple

import numpy as np

from mirte_drake.benchmark.evaluation import evaluate, lowest_cost
from mirte_drake.benchmark.problems import Block, Sample
from mirte_drake.control.nmpc_solution import NmpcSolution
from mirte_drake.control.nmpc_solver import NmpcSolver
from mirte_drake.control.tracking_problem import TrackingProblem

PERCENTILES = {"p50": 50.0, "p99": 99.0, "p99_9": 99.9, "max": 100.0}

PAUSE = 5e-3  # [s] Enough to lose the caches. After longer pauses solves take longer still.


@dc.dataclass(frozen=True)
class Measurement:
    """What one solver did; one entry for each solve."""

    solve_time: np.ndarray  # [s] wall clock, one solve straight after the other.
    processor_time: np.ndarray  # [s] of all threads of the process.
    iterations: np.ndarray
    gap: np.ndarray  # (cost - optimum) / optimum; NaN where the solve failed.
    rate_violation: np.ndarray  # [pwm] beyond the rate constraints; the bounds are met exactly.
    success: np.ndarray  # bool
    after_pause: np.ndarray  # [s] each after a pause of ``PAUSE``.
    # The same with ``prepare`` called before the pause; empty where that does nothing.
    preparation: np.ndarray  # [s] before the pause.
    feedback: np.ndarray  # [s] after it.


class _Turn(NamedTuple):
    solver: str
    prepare: bool  # Whether ``prepare`` is called ahead of each solve.


class _Solve(NamedTuple):
    wall_time: float  # [s]
    processor_time: float  # [s]
    solution: NmpcSolution


def measure(
    problem: TrackingProblem,
    solvers: Mapping[str, NmpcSolver],
    blocks: Sequence[Block],
    *,
    repeats: int = 1,
    pause_repeats: int = 0,
    reference: NmpcSolver | None = None,
    time_budget: float = np.inf,
    on_problems: Callable[[int], object] = lambda count: None,
) -> dict[str, Measurement]:
    """Times every solver on every problem, back to back and after pauses.

    The solvers take turns on each block, in an order that rotates, so that whatever else the
    machine does meets all alike. Within its turn a solver goes through the block in the order of
    the run, as a controller would. Python's garbage collection is off while timing.

    Args:
        problem: The problem that the solvers were made for.
        solvers: By name.
        blocks: Samples to solve.
        repeats: Rounds over all blocks.
        pause_repeats: Rounds with a pause before every solve, in which solvers that can prepare
            have a second turn with that done before the pause.
        reference: Finds the optimum. The optimum is the lowest cost that any solver, this one or
            a measured one, reached within the constraints.
        time_budget: [s] A solver that has used it sits out further rounds of a kind; it takes
            part in the first one in any case.
        on_problems: Called with the number of problems that all solvers just had their turn at,
            for a progress bar.
    """
    samples = [sample for block in blocks for sample in block.timed]
    turns = [_Turn(name, prepare=False) for name in solvers]
    prepared_turns = [
        _Turn(name, prepare=True)
        for name, solver in solvers.items()
        if _prepares(solver, samples[0])
    ]
    take_turns = partial(_take_turns, solvers, blocks, time_budget, on_problems)
    with collection_off():
        steady = take_turns(turns, repeats)
        paused = take_turns(turns + prepared_turns, pause_repeats, pause=PAUSE)
    rated = {turn: _evaluate(problem, samples, solves) for turn, solves in steady.items()}
    candidates = [*rated.values()]
    if reference is not None:
        solves = [solve for block in blocks for solve in _solve_block(reference, block)]
        candidates.append(_evaluate(problem, samples, solves))
    optimum = np.min([lowest_cost(cost, violation) for cost, violation in candidates], axis=0)
    measured = {}
    for turn, solves in steady.items():
        cost, violation = rated[turn]
        prepared = paused.get(turn._replace(prepare=True), [])
        measured[turn.solver] = Measurement(
            solve_time=_wall_times(solves),
            processor_time=np.array([solve.processor_time for solve in solves]),
            iterations=np.array([solve.solution.iterations for solve in solves]),
            gap=((cost - optimum) / optimum).ravel(),
            rate_violation=violation.ravel(),
            success=np.array([solve.solution.success for solve in solves], dtype=bool),
            after_pause=_wall_times(paused[turn]),
            preparation=np.array([solve.solution.preparation_time for solve in prepared]),
            feedback=_wall_times(prepared),
        )
    return measured


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


def _prepares(solver: NmpcSolver, sample: Sample) -> bool:
    """Whether ``prepare`` takes anything off the solve."""
    solver.prepare(sample.guess)
    return solver.solve(sample.data, sample.guess).preparation_time > 0


def _take_turns(
    solvers: Mapping[str, NmpcSolver],
    blocks: Sequence[Block],
    time_budget: float,
    on_problems: Callable[[int], object],
    turns: Sequence[_Turn],
    repeats: int,
    pause: float = 0.0,
) -> dict[_Turn, list[_Solve]]:
    """Returns the solves of each turn: round by round, in each all samples in their order."""
    solves: dict[_Turn, list[_Solve]] = {turn: [] for turn in turns}
    first = 0
    for _ in range(repeats):
        order = [turn for turn in turns if np.sum(_wall_times(solves[turn])) < time_budget]
        for block in blocks:
            for turn in [*order[first:], *order[:first]]:
                solves[turn] += _solve_block(solvers[turn.solver], block, pause, turn.prepare)
            first = (first + 1) % max(1, len(order))
            on_problems(len(block.timed))
    return solves


def _solve_block(
    solver: NmpcSolver, block: Block, pause: float = 0.0, prepare: bool = False
) -> list[_Solve]:
    for sample in block.lead:
        solver.solve(sample.data, sample.guess)
    solves = []
    for sample in block.timed:
        if prepare:
            solver.prepare(sample.guess)
        if pause:
            time.sleep(pause)
        processor, wall = time.process_time(), time.perf_counter()
        solution = solver.solve(sample.data, sample.guess)
        wall, processor = time.perf_counter() - wall, time.process_time() - processor
        solves.append(_Solve(wall, processor, solution))
    return solves


def _evaluate(
    problem: TrackingProblem, samples: Sequence[Sample], solves: Sequence[_Solve]
) -> tuple[np.ndarray, np.ndarray]:
    data = [sample.data for sample in samples]
    return evaluate(problem, data, [solve.solution for solve in solves])


def _wall_times(solves: Sequence[_Solve]) -> np.ndarray:
    return np.array([solve.wall_time for solve in solves])
