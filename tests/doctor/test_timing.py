import numpy as np
import pytest

from mirte_drake.doctor.finding import Grade
from mirte_drake.doctor.timing import (
    TIMER_COUNT,
    TIMER_PERIOD,
    check_solves,
    check_threads,
    check_timer,
    grade_solves,
    timing_scenario,
)
from mirte_drake.scenario_file import load_scenario


class Clock:
    """A clock that only sleeping moves, by more than asked for."""

    def __init__(self, late):
        self.now, self.late = 0.0, late

    def sleep(self, seconds):
        self.now += seconds + self.late

    def __call__(self):
        return self.now


@pytest.mark.parametrize(("slow", "grade"), [(1e-3, "GOOD"), (60e-3, "LACKING"), (150e-3, "BAD")])
def test_solves_are_graded_by_the_period(slow, grade):
    times = np.full(100, 1e-3)
    times[-2:] = slow
    finding = grade_solves(times, 0.1, "converged")
    assert finding.grade is Grade[grade]
    assert "1.00 ms median" in finding.says and "of 100 ms (converged)" in finding.says
    assert ("solver=realtime" in finding.remedy) == (grade != "GOOD")


def test_solves_are_those_of_a_drive():
    samples = []
    scenario = load_scenario("rectangle", ["duration=0.4"])
    finding = check_solves(scenario, on_sample=lambda: samples.append(1))
    assert len(samples) == 5
    assert finding.what == "solve time" and "(converged)" in finding.says


def test_the_drive_is_a_short_one():
    assert timing_scenario().steps == 51


def test_lateness_of_a_timer_is_measured():
    clock = Clock(late=2e-3)
    finding = check_timer(0.1, clock.sleep, clock)
    assert finding.grade is Grade.GOOD
    assert finding.says == "2.00 ms late median, 2.00 ms p99, 2.00 ms longest"
    assert clock.now == pytest.approx(TIMER_COUNT * TIMER_PERIOD + 2e-3)


def test_a_timer_later_than_a_tenth_of_the_period_is_lacking():
    clock = Clock(late=11e-3)
    finding = check_timer(0.1, clock.sleep, clock)
    assert finding.grade is Grade.LACKING and finding.remedy
    assert check_timer(0.2, clock.sleep, clock).grade is Grade.LACKING  # It falls behind.


@pytest.mark.parametrize(
    ("environment", "grade"),
    [({"OMP_NUM_THREADS": "1"}, "GOOD"), ({"OMP_NUM_THREADS": "8"}, "LACKING"), ({}, "LACKING")],
)
def test_threads(environment, grade):
    finding = check_threads(environment)
    assert finding.grade is Grade[grade]
    assert ("export OMP_NUM_THREADS=1" in finding.remedy) == (grade == "LACKING")
