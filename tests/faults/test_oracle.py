import dataclasses as dc

import numpy as np
import pytest
from fault_records import DRIVING, END, FAULT, STILL, command, drive, every, odometry, stopped

from mirte_drake.faults.oracle import (
    act_number,
    at_fault,
    frozen_odometry,
    last_good_odometry,
    last_heartbeat,
    off_reference,
    outside,
    push,
    swapped_odometry,
)
from mirte_drake.hardware import wheel_limits

PUSHING = np.full(4, 45.0)


def without(*times):
    """Odometry at 10 Hz but for some messages."""
    return [odometry(t) for t in every(0.1, -0.5, END) if not np.any(np.isclose(t, times))]


def test_sound_odometry_makes_no_stop_due():
    expected = last_good_odometry(drive())
    assert not expected.due and not expected.allowed


def test_one_that_is_missing_makes_none_due():
    expected = last_good_odometry(drive(odometry=without(1.1)))
    assert not expected.due and not expected.allowed


def test_two_that_are_missing_make_one_due_from_the_last_good_one():
    assert last_good_odometry(drive(odometry=without(1.1, 1.2))).since == pytest.approx(1.0)


def test_at_the_end_too():
    assert last_good_odometry(stopped(1.13)).since == pytest.approx(0.9)


@pytest.mark.parametrize(
    ("late", "due", "allowed"), [(0.02, False, False), (0.04, False, True), (0.06, True, False)]
)
def test_how_late_the_next_one_may_be(late, due, allowed):
    sound = without(1.1, 1.2)
    odometries = sorted([*sound, odometry(1.2, late=late)], key=lambda sent: sent.sent)
    expected = last_good_odometry(drive(odometry=odometries))
    assert (expected.due, expected.allowed) == (due, allowed)


def test_what_counts_is_when_it_was_measured():
    """Each message is 0.2 s late: between two of them odometry gets 0.3 s old."""
    late = [odometry(t, late=0.2) for t in every(0.1, 1.0, 2.0)]
    record = drive(odometry=[odometry(t) for t in every(0.1, -0.5, 0.9)] + late)
    assert last_good_odometry(record).since == pytest.approx(0.9)


def test_bad_odometry_does_not_count():
    sound = [dc.replace(sent, good=sent.measured < 1.05) for sent in drive().odometry]
    assert last_good_odometry(drive(odometry=sound)).since == pytest.approx(1.0)


def test_odometry_from_before_the_drive_does_not_count():
    assert not last_good_odometry(drive(odometry=without(-0.4, -0.3, -0.2))).due


def test_older_odometry_after_newer_does_not_count():
    record = drive(odometry=without(1.1, 1.2))
    record.odometry.append(odometry(0.95, late=0.2))
    record.odometry.sort(key=lambda sent: sent.sent)
    assert last_good_odometry(record).since == pytest.approx(1.0)


def test_a_command_that_answers_the_older_of_two_allows_a_stop():
    odometries = [odometry(t) for t in every(0.1, -0.5, 1.0)]
    for t in (1.2, 1.4, 1.6, 1.8, 2.0, 2.2):
        odometries += [odometry(t), odometry(t - 0.1, late=0.102, good=False)]
    record = drive(odometry=odometries, commands=[command(t) for t in every(0.12, 0.0, END)])
    assert not last_good_odometry(record).allowed
    assert swapped_odometry(record).allowed
    assert not swapped_odometry(drive()).allowed


def test_from_the_fault():
    assert at_fault(drive()).since == FAULT


def test_from_the_last_command_before_the_controller_fell_silent():
    assert last_heartbeat(drive(acted=[0.95])).since == pytest.approx(0.9)
    assert last_heartbeat(drive(fault=1.05)).since == pytest.approx(1.0)


def test_from_an_act_of_sabotage():
    record = drive(acted=[1.0, 1.1, 1.2])
    assert act_number(3)(record).since == 1.2
    assert not act_number(4)(record).due


def frozen(commands, at=1.0):
    odometries = [odometry(t, pose=[0.1 * min(t, at), 0, 0]) for t in every(0.1, -0.5, END)]
    return drive(odometry=odometries, commands=commands)


def test_frozen_odometry_is_due_half_a_second_after_the_wheels_push():
    pushing = [command(t, DRIVING if t < 1.35 else PUSHING) for t in every(0.1, 0.0, END)]
    assert frozen_odometry(frozen(pushing)).since == pytest.approx(1.9)


def test_frozen_odometry_is_due_half_a_second_after_it_froze():
    pushing = [command(t, PUSHING) for t in every(0.1, 0.0, END)]
    # The last message before the fault is the first of those that are the same.
    assert frozen_odometry(frozen(pushing)).since == pytest.approx(1.501)


def test_wheels_that_do_not_push_for_long_enough_make_no_stop_due():
    pushing = [command(t, PUSHING if t < 1.45 else STILL) for t in every(0.1, 0.0, END)]
    assert not frozen_odometry(frozen(pushing)).due
    assert not frozen_odometry(frozen(drive().commands)).due
    assert not frozen_odometry(drive(commands=[command(t, PUSHING) for t in (0.0, 1.0)])).due


def test_outside():
    assert outside(0.123)(drive()).since == pytest.approx(1.301)
    assert outside(0.128)(drive()).since == pytest.approx(1.301)
    assert not outside(0.5)(drive()).due
    # At 0.22 m it ends, within an error of measuring of the edge.
    assert outside(0.219)(drive()).allowed


def test_off_the_reference():
    poses = np.column_stack([0.01 * np.arange(30), np.zeros((30, 2))])
    oracle = off_reference(poses, 0.1)
    assert not oracle(drive()).due and not oracle(drive()).allowed
    pushed = [odometry(t, pose=[0.1 * t, max(t - 0.95, 0.0), 0]) for t in every(0.1, -0.5, END)]
    assert oracle(drive(odometry=pushed)).since == pytest.approx(1.501)
    nearly = [odometry(t, pose=[0.1 * t, min(max(t - 1.0, 0), 0.49), 0]) for t in every(0.1, 0, 2)]
    assert oracle(drive(odometry=nearly)).allowed


def test_pushing_is_what_it_is_to_the_governor():
    rng = np.random.default_rng(0)
    for wheels in rng.uniform(-100, 100, (20, 4)):
        assert push(wheels) == pytest.approx(wheel_limits.push(wheels))
