"""Each rule that stops the robot, at its limit."""

import math

import numpy as np
import pytest
from governor_bench import NAN, OTHER, STILL, Bench, drives, stops

from mirte_drake.hardware.governor import Phase
from mirte_drake.hardware.messages import Request

# Stops: ages.


def test_stops_when_odometry_is_old():
    bench = Bench().drive(0.1)
    bench.output(0.2)
    bench.command(0.25)
    bench.output(0.3)
    assert drives(bench, 0.329)
    assert stops(bench, 0.331, "odometry is old: 0.231 s (limit 0.23 s)")


def test_says_what_was_wrong_with_the_odometry_since():
    bench = Bench().drive(0.1)
    bench.odometry(0.2, (NAN, 0.0, 0.0))
    bench.command(0.25)
    bench.output(0.25)
    assert bench.output(0.3)[1].rejected == 1
    why = "odometry is old, rejected: pose: must be finite, got [nan, 0.0, 0.0]: 0.24 s"
    assert stops(bench, 0.34, f"{why} (limit 0.23 s)")


def test_an_odometry_that_is_good_again_forgets_what_was_rejected():
    bench = Bench().drive(0.1)
    bench.odometry(0.15, (NAN, 0.0, 0.0))
    bench.odometry(0.2)
    bench.output(0.2)
    bench.command(0.3)
    bench.output(0.3)
    bench.output(0.4)
    assert stops(bench, 0.44, "odometry is old: 0.24 s (limit 0.23 s)")
    assert bench.output(0.44)[1].rejected == 1


def test_odometry_that_comes_too_late_does_not_help():
    bench = Bench().drive(0.1)
    bench.output(0.2)
    bench.command(0.25)
    bench.output(0.3)
    bench.odometry(0.34)
    assert stops(bench, 0.34, "odometry is old: 0.24 s (limit 0.23 s)")


def test_odometry_that_was_measured_long_ago_is_old():
    bench = Bench().drive(0.1)
    bench.odometry(0.25, measured=0.15)
    bench.command(0.25)
    bench.output(0.3)
    assert bench.output(0.3)[1].odometry_age == pytest.approx(0.15, abs=1e-6)
    assert stops(bench, 0.381, "odometry is old: 0.231 s (limit 0.23 s)")


def test_stops_when_the_controller_is_silent():
    bench = Bench().drive(0.1)
    bench.odometry(0.2)
    bench.output(0.2)
    bench.odometry(0.3)
    bench.output(0.3)
    assert drives(bench, 0.329)
    assert stops(bench, 0.331, "controller is silent: 0.231 s (limit 0.23 s)")


def test_a_command_that_comes_too_late_does_not_help():
    bench = Bench().drive(0.1)
    bench.odometry(0.2)
    bench.output(0.2)
    bench.odometry(0.3)
    bench.output(0.3)
    bench.command(0.34)
    assert stops(bench, 0.34, "controller is silent: 0.24 s (limit 0.23 s)")


@pytest.mark.parametrize("event", ["odometry", "command", "output", "request", "foreign"])
def test_stops_when_the_guard_has_stalled(event):
    bench = Bench().drive(0.1)
    bench.stalls = True
    match event:
        case "odometry":
            bench.odometry(0.21)
        case "command":
            bench.command(0.21)
        case "request":
            bench.request(0.21, Request.STOP)
        case "foreign":
            bench.foreign(0.21, [0, 0, 0, 9])
    assert stops(bench, 0.21, "guard stalled: 0.11 s (limit 0.1 s)")


def test_a_guard_may_look_every_tenth_of_a_second():
    bench = Bench().drive(0.1)
    bench.stalls = True
    assert drives(bench, 0.199)


def test_a_guard_that_waits_may_stall():
    bench = Bench()
    bench.output(0.0)
    bench.stalls = True
    bench.odometry(5.0)
    bench.command(5.0)
    assert drives(bench, 5.0)


@pytest.mark.parametrize("now", [-1.0, NAN, math.inf, -math.inf])
def test_stops_when_the_clock_is_out_of_order(now):
    bench = Bench().drive(0.1)
    bench.stalls = True
    command, status = bench.output(now)
    assert command == STILL
    assert status.stopped


# Stops: the controller.


