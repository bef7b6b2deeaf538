"""The whole benchmark of one scenario."""

import dataclasses as dc
from collections.abc import Callable, Sequence

import numpy as np

from mirte_drake.benchmark.ancillary import time_designs
from mirte_drake.benchmark.closed_loop import ClosedLoop, run_closed_loops
from mirte_drake.benchmark.first_call import first_call
from mirte_drake.benchmark.measure import Measurement, measure
from mirte_drake.benchmark.problems import LEAD, choose_blocks, drive, tracking_problem
from mirte_drake.benchmark.scaling import HORIZONS, Scaling, horizon_scaling, state_scaling
from mirte_drake.benchmark.solvers import make_reference_solver, make_solver
from mirte_drake.checks import check_number
from mirte_drake.scenario import Scenario

# Weights of a long step in the progress bar, against one problem or one sample.
LONG_STEP = 20


@dc.dataclass(frozen=True)
class BenchmarkSettings:
    """How much is measured."""

    problems: int = 100  # Logged problems.
    repeats: int = 10  # Rounds over them: 1000 solves are needed for the 99.9th percentile.
    pause_repeats: int = 3  # Rounds with a pause before every solve.
    time_budget: float = 5.0  # [s] A solver that has used it sits out further rounds.
    loop_duration: float | None = None  # [s] of the closed loops; None: the scenario's.
    horizons: tuple[int, ...] = HORIZONS
    scaling_problems: int = 10  # At each horizon and model.
    after_installation: bool = True  # Whether to find out what the very first call costs.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_number("problems", self.problems, minimum=1)
        check_number("repeats", self.repeats, minimum=1)


QUICK = BenchmarkSettings(
    problems=10,
    repeats=2,
    pause_repeats=1,
    time_budget=0.5,
    loop_duration=3.0,
    horizons=(10, 20),
    scaling_problems=2,
    after_installation=False,
)


@dc.dataclass(frozen=True)
class Benchmark:
    """What was measured; mappings go by the solver's name."""

    name: str  # Of the scenario.
    period: float  # [s]
    settings: BenchmarkSettings
    problems: int  # So many were timed: no more than the run had to give.
    solves: dict[str, Measurement]
    closed_loops: dict[str, ClosedLoop]
    design_time: np.ndarray  # [s] of the ancillary law's designs.
    first_calls: dict[str, dict[str, float]]  # [s] in a fresh process.
    installation_calls: dict[str, dict[str, float]]  # [s] with nothing compiled: the first solver.
    horizons: Scaling
    states: Scaling


def progress_length(settings: BenchmarkSettings, scenario: Scenario, solvers: int) -> int:
    """Returns how often ``run_benchmark`` reports progress, as the length of a bar."""
    loop = _loop_scenario(settings, scenario)
    long_steps = len(settings.horizons) + 2 + solvers
    rounds = settings.repeats + settings.pause_repeats
    timed = min(settings.problems, max(1, loop.steps - LEAD))
    return 2 * loop.steps + timed * rounds + long_steps * LONG_STEP


def run_benchmark(
    scenario: Scenario,
    name: str,
    solvers: Sequence[str],
    settings: BenchmarkSettings,
    on_progress: Callable[[int], object] = lambda steps: None,
) -> Benchmark:
    """Measures solvers on the problems of a scenario.

    Args:
        scenario: Its closed loop gives the problems.
        name: Of the scenario.
        solvers: Names out of ``SOLVER_NAMES``.
        settings: How much to measure.
        on_progress: Called with the steps just done, for a progress bar of ``progress_length``.

    Raises:
        UserError: when a package is missing.
        ValueError: when the scenario cannot be built or a setting is out of range.
    """
    settings.validate()
    problem = tracking_problem(scenario)
    made = {solver: make_solver(problem, solver) for solver in solvers}

    def step() -> None:
        on_progress(1)

    def long_step() -> None:
        on_progress(LONG_STEP)

    loop = _loop_scenario(settings, scenario)
    samples = []
    for sample in drive(loop):
        samples.append(sample)
        step()
    blocks = choose_blocks(samples, settings.problems)
    measured = measure(
        problem,
        made,
        blocks,
        repeats=settings.repeats,
        pause_repeats=settings.pause_repeats,
        reference=make_reference_solver(problem),
        time_budget=settings.time_budget,
        on_problems=on_progress,
    )
    closed_loops = run_closed_loops(loop, made, on_sample=step)
    design_time = time_designs(loop, samples, settings.repeats)
    typical = samples[-1].data
    poses = np.array([sample.data.reference[0] for sample in samples])
    horizons = horizon_scaling(
        problem,
        solvers,
        typical,
        poses,
        horizons=settings.horizons,
        count=settings.scaling_problems,
        on_step=long_step,
    )
    states = state_scaling(problem, solvers, typical, poses, count=settings.scaling_problems)
    long_step()
    first = blocks[0].timed[0]
    first_calls = {}
    for solver in solvers:
        first_calls[solver] = first_call(solver, problem, first.data, first.guess)
        long_step()
    installation_calls = {}
    if settings.after_installation:
        # The controller's solvers share what they compile, so that one stands for all.
        stages = first_call(solvers[0], problem, first.data, first.guess, compiled=False)
        installation_calls[solvers[0]] = stages
    long_step()
    return Benchmark(
        name,
        scenario.period,
        settings,
        sum(len(block.timed) for block in blocks),
        measured,
        closed_loops,
        design_time,
        first_calls,
        installation_calls,
        horizons,
        states,
    )


def _loop_scenario(settings: BenchmarkSettings, scenario: Scenario) -> Scenario:
    if settings.loop_duration is None:
        return scenario
    return dc.replace(scenario, duration=settings.loop_duration)
