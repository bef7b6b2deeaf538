"""Whether this machine keeps the sample time: how long solves take, how late a timer is."""

import os
import time
from collections.abc import Callable, Mapping

import numpy as np

from mirte_drake.doctor.finding import Finding, Grade
from mirte_drake.run import simulate
from mirte_drake.scenario import Scenario
from mirte_drake.scenario_file import load_scenario

SCENARIO, DURATION = "rectangle", 5.0  # [s] What is driven to measure.
TIMER_PERIOD, TIMER_COUNT = 0.01, 100  # [s]
TIGHT = 0.5  # Of the period, for a solve.
LATE = 0.1  # Of the period, for a timer.


def timing_scenario() -> Scenario:
    """Returns what is driven to measure."""
    return load_scenario(SCENARIO, [f"duration={DURATION}"])


def check_solves(scenario: Scenario, on_sample: Callable[[], object] = lambda: None) -> Finding:
    """Drives a scenario and says how long its solves take.

    Args:
        scenario: As ``timing_scenario``.
        on_sample: Called after each sample.
    """
    log = simulate(scenario, SCENARIO, on_sample).log
    return grade_solves(log["solve_time_s"], scenario.period, scenario.nominal_nmpc.solver)


def grade_solves(solve_time: np.ndarray, period: float, solver: str) -> Finding:
    """Says whether solve times (N,) [s] of a solver fit into the period [s]."""
    median, tail, longest = np.percentile(solve_time, [50, 99, 100])
    says = (
        f"{1e3 * median:.2f} ms median, {1e3 * tail:.2f} ms p99, {1e3 * longest:.2f} ms longest "
        f"of {1e3 * period:g} ms ({solver})"
    )
    if tail < TIGHT * period:
        return Finding("solve time", Grade.GOOD, says)
    grade = Grade.BAD if tail > period else Grade.LACKING
    remedy = (
        "OMP_NUM_THREADS=1, end other programs, --set nominal_nmpc.solver=realtime, or a longer "
        "period"
    )
    return Finding("solve time", grade, says, remedy)


def check_timer(
    period: float,
    sleep: Callable[[float], object] = time.sleep,
    clock: Callable[[], float] = time.monotonic,
) -> Finding:
    """Says how late this machine wakes a process up.

    Args:
        period: [s] of the controller, for which late is late.
        sleep: Waits for some seconds.
        clock: [s]
    """
    start, late = clock(), np.empty(TIMER_COUNT)
    for k in range(TIMER_COUNT):
        deadline = start + (k + 1) * TIMER_PERIOD
        sleep(max(0.0, deadline - clock()))
        late[k] = clock() - deadline
    median, tail, longest = 1e3 * np.percentile(late, [50, 99, 100])
    says = f"{median:.2f} ms late median, {tail:.2f} ms p99, {longest:.2f} ms longest"
    if tail <= 1e3 * LATE * period:
        return Finding("timer", Grade.GOOD, says)
    return Finding(
        "timer",
        Grade.LACKING,
        says,
        "end other programs and set the power mode to performance; a virtual machine may have "
        "busy neighbours",
    )


def check_threads(environment: Mapping[str, str] = os.environ) -> Finding:
    """Says whether numerical libraries are kept to one thread."""
    count = environment.get("OMP_NUM_THREADS")
    if count == "1":
        return Finding("threads", Grade.GOOD, "OMP_NUM_THREADS is 1")
    return Finding(
        "threads",
        Grade.LACKING,
        f"OMP_NUM_THREADS is {count or 'not set'}: threads get in the way of small matrices",
        "export OMP_NUM_THREADS=1",
    )
