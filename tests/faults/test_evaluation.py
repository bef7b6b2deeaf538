"""Every check of the campaign can fail."""

import dataclasses as dc

import numpy as np
import pytest
from fault_records import DRIVING, END, FAULT, STILL, command, drive, every, status, stopped

from mirte_drake.faults.evaluation import judge, zeros_from
from mirte_drake.faults.oracle import DRIVES_ON, Expectation
from mirte_drake.hardware.messages import WheelCommand

OLD = ("odometry is old",)


def judged(record, since=0.9, reasons=OLD, within=0.25):
    expected = Expectation(since) if since else DRIVES_ON
    return judge(record, expected, within=within, reasons=reasons)


def test_a_stop_in_time_passes():
    verdict = judged(stopped(1.14))
    assert verdict.passed and verdict.due
    assert verdict.stop_time == pytest.approx(0.24)
    assert verdict.reason == "odometry is old: 0.23 s"


def test_a_late_zero_fails():
    (problem,) = judged(stopped(1.16)).problems
    assert problem == "zero on the wire 0.260 s after it was due (limit 0.25 s)"
    assert judged(stopped(1.16), within=0.35).passed


def test_wheels_that_never_stop_fail():
    problems = judged(drive(statuses=[status(1.0, "odometry is old")])).problems
    assert any("the wheels turn at the end: [20.0, 15.0, 15.0, 10.0] pwm" in p for p in problems)
    assert any("inf s after it was due" in p for p in problems)


def test_a_command_after_the_stop_fails():
    record = stopped(1.1)
    record.commands[-3] = command(record.commands[-3].arrival, DRIVING)
    (problem,) = judged(record).problems
    assert "after it was due" in problem


def test_one_wheel_that_turns_on_fails():
    record = stopped(1.1)
    record.commands[-1] = command(END, [0, 0, 1, 0])
    assert not judged(record).passed


def test_a_stop_before_the_fault_fails():
    assert "stopped before the fault" in judged(stopped(0.95, last=0.8), since=0.8).problems


def test_another_reason_fails():
    record = stopped(1.1, reason="controller is silent: 0.23 s")
    (problem,) = judged(record).problems
    assert "'controller is silent: 0.23 s', not one with odometry is old" in problem
    assert judged(record, reasons=(*OLD, "controller is silent")).passed


def test_without_a_guard_the_controller_gives_the_reason():
    record = dc.replace(stopped(1.1), statuses=[], ended="odometry is old: 0.23 s")
    assert judged(record).passed
    assert not judged(dc.replace(record, ended=None)).passed
    assert judged(dc.replace(record, ended=None), reasons=("",)).passed  # Nobody is left.


def test_a_drive_that_goes_on_passes():
    verdict = judged(drive(), since=None)
    assert verdict.passed and verdict.reason == "drove on" and np.isnan(verdict.stop_time)


def test_a_stop_that_is_not_due_fails():
    problems = judged(stopped(1.14), since=None).problems
    assert "stopped: odometry is old: 0.23 s" in problems
    assert "the wheels stand at the end" in problems


def test_a_stop_that_is_allowed_passes_and_needs_its_reason():
    allowed = Expectation(allowed=True)
    assert judge(stopped(1.14), allowed, within=0.25, reasons=OLD).passed
    assert judge(drive(), allowed, within=0.25, reasons=OLD).passed
    assert not judge(stopped(1.14), allowed, within=0.25, reasons=("frozen",)).passed


@pytest.mark.parametrize("who", ["controller", "guard"])
def test_a_drive_that_goes_on_without_one_of_its_processes_fails(who):
    record = drive(**{f"{who}_alive": False})
    assert judged(record, since=None).problems == (f"the {who} has ended",)


def test_a_drive_without_commands_fails():
    record = drive()
    record.commands = [c for c in record.commands if c.arrival < END - 0.3]
    assert judged(record, since=None).problems == ("no wheel command at the end",)


@pytest.mark.parametrize(
    ("value", "problem"),
    [
        (101.0, "a wheel command of 101 pwm (limit 100 pwm)"),
        (-130.0, "a wheel command of 130 pwm (limit 100 pwm)"),
        (12.5, "a wheel command is not a whole number"),
        (np.nan, "a wheel command is not finite"),
        (np.inf, "a wheel command is not finite"),
    ],
)
def test_a_command_out_of_limits_fails_stop_or_not(value, problem):
    for record, since in ((drive(), None), (stopped(1.14), 0.9)):
        record.commands[3] = command(0.3, [value, 0, 0, 0])
        assert problem in judged(record, since).problems


def zigzag(step, period=0.1):
    """Commands whose first wheel goes up by a step and down again."""
    times = enumerate(every(period, 0, 0.3))
    values = [command(t, [1 + step * (k % 2), 15, 15, 10]) for k, t in times]
    return drive(commands=[*values, *drive().commands[4:]])


def test_what_is_within_the_slew_limit_passes():
    assert judged(zigzag(30), since=None).passed


def test_what_is_faster_than_the_slew_limit_fails():
    """40 pwm in 0.02 s: 1000 pwm/s give 20, and 10 more by the jitter of arrivals."""
    (problem,) = judged(zigzag(40, period=0.02), since=None).problems
    assert problem == "a wheel changed by 40 pwm in 0.030 s"
    assert judged(zigzag(29, period=0.02), since=None).passed


def test_after_a_pause_no_more_than_after_a_sample():
    record = drive(commands=[command(0.0, [-60, 0, 0, 0]), *drive().commands[10:]])
    record.commands[1] = command(1.0, [60, 0, 0, 0])
    assert "a wheel changed by 120 pwm in 0.100 s" in judged(record, since=None).problems


def test_all_may_go_to_zero_at_once():
    record = drive(commands=[command(t, [90, 90, 0, 0]) for t in every(0.1, 0, 1.1)])
    record.commands += [command(t, STILL) for t in every(0.05, 1.101, END)]
    record.statuses = [status(1.1, "odometry is old")]
    assert judged(record).passed


def test_a_command_that_comes_in_parts_is_one():
    record = drive()
    parts = [command(1.1 + 1e-4 * k, [*([40] * k), *([20] * (4 - k))]) for k in range(1, 5)]
    record.commands[11:12] = parts
    record.commands[10] = command(1.0, [20] * 4)
    assert judged(record, since=None).passed


def test_a_strangers_command_is_not_the_guards():
    foreign = np.array([-90.0, 70.0, 80.0, 90.0])
    record = stopped(1.14)
    record.commands.insert(10, command(0.95, foreign))
    assert any("changed by" in problem for problem in judged(record).problems)
    record.foreign = [WheelCommand(foreign, 0.949)]
    assert judged(record).passed


def test_zeros_are_counted_from_the_first_of_the_last():
    assert zeros_from(stopped(1.14).commands) == pytest.approx(1.14)
    assert zeros_from(drive().commands) == np.inf
    assert zeros_from([]) == np.inf
    assert FAULT < 1.14
