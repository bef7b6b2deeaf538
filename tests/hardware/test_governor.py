import dataclasses as dc
import math

import numpy as np
import pytest
from governor_bench import NAN, OTHER, SESSION, STILL, Bench, drives, stops

from mirte_drake.hardware.governor import Governor, Phase
from mirte_drake.hardware.governor_config import GovernorConfig
from mirte_drake.hardware.messages import Request
from mirte_drake.hardware.odometry_check import OdometryLimits

# Waiting.


def test_waits_with_the_wheels_still():
    bench = Bench()
    command, status = bench.output(5.0)
    assert command == STILL
    assert dc.asdict(status) | {"command": None} == {
        "session": 0,
        "sequence": 0,
        "command": None,
        "stopped": False,
        "reason": "",
        "odometry_age": math.inf,
        "rejected": 0,
        "arrival": 0.0,
    }
    assert bench.output(5.0)[0] == STILL


def test_a_controller_alone_does_not_move_the_wheels():
    bench = Bench()
    for k in range(5):
        bench.command(0.1 * k)
        command, status = bench.output(0.1 * k)
        assert command == STILL
        assert status.session == 0
    assert bench.governor.phase is Phase.WAITING


def test_odometry_alone_does_not_move_the_wheels():
    bench = Bench()
    for k in range(5):
        bench.odometry(0.1 * k)
        command, status = bench.output(0.1 * k)
        assert command == STILL
        assert status.odometry_age == pytest.approx(0.0, abs=1e-6)


def test_waits_for_odometry_that_is_young_enough():
    bench = Bench()
    bench.odometry(0.0)
    bench.command(0.24)
    assert bench.output(0.24)[0] == STILL
    assert bench.governor.phase is Phase.WAITING
    bench.odometry(0.25)
    bench.command(0.26)
    assert bench.output(0.26)[0] == [10, 10, 10, 10]


def test_no_session_is_number_zero():
    bench = Bench()
    bench.odometry(0.0)
    bench.command(0.0, session=0)
    assert bench.output(0.0)[0] == STILL
    assert bench.governor.phase is Phase.WAITING


# Driving.


def test_passes_a_command_on_once():
    bench = Bench()
    bench.odometry(0.0)
    bench.command(0.01, (12.4, -12.6, 0.0, 50.0))
    command, status = bench.output(0.01)
    assert command == [12, -13, 0, 50]
    assert status.command.tolist() == command
    assert (status.session, status.sequence) == (SESSION, 0)
    assert status.odometry_age == pytest.approx(0.01)
    assert bench.output(0.02)[0] is None
    bench.odometry(0.1)
    bench.command(0.11, (20.0, 20.0, 20.0, 20.0))
    command, status = bench.output(0.11)
    assert command == [20, 20, 20, 20]
    assert status.sequence == 1


def test_of_two_commands_at_once_the_later_is_passed_on():
    bench = Bench()
    bench.odometry(0.0)
    bench.command(0.0, (10.0, 0.0, 0.0, 0.0))
    bench.command(0.0, (0.0, 20.0, 0.0, 0.0))
    command, status = bench.output(0.0)
    assert command == [0, 20, 0, 0]
    assert status.sequence == 1


@pytest.mark.parametrize("sequence", [1, 0, -1, -(10**30)])
def test_ignores_a_command_that_came_before(sequence):
    bench = Bench().drive(0.1)  # Sequences 0 and 1.
    bench.command(0.12, (90.0, 90.0, 90.0, 90.0), sequence=sequence)
    assert bench.output(0.12)[0] is None
    # Nor is it a sign of life.
    bench.output(0.2)
    bench.odometry(0.2)
    bench.output(0.3)
    assert stops(bench, 0.34, "controller is silent: 0.24 s (limit 0.23 s)")


def test_a_command_of_a_later_sequence_may_follow_lost_ones():
    bench = Bench().drive(0.1)
    bench.command(0.12, (20.0, 20.0, 20.0, 20.0), sequence=10**30)
    assert bench.output(0.12)[0] == [20, 20, 20, 20]


def test_holds_the_command_limit():
    bench = Bench(slew_limit=1e5, command_limit=60.0)
    bench.odometry(0.0)
    bench.command(0.0, (1e300, -1e300, 61.0, 59.0))
    assert bench.output(0.0)[0] == [60, -60, 60, 59]