@pytest.mark.parametrize("age", [0.231, -0.231])
def test_stops_at_a_command_that_answers_another_time(age):
    bench = Bench().drive(0.1)
    bench.odometry(0.2)
    bench.command(0.2, odometry_stamp=bench.stamp - round(1e9 * age))
    assert stops(bench, 0.2, "command answers old odometry: 0.231 s (limit 0.23 s)")


def test_a_command_may_answer_the_odometry_before_the_last():
    bench = Bench().drive(0.1)
    stamp = bench.stamp
    bench.odometry(0.2)
    bench.command(0.2, (20.0,) * 4, odometry_stamp=stamp)
    assert bench.output(0.2)[0] == [20, 20, 20, 20]


def test_stops_at_three_failed_solves_in_a_row():
    bench = Bench()
    for k, failed in enumerate([True, True, False, True, True]):
        bench.odometry(0.1 * k)
        bench.command(0.1 * k, solve_failed=failed)
        assert drives(bench, 0.1 * k)
    bench.odometry(0.5)
    bench.command(0.5, solve_failed=True)
    assert stops(bench, 0.5, "failed solves in a row: 3 (3 stop)")


def test_failed_solves_count_when_they_come_at_once():
    bench = Bench(max_solve_failures=2).drive(0.1)
    bench.command(0.12, solve_failed=True)
    bench.command(0.12, solve_failed=True)
    assert stops(bench, 0.12, "failed solves in a row: 2 (2 stop)")


@pytest.mark.parametrize("bad", [NAN, math.inf, -math.inf, 10**400, "x", None])
@pytest.mark.parametrize("field", ["command", "reference"])
def test_stops_at_a_command_that_is_no_number(field, bad):
    bench = Bench().drive(0.1)
    size = 4 if field == "command" else 3
    bench.command(0.12, **{field: np.array([0.0] * (size - 1) + [bad], dtype=object)})
    command, status = bench.output(0.12)
    assert command == STILL
    assert status.reason.startswith(f"not a command: {field}: must be ")


@pytest.mark.parametrize("shape", [(), (0,), (1,), (5,), (4, 1), (1, 4), (2, 2)])
@pytest.mark.parametrize("field", ["command", "reference"])
def test_stops_at_a_command_of_another_shape(field, shape):
    bench = Bench().drive(0.1)
    bench.command(0.12, **{field: np.ones(shape)})
    command, status = bench.output(0.12)
    assert command == STILL
    assert status.reason.startswith(f"not a command: {field}: must have shape")


@pytest.mark.parametrize("stamp", [-1, 2**63, 10**400, NAN, None])
def test_stops_at_a_command_that_answers_no_stamp(stamp):
    bench = Bench().drive(0.1)
    bench.command(0.12, odometry_stamp=stamp)
    command, status = bench.output(0.12)
    assert command == STILL
    assert status.reason.startswith("not a command: odometry_stamp: must be ")


def test_a_first_command_that_is_no_number_stops():
    bench = Bench()
    bench.odometry(0.0)
    bench.command(0.0, (NAN, 0.0, 0.0, 0.0))
    reason = "not a command: command: must be finite, got [nan, 0.0, 0.0, 0.0]"
    assert stops(bench, 0.0, reason)


def test_a_good_command_behind_a_bad_one_does_not_help():
    bench = Bench().drive(0.1)
    bench.command(0.12, (NAN, 0.0, 0.0, 0.0))
    bench.command(0.12)
    reason = "not a command: command: must be finite, got [nan, 0.0, 0.0, 0.0]"
    assert stops(bench, 0.12, reason)


def test_stops_at_a_second_controller():
    bench = Bench().drive(0.1)
    bench.command(0.12, session=OTHER)
    assert stops(bench, 0.12, "second controller: session 22 beside 11")


# Stops: others on the wire.


@pytest.mark.parametrize("command", [[0, 0, 1, 0], [NAN, 0.0, 0.0, 0.0], [0, 0, 0, 0]])
def test_stops_at_another_sender_while_driving(command):
    bench = Bench().drive(0.1)
    bench.foreign(0.12, np.array(command))
    assert stops(bench, 0.12, f"another sender on the wheel topics: {command} pwm")


