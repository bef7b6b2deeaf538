"""How the solve time grows with the horizon and with the number of states."""

import dataclasses as dc
from collections.abc import Callable, Sequence

import numpy as np

from mirte_drake.benchmark.measure import measure
from mirte_drake.benchmark.problems import choose_blocks, drive_ideally
from mirte_drake.benchmark.solvers import make_driver, make_solver
from mirte_drake.control.tracking_problem import TrackingData, TrackingProblem
from mirte_drake.model.model_file import load_model

HORIZONS = (10, 20, 50, 100)
MODELS = ("kinematic", "extended_kinematic", "dynamic")

SAMPLES = 40  # Of the ideal run: the first 4 s, which has the robot under way.
REPEATS = 3  # Rounds over the problems of each size,
TIME_BUDGET = 0.5  # [s] as far as a solver has not used this.
SLOW = 0.1  # [s] A solver with a longer median is not tried on larger problems.


@dc.dataclass(frozen=True)
class Scaling:
    """Median solve times; NaN where a solver was left out or failed every time."""

    sizes: tuple[int, ...]  # Horizons, or numbers of states.
    labels: tuple[str, ...]
    solve_time: dict[str, np.ndarray]  # [s] one per size, by solver.


def horizon_scaling(
    problem: TrackingProblem,
    solvers: Sequence[str],
    typical: TrackingData,
    poses: np.ndarray,
    *,
    horizons: Sequence[int] = HORIZONS,
    count: int = 10,
    on_step: Callable[[], object] = lambda: None,
) -> Scaling:
    """Times solvers over the horizon.

    Args:
        problem: The problem whose horizon is varied.
        solvers: Their names.
        typical: Bounds and tube, see ``drive_ideally``.
        poses: (K, 3) reference.
        horizons: In samples.
        count: Problems of each horizon.
        on_step: Called after each horizon, for a progress bar.
    """
    problems = [dc.replace(problem, horizon=horizon) for horizon in horizons]
    labels = [str(horizon) for horizon in horizons]
    return _scaling(problems, horizons, labels, solvers, typical, poses, count, on_step)


def state_scaling(
    problem: TrackingProblem,
    solvers: Sequence[str],
    typical: TrackingData,
    poses: np.ndarray,
    *,
    models: Sequence[str] = MODELS,
    count: int = 10,
    on_step: Callable[[], object] = lambda: None,
) -> Scaling:
    """Times solvers over identified models; arguments as ``horizon_scaling``."""
    problems = [dc.replace(problem, model=load_model(name)) for name in models]
    sizes = [each.model.num_states for each in problems]
    return _scaling(problems, sizes, models, solvers, typical, poses, count, on_step)


def growth_exponent(sizes: Sequence[int], times: np.ndarray) -> float:
    """Returns p of the fit time = c size^p, least squares of the logarithms; NaN below 2 points.

    Args:
        sizes: (S,)
        times: (S,) [s]; NaN are left out.
    """
    known = np.isfinite(times)
    if np.sum(known) < 2:
        return np.nan
    return float(np.polyfit(np.log(np.array(sizes)[known]), np.log(times[known]), 1)[0])


def crossover(sizes: Sequence[int], one: np.ndarray, other: np.ndarray) -> float:
    """Returns from which size on ``other`` is faster, interpolated between logarithms.

    The smallest size where it is faster from the start; infinite where it never is.

    Args:
        sizes: (S,) ascending.
        one: (S,) [s] times; NaN counts as slower than anything known.
        other: (S,) [s] times.
    """
    gain = np.log(np.where(np.isnan(one), np.inf, one)) - np.log(other)
    faster = np.flatnonzero(gain > 0)
    if faster.size == 0:
        return np.inf
    i = int(faster[0])
    if i == 0 or not np.isfinite(gain[i]) or not np.isfinite(gain[i - 1]):
        return float(sizes[i])
    share = -gain[i - 1] / (gain[i] - gain[i - 1])
    start, end = np.log(sizes[i - 1]), np.log(sizes[i])
    return float(np.exp(start + share * (end - start)))


def _scaling(
    problems: Sequence[TrackingProblem],
    sizes: Sequence[int],
    labels: Sequence[str],
    solvers: Sequence[str],
    typical: TrackingData,
    poses: np.ndarray,
    count: int,
    on_step: Callable[[], object],
) -> Scaling:
    medians = {name: np.full(len(problems), np.nan) for name in solvers}
    for index, problem in enumerate(problems):
        names = [name for name in solvers if not np.nanmax(medians[name], initial=0.0) > SLOW]
        made = {name: make_solver(problem, name) for name in names}
        if made:
            samples = list(drive_ideally(problem, make_driver(problem), typical, poses, SAMPLES))
            blocks = choose_blocks(samples[SAMPLES // 2 :], count)
            measured = measure(problem, made, blocks, repeats=REPEATS, time_budget=TIME_BUDGET)
            for name, measurement in measured.items():
                if np.any(measurement.success):
                    solved = measurement.solve_time[measurement.success]
                    medians[name][index] = np.median(solved)
        on_step()
    return Scaling(tuple(sizes), tuple(labels), medians)
