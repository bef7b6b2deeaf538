import dataclasses as dc

import numpy as np
import pytest
from scipy.stats import binom

from mirte_drake.campaign.grid import Cell, Trial
from mirte_drake.campaign.outcome import Failure, Outcome
from mirte_drake.campaign.statistics import Interval, median, proportion, summarise_cells
from mirte_drake.scenario import Scenario

OUTCOME = Outcome(
    samples=11,
    delay=0,
    x_m=0.1,
    y_m=0.2,
    yaw_rad=0.3,
    true_x_m=0.4,
    true_y_m=0.5,
    true_yaw_rad=0.6,
    max_distance_m=0.7,
    max_yaw_rad=0.8,
    lost=False,
    saturation=0.9,
    oscillation=1.0,
    solve_failures=0,
    input_violations=0,
    rate_violations=0,
    tube_violations=0,
    successor_violations=0,
    true_violations=0,
    errors=None,
    in_use_misses=None,
    calibrated_misses=None,
)


def test_median_of_twenty_by_hand():
    # Of 20 values the sixth and the fifteenth bound the median: with probability
    # 1 - 2 P(at most 5 of 20 below it) = 0.9586.
    values = np.random.default_rng(0).permutation(np.arange(1.0, 21.0))
    assert median(list(values)) == Interval(10.5, 6.0, 15.0)
    assert 1 - 2 * binom.cdf(5, 20, 0.5) > 0.95 > 1 - 2 * binom.cdf(6, 20, 0.5)


def test_the_interval_holds_the_median_as_often_as_it_says():
    rng, hits = np.random.default_rng(1), 0
    for _ in range(400):
        interval = median(list(rng.lognormal(sigma=2.0, size=20)))
        hits += interval.low <= 1.0 <= interval.high
    assert hits >= 368  # Of an interval that holds it with 95.86 %, fewer have 0.02 % of seeds.


@pytest.mark.parametrize("number", [1, 5])
def test_few_values_have_no_interval(number):
    interval = median([2.0] * number)
    assert interval.value == 2.0 and np.isnan(interval.low) and np.isnan(interval.high)
    assert median([2.0] * 6) == Interval(2.0, 2.0, 2.0)


@pytest.mark.parametrize("values", [[], [1.0, np.nan], [np.inf] * 9])
def test_what_is_no_number_has_no_median(values):
    assert np.isnan(dc.astuple(median(values))).all()


def test_proportion_by_hand():
    # None of n: the upper bound is that p for which (1 - p)^n is 0.025.
    assert proportion(0, 10) == Interval(0.0, 0.0, pytest.approx(1 - 0.025**0.1))
    assert proportion(10, 10) == Interval(1.0, pytest.approx(0.025**0.1), 1.0)
    assert np.isnan(dc.astuple(proportion(0, 0))).all()


def cell(name="a") -> Cell:
    return Cell(name, (), Scenario())


def summary(*results):
    (shown,) = summarise_cells([Trial(c, i) for i in range(len(results)) for c in [CELL]], results)
    return shown


CELL = cell()


def test_cells_are_summarised_apart():
    first, second = cell("a"), cell("b")
    outcomes = [dc.replace(OUTCOME, x_m=x) for x in (1.0, 2.0, 3.0, 4.0, 5.0)]
    todo = [Trial(c, i) for i, c in enumerate([first, first, second, first, second])]
    one, two = summarise_cells(todo, outcomes)
    assert (one.cell, two.cell) == (first, second)
    assert (one.runs, two.runs) == (3, 2)
    assert (one.medians["x_m"].value, two.medians["x_m"].value) == (2.0, 4.0)


def test_samples_of_all_runs_count_together():
    shown = summary(
        dc.replace(OUTCOME, samples=11, true_violations=3, successor_violations=1),
        dc.replace(OUTCOME, samples=21, true_violations=0, successor_violations=2),
    )
    assert shown.true_inside == proportion(29, 32)
    assert shown.successor_inside == proportion(27, 30)
    assert shown.measured_inside == proportion(32, 32)
    assert shown.medians["true_inside"].value == pytest.approx((8 / 11 + 1) / 2)


def test_one_step_errors_of_all_runs_count_together():
    shown = summary(
        dc.replace(OUTCOME, errors=10, in_use_misses=5, calibrated_misses=1),
        dc.replace(OUTCOME, errors=30, in_use_misses=3, calibrated_misses=2),
    )
    assert shown.in_use_coverage == proportion(32, 40)
    assert shown.calibrated_coverage == proportion(37, 40)
    assert shown.medians["in_use_coverage"].value == pytest.approx((0.5 + 0.9) / 2)
    unwatched = summary(OUTCOME)
    assert np.isnan(unwatched.in_use_coverage.value)
    assert np.isnan(unwatched.medians["calibrated_coverage"].value)


def test_without_a_tube_there_is_no_share_in_it():
    none = {"tube_violations": None, "true_violations": None, "successor_violations": None}
    shown = summary(dc.replace(OUTCOME, **none))
    for interval in (shown.true_inside, shown.measured_inside, shown.medians["true_inside"]):
        assert np.isnan(interval.value)


def test_counts_are_summed_and_those_that_are_not_there_are_none():
    shown = summary(
        dc.replace(OUTCOME, solve_failures=2, rate_violations=None),
        dc.replace(OUTCOME, solve_failures=0, rate_violations=3),
    )
    assert shown.counts == {"solve_failures": 2, "input_violations": 0, "rate_violations": 3}


def test_lost_and_failed_runs_are_counted():
    lost = dc.replace(OUTCOME, lost=True)
    shown = summary(lost, OUTCOME, Failure("no"), OUTCOME, lost, Failure("no"))
    assert (shown.runs, shown.failed) == (6, 2)
    assert shown.lost == proportion(2, 4)
    assert shown.medians["x_m"].value == 0.1


def test_a_cell_of_failures_has_no_medians():
    shown = summary(Failure("no"), Failure("no"))
    assert shown.failed == 2 and np.isnan(shown.lost.value)
    assert np.isnan(shown.medians["x_m"].value) and np.isnan(shown.true_inside.value)