@pytest.mark.parametrize("command", [[0, 0, 0, -30], [NAN, 0.0, 0.0, 0.0]])
def test_stops_at_another_sender_while_waiting(command):
    bench = Bench()
    bench.foreign(0.0, command)
    assert stops(bench, 0.0, f"another sender on the wheel topics: {command} pwm")


def test_zeros_of_others_do_not_matter_while_waiting():
    bench = Bench()
    bench.foreign(0.0, [0, 0, 0, 0])
    assert not bench.output(0.0)[1].stopped


def test_stops_when_the_operator_asks():
    bench = Bench().drive(0.1)
    bench.request(0.12, Request.STOP)
    assert stops(bench, 0.12, "the operator asked for it")


def test_a_stop_while_waiting_keeps_a_controller_from_beginning():
    bench = Bench()
    bench.request(0.0, Request.STOP)
    bench.odometry(0.0)
    bench.command(0.0)
    assert stops(bench, 0.0, "the operator asked for it")


# Stops: where the robot is.


def creep(bench, pose, *, now=0.0, step=0.05):
    """Takes the robot from where it is to a pose in steps that are no jumps, while it drives."""
    here = np.zeros(3)
    while True:
        bench.odometry(now, here)
        bench.command(now, reference=here)
        if np.array_equal(here, pose):
            return now
        bench.output(now)
        here = here + np.clip(np.array(pose) - here, -step, step)
        now += 0.1


@pytest.mark.parametrize(
    ("pose", "says"),
    [
        ((0.31, 0.0, 0.0), "x 0.31 m, y 0.00 m"),
        ((-0.31, 0.1, 0.0), "x -0.31 m, y 0.10 m"),
        ((0.0, 0.21, 0.0), "x 0.00 m, y 0.21 m"),
        ((0.0, -0.21, 0.0), "x 0.00 m, y -0.21 m"),
    ],
)
def test_stops_outside_the_allowed_area(pose, says):
    bench = Bench(allowed_area=np.array([-0.3, -0.2, 0.3, 0.2]))
    now = creep(bench, pose)
    limits = "(limits -0.3 to 0.3 m, -0.2 to 0.2 m)"
    assert stops(bench, now, f"outside the allowed area: {says} {limits}")


def test_drives_inside_the_allowed_area():
    bench = Bench(allowed_area=np.array([-0.3, -0.2, 0.3, 0.2]))
    assert drives(bench, creep(bench, (0.3, -0.2, 0.0)))


def test_the_allowed_area_is_in_the_paths_frame():
    # The path begins at (0.6, 0) and looks along y: what is ahead of the robot is y of the path.
    area = np.array([0.5, -0.1, 0.7, 1.0])
    bench = Bench(start=(0.6, 0.0, math.pi / 2), allowed_area=area)
    assert drives(bench, creep(bench, (0.9, 0.0, 0.0)))
    bench = Bench(start=(0.6, 0.0, math.pi / 2), allowed_area=area)
    now = creep(bench, (0.0, 0.15, 0.0))
    limits = "(limits 0.5 to 0.7 m, -0.1 to 1 m)"
    assert stops(bench, now, f"outside the allowed area: x 0.45 m, y 0.00 m {limits}")


def test_the_frame_is_that_of_the_sessions_start():
    """The robot has driven before, or was carried; the odometry begins nowhere near zero."""
    bench = Bench(allowed_area=np.array([-0.3, -0.2, 0.3, 0.2]))
    bench.odometry(0.0, (50.0, 20.0, -3.0))
    bench.command(0.0, reference=(50.0, 20.0, -3.0))
    assert drives(bench, 0.0)


def test_stops_off_the_reference():
    # 0.3 m and 0.4 m: 0.5 m.
    bench = Bench().drive(0.1)
    bench.odometry(0.2, (0.0, 0.0, 0.0))
    bench.command(0.2, reference=(0.3, 0.4, 0.0))
    assert drives(bench, 0.2)
    bench.command(0.25, reference=(0.3, 0.41, 0.0))
    assert stops(bench, 0.25, "off the reference: 0.508 m (limit 0.5 m)")


