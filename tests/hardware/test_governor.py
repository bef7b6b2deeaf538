import dataclasses as dc
import math

import numpy as np
import pytest

from mirte_drake.hardware.governor import Governor, Phase
from mirte_drake.hardware.governor_config import GovernorConfig
from mirte_drake.hardware.messages import (
    DriveCommand,
    Odometry,
    OperatorRequest,
    Request,
    WheelCommand,
)
from mirte_drake.hardware.odometry_check import OdometryLimits

CLOCK = 1_700_000_000  # [s] What the robot's clock is ahead of ours.
SESSION, OTHER = 11, 22
DRIVE = (10.0, 10.0, 10.0, 10.0)
STILL = [0, 0, 0, 0]
NAN = math.nan


class Bench:
    """A governor that is looked at every 50 ms unless it stalls, and what happens to it.

    Times [s] are ours.
    """

    def __init__(self, *, start=(0.0, 0.0, 0.0), **config):
        self.governor = Governor(GovernorConfig(**config), np.array(start))
        self.sequence = -1
        self.stamp = 0  # Of the last odometry.
        self.looked = None  # [s] at the governor.
        self.stalls = False

    def look_until(self, now):
        """Looks at the governor up to, but not at, a time."""
        self.looked = now if self.looked is None else self.looked
        while not self.stalls and self.looked + 0.05 < now - 1e-6:
            self.looked += 0.05
            self.governor.output(self.looked)

    def odometry(self, now, pose=None, velocity=(0.0, 0.0, 0.0), *, measured=None):
        """Odometry of a robot that creeps, unless a pose is given."""
        self.look_until(now)
        measured = now if measured is None else measured
        pose = (1e-4 * measured, 0.0, 0.0) if pose is None else pose
        self.stamp = round(1e9 * (CLOCK + measured))
        self.governor.on_odometry(Odometry(self.stamp, np.array(pose), np.array(velocity)), now)

    def command(self, now, command=DRIVE, reference=(0.0, 0.0, 0.0), **fields):
        """The next command of the session, answering the last odometry."""
        self.look_until(now)
        self.sequence = fields.pop("sequence", self.sequence + 1)
        values = {
            "session": SESSION,
            "sequence": self.sequence,
            "command": np.array(command),
            "reference": np.array(reference),
            "odometry_stamp": self.stamp,
            "solve_failed": False,
        }
        self.governor.on_drive_command(DriveCommand(**values | fields), now)

    def output(self, now):
        """What is sent at this moment, and the status."""
        self.look_until(now)
        self.looked = now
        command, status = self.governor.output(now)
        return None if command is None else command.tolist(), status

    def drive(self, seconds=0.1, command=DRIVE):
        """Drives from 0 to a whole number of samples, which ends with an output."""
        for k in range(round(10 * seconds) + 1):
            self.odometry(0.1 * k)
            self.command(0.1 * k, command)
            self.output(0.1 * k)
        assert self.governor.phase is Phase.DRIVING
        return self

    def foreign(self, now, command):
        self.look_until(now)
        self.governor.on_foreign_command(WheelCommand(np.array(command)), now)

    def request(self, now, request):
        self.look_until(now)
        self.governor.on_request(OperatorRequest(request), now)


def stops(bench, now, reason):
    """Whether the next output stops the robot for a reason, and the one after it still does."""
    command, status = bench.output(now)
    assert command == STILL
    assert status.stopped
    assert status.reason == reason
    assert status.command.tolist() == STILL
    again, status = bench.output(now + 10.0)
    return again == STILL and status.reason == reason


def drives(bench, now):
    """Whether all is well at the next output."""
    command, status = bench.output(now)
    return command != STILL and not status.stopped and status.reason == ""


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