def test_holds_the_slew_limit_between_commands():
    bench = Bench(slew_limit=300.0)
    bench.odometry(0.0)
    # From the wheels at rest: 300 pwm/s for the longest time that counts, 0.1 s.
    bench.command(0.0, (50.0, -50.0, 20.0, 0.0))
    assert bench.output(0.0)[0] == [30, -30, 20, 0]
    # 0.04 s later 12 pwm, from what was sent.
    bench.command(0.04, (50.0, -50.0, -20.0, 0.0))
    assert bench.output(0.04)[0] == [42, -42, 8, 0]
    # 0.2 s later no more than 30 pwm.
    bench.output(0.14)
    bench.odometry(0.2)
    bench.command(0.24, (-50.0, -50.0, -50.0, 50.0))
    assert bench.output(0.24)[0] == [12, -50, -22, 30]


def test_the_slew_limit_lets_the_wheels_stop():
    bench = Bench(slew_limit=300.0)
    bench.odometry(0.0)
    bench.command(0.0, (30.0, 30.0, 30.0, 30.0))
    bench.output(0.0)
    bench.command(0.01, (0.0, 0.0, 0.0, 0.0))
    assert bench.output(0.01)[0] == STILL
    assert bench.governor.phase is Phase.DRIVING


def test_time_that_stands_still_changes_no_wheel():
    bench = Bench()
    bench.odometry(0.0)
    bench.command(0.0, (10.0, 10.0, 10.0, 10.0))
    bench.output(0.0)
    bench.command(0.0, (90.0, -90.0, 0.0, 10.0))
    assert bench.output(0.0)[0] == [10, 10, 10, 10]


# The end, and after it.


def test_done_ends_the_drive_without_an_alarm():
    bench = Bench().drive(0.1)
    bench.command(0.15, (NAN, NAN, NAN, NAN), done=True)
    command, status = bench.output(0.15)
    assert command == STILL
    assert not status.stopped
    assert status.reason == ""
    # Nobody has to be there any more.
    assert bench.output(9.0)[0] == STILL
    assert not bench.output(99.0)[1].stopped
    assert bench.governor.phase is Phase.FINISHED


def test_done_is_no_way_for_another_session_to_end_a_drive_quietly():
    bench = Bench().drive(0.1)
    bench.command(0.12, session=OTHER, done=True)
    assert stops(bench, 0.12, "second controller: session 22 beside 11")


def test_a_session_that_is_done_does_not_go_on():
    bench = Bench().drive(0.1)
    bench.command(0.15, done=True)
    bench.output(0.15)
    bench.odometry(0.2)
    bench.command(0.2)
    assert bench.output(0.2)[0] == STILL
    assert bench.governor.phase is Phase.FINISHED


def test_a_new_session_may_follow_one_that_is_done():
    bench = Bench(slew_limit=300.0).drive(0.1)
    bench.command(0.15, done=True)
    bench.output(0.15)
    bench.odometry(8.0, (5.0, 5.0, 1.0))
    bench.command(8.0, (90.0,) * 4, (5.0, 5.0, 1.0), session=OTHER, sequence=0)
    command, status = bench.output(8.0)
    assert command == [30, 30, 30, 30]
    assert (status.session, status.sequence) == (OTHER, 0)


def stopped_bench():
    bench = Bench().drive(0.1)
    bench.request(0.12, Request.STOP)
    assert stops(bench, 0.12, "the operator asked for it")
    return bench


def test_nothing_but_a_reset_ends_a_stop():
    bench = stopped_bench()
    for k in range(20, 30):
        bench.odometry(0.1 * k)
        bench.command(0.1 * k)
        bench.command(0.1 * k, session=OTHER)
        bench.command(0.1 * k, done=True)
        bench.foreign(0.1 * k, np.ones(4))
        bench.request(0.1 * k, Request.STOP)
        assert stops(bench, 0.1 * k, "the operator asked for it")


def test_a_reset_needs_good_odometry():
    bench = stopped_bench()
    bench.request(2.0, Request.RESET)
    assert stops(bench, 2.0, "the operator asked for it")
    bench.odometry(2.1, (NAN, 0.0, 0.0))
    bench.request(2.1, Request.RESET)
    assert stops(bench, 2.1, "the operator asked for it")
    bench.odometry(2.2)
    bench.request(2.431, Request.RESET)
    assert stops(bench, 2.431, "the operator asked for it")
    bench.odometry(2.5)
    bench.request(2.5, Request.RESET)
    command, status = bench.output(2.5)
    assert command == STILL
    assert not status.stopped
    assert (status.session, status.reason) == (0, "")