@pytest.mark.parametrize("side", [1, -1])
def test_stops_turned_off_the_reference(side):
    bench = Bench().drive(0.1)
    bench.odometry(0.2, (0.0, 0.0, 0.0))
    bench.command(0.2, reference=(0.0, 0.0, 0.8 * side))
    assert drives(bench, 0.2)
    bench.command(0.25, reference=(0.0, 0.0, 0.81 * side))
    assert stops(bench, 0.25, "yaw off the reference: 0.81 rad (limit 0.8 rad)")


@pytest.mark.parametrize("turns", [-2, 0, 1, 3])
def test_whole_turns_are_no_tracking_error(turns):
    bench = Bench().drive(0.1)
    bench.odometry(0.2, (0.0, 0.0, 0.0))
    bench.command(0.2, reference=(0.0, 0.0, 0.7 + 2 * math.pi * turns))
    assert drives(bench, 0.2)


def test_yaw_of_the_odometry_may_cross_pi():
    bench = Bench()
    for k, yaw in enumerate([3.05, 3.13, 3.21 - 2 * math.pi, 3.29 - 2 * math.pi]):
        bench.odometry(0.1 * k, (0.0, 0.0, yaw))
        bench.command(0.1 * k, reference=(0.0, 0.0, 3.05 + 0.08 * k))
        assert drives(bench, 0.1 * k)
    assert bench.output(0.3)[1].rejected == 0


# Stops: frozen odometry.


def freeze(command, until, **config):
    """Drives with the same odometry from 0 to a time."""
    bench = Bench(**config)
    for k in range(round(10 * until) + 1):
        bench.odometry(0.1 * k, (1.0, 2.0, 0.5), (0.0, 0.0, 0.0))
        bench.command(0.1 * k, command, reference=(1.0, 2.0, 0.5))
        bench.output(0.1 * k)
    return bench


def test_stops_at_frozen_odometry_while_the_wheels_push():
    # Pushed since 0, so that the odometry of 0.6 s is the first beyond 0.5 s.
    bench = freeze((40.0, 40.0, 40.0, 40.0), 0.4)
    bench.odometry(0.499, (1.0, 2.0, 0.5))
    bench.command(0.499, reference=(1.0, 2.0, 0.5))
    assert drives(bench, 0.499)
    bench = freeze((40.0, 40.0, 40.0, 40.0), 0.6)
    assert stops(bench, 0.6, "odometry is frozen: 0.6 s (limit 0.5 s)")


@pytest.mark.parametrize(
    "command",
    [
        (39.0, 39.0, 39.0, 39.0),  # Within what friction may hold.
        (0.0, 48.0, 0.0, 48.0),  # Two wheels that were seen not to break away.
        (60.0, 60.0, -60.0, -60.0),  # Against each other.
        (0.0, 0.0, 0.0, 0.0),
    ],
)
def test_a_robot_that_friction_holds_is_not_frozen(command):
    assert freeze(command, 2.0).governor.phase is Phase.DRIVING


def test_a_robot_that_stood_before_the_wheels_pushed_is_not_frozen():
    bench = freeze((10.0, 10.0, 10.0, 10.0), 2.0)
    for k in range(1, 7):
        now = 2.0 + 0.1 * k
        bench.odometry(now, (1.0, 2.0, 0.5))
        assert drives(bench, now)
        bench.command(now, (50.0, 50.0, 50.0, 50.0), reference=(1.0, 2.0, 0.5))
        bench.output(now)
    # Pushed since 2.1 s.
    bench.odometry(2.7, (1.0, 2.0, 0.5))
    assert stops(bench, 2.7, "odometry is frozen: 0.6 s (limit 0.5 s)")


def test_a_push_that_ends_begins_the_freeze_anew():
    bench = Bench()
    for k in range(20):
        bench.odometry(0.1 * k, (1.0, 2.0, 0.5))
        bench.command(0.1 * k, (10.0 if k % 4 == 0 else 60.0,) * 4, reference=(1.0, 2.0, 0.5))
        assert drives(bench, 0.1 * k)


def test_a_robot_that_moves_is_not_frozen():
    bench = Bench()
    for k in range(20):
        bench.odometry(0.1 * k, (1.0 + 0.0001 * k, 2.0, 0.5))
        bench.command(0.1 * k, (60.0,) * 4, reference=(1.0, 2.0, 0.5))
        assert drives(bench, 0.1 * k)
