"""Medians over the runs of a cell, and how far they can be trusted."""

import dataclasses as dc
from collections.abc import Iterable, Sequence

import numpy as np
from scipy.stats import binomtest, quantile_test

from mirte_drake.campaign.grid import Cell, Trial
from mirte_drake.campaign.outcome import Failure, Outcome

CONFIDENCE = 0.95
METRICS = (
    *("x_m", "y_m", "yaw_rad", "true_x_m", "true_y_m", "true_yaw_rad"),
    *("max_distance_m", "max_yaw_rad", "saturation", "oscillation"),
    *("measured_inside", "true_inside", "successor_inside"),
    *("in_use_coverage", "calibrated_coverage"),
)
COUNTS = ("solve_failures", "input_violations", "rate_violations")


@dc.dataclass(frozen=True)
class Interval:
    """An estimate with the bounds of its confidence interval; NaN where there is none."""

    value: float
    low: float
    high: float


def median(values: Sequence[float]) -> Interval:
    """Returns the median with its exact interval.

    The bounds are two of the values, as the binomial distribution has it: whatever the values are
    distributed as, the interval holds the median with at least ``CONFIDENCE``. A bootstrap only
    comes near that, and a t interval is for means of values without outliers, which a lost run is.
    Below six values there is no such interval.
    """
    if not values or not np.all(np.isfinite(values)):
        return Interval(np.nan, np.nan, np.nan)
    bounds = quantile_test(values, q=0, p=0.5).confidence_interval(CONFIDENCE)
    return Interval(float(np.median(values)), float(bounds.low), float(bounds.high))


def proportion(successes: int, trials: int) -> Interval:
    """Returns a share with its exact interval, that of Clopper and Pearson.

    Of samples of a run it is too narrow: they depend on each other.
    """
    if trials == 0:
        return Interval(np.nan, np.nan, np.nan)
    bounds = binomtest(successes, trials).proportion_ci(CONFIDENCE, method="exact")
    return Interval(successes / trials, float(bounds.low), float(bounds.high))


@dc.dataclass(frozen=True)
class CellSummary:
    """What the runs of a cell show together."""

    cell: Cell
    runs: int  # All of them.
    failed: int  # Without an outcome; all below is of the others.
    lost: Interval  # Share of runs.
    medians: dict[str, Interval]  # Of ``METRICS``.
    counts: dict[str, int]  # Of ``COUNTS``, samples of all runs: a median would hide a few.
    # Shares of the samples of all runs that were in the tube.
    measured_inside: Interval
    true_inside: Interval
    successor_inside: Interval
    # Shares of the one-step errors of all runs that the sets held.
    in_use_coverage: Interval
    calibrated_coverage: Interval


def summarise_cells(
    todo: Sequence[Trial], results: Sequence[Outcome | Failure]
) -> list[CellSummary]:
    """Returns a summary of every cell, in their order."""
    groups: dict[int, tuple[Cell, list[Outcome | Failure]]] = {}
    for trial, result in zip(todo, results, strict=True):
        groups.setdefault(id(trial.cell), (trial.cell, []))[1].append(result)
    return [_summarise(cell, group) for cell, group in groups.values()]


def _summarise(cell: Cell, results: Sequence[Outcome | Failure]) -> CellSummary:
    outcomes = [result for result in results if isinstance(result, Outcome)]
    predicted = sum(outcome.samples - 1 for outcome in outcomes)
    samples = predicted + len(outcomes)
    planned = samples - sum(outcome.delay for outcome in outcomes)
    errors = _sum(outcome.errors for outcome in outcomes)
    return CellSummary(
        cell=cell,
        runs=len(results),
        failed=len(results) - len(outcomes),
        lost=proportion(sum(outcome.lost for outcome in outcomes), len(outcomes)),
        medians={key: median([getattr(o, key) for o in outcomes]) for key in METRICS},
        counts={key: _sum(getattr(o, key) for o in outcomes) for key in COUNTS},
        measured_inside=_inside((o.tube_violations for o in outcomes), samples),
        true_inside=_inside((o.true_violations for o in outcomes), planned),
        successor_inside=_inside((o.successor_violations for o in outcomes), predicted),
        in_use_coverage=_inside((o.in_use_misses for o in outcomes), errors),
        calibrated_coverage=_inside((o.calibrated_misses for o in outcomes), errors),
    )


def _sum(counts: Iterable[int | None]) -> int:
    return sum(count or 0 for count in counts)


def _inside(violations: Iterable[int | None], samples: int) -> Interval:
    counts = list(violations)
    return proportion(0, 0) if None in counts else proportion(samples - _sum(counts), samples)