def test_after_a_reset_a_new_session_is_needed():
    bench = stopped_bench()
    bench.odometry(2.0)
    bench.request(2.0, Request.RESET)
    bench.command(2.0)
    assert bench.output(2.0)[0] == STILL
    assert bench.governor.phase is Phase.WAITING
    bench.command(2.05, session=OTHER, sequence=0)
    assert bench.output(2.05)[0] == [10, 10, 10, 10]


def test_a_session_that_ended_long_ago_does_not_begin_again():
    """As a controller would that was stopped by SIGSTOP and goes on."""
    bench = stopped_bench()
    for k, session in enumerate((OTHER, 33, SESSION)):
        now = 2.0 + k
        bench.odometry(now)
        bench.request(now, Request.RESET)
        bench.command(now, session=session, sequence=100)
        assert bench.output(now)[0] == ([10] * 4 if session != SESSION else STILL)
        bench.request(now + 0.01, Request.STOP)


def test_what_is_not_a_reset_is_a_stop():
    bench = Bench().drive(0.1)
    bench.request(0.12, 7)
    assert stops(bench, 0.12, "the operator asked for it")


def test_the_first_reason_stays():
    bench = Bench().drive(0.1)
    bench.governor.stop("first")
    bench.governor.stop("second")
    assert stops(bench, 0.12, "first")


def test_a_stop_in_the_same_moment_keeps_a_command_back():
    bench = Bench().drive(0.1)
    bench.command(0.12, (80.0,) * 4)
    bench.governor.stop("now")
    assert stops(bench, 0.12, "now")
    bench.odometry(2.0)
    bench.request(2.0, Request.RESET)
    assert bench.output(2.0)[0] == STILL


# Faults of the odometry, as a whole.


def test_a_robot_that_restarts_can_be_driven_again():
    """Its clock begins anew, its pose too; a second later its odometry is believed."""
    bench = Bench().drive(0.3)
    stamp = bench.stamp
    for k in range(4, 14):
        now = 0.1 * k + 0.01
        bench.odometry(now, (0.7, 0.7, 0.7), measured=now - 1e6)
        bench.command(now, odometry_stamp=stamp)
        assert bench.governor.phase is (Phase.DRIVING if now < 0.53 else Phase.STOPPED)
        bench.request(now, Request.RESET)
    # The last that was accepted before came at 0.3 s.
    assert now == pytest.approx(1.31)
    assert bench.governor.phase is Phase.WAITING


def test_a_jump_is_not_believed_and_stops_the_robot():
    bench = Bench().drive(0.1)
    for k in range(2, 5):
        bench.odometry(0.1 * k, (1.0, 0.0, 0.0))
        bench.command(0.1 * k)
    reason = bench.output(0.4)[1].reason
    assert reason.startswith("odometry is old, rejected: jump of 1 m in 0.220 s (limit 1.5 m/s): ")


def test_every_second_odometry_may_be_lost():
    bench = Bench()
    for k in range(20):
        now = 0.1 * k
        if k % 2 == 0:
            bench.odometry(now)
        bench.command(now)
        assert drives(bench, now)
        assert drives(bench, now + 0.05)


# Construction.


@pytest.mark.parametrize(
    "bad",
    [
        {"max_odometry_age": 0.0},
        {"heartbeat_timeout": 1.1},
        {"max_stall": NAN},
        {"max_frozen_time": -1.0},
        {"slew_limit": 0.0},
        {"slew_time": 0.0},
        {"breakaway": 0.0},
        {"max_solve_failures": 0},
        {"command_limit": 101.0},
        {"max_tracking_error": np.array([0.5, -0.1])},
        {"allowed_area": np.array([0.0, 0.0, 0.0, 1.0])},
        {"allowed_area": np.array([0.0, 0.0, 1.0])},
        {"odometry": OdometryLimits(window=0)},
        {"odometry": OdometryLimits(restart_after=0.23)},
    ],
)
def test_rejects_bad_config(bad):
    with pytest.raises(ValueError, match=rf"^{next(iter(bad))}[.a-z_]*: "):
        Governor(GovernorConfig(**bad), np.zeros(3))


@pytest.mark.parametrize("start", [np.zeros(2), [NAN, 0.0, 0.0], [3.1, 0.0, 0.0]])
def test_rejects_bad_start(start):
    with pytest.raises(ValueError, match=r"^start: must "):
        Governor(GovernorConfig(), start)


def test_two_governors_share_nothing():
    first, second = Bench().drive(0.1), Bench()
    assert first.governor.phase is Phase.DRIVING
    assert second.governor.phase is Phase.WAITING
    second.governor.stop("second")
    assert drives(first, 0.12)
