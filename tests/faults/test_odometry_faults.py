import numpy as np
import pytest

from mirte_drake.faults import odometry_faults as faults
from mirte_drake.faults.injector import Passing
from mirte_drake.hardware.messages import Odometry

NOW = Odometry(5_000_000_000, np.array([1.0, 2.0, 0.3]), np.array([0.1, 0.2, 0.3]))
PREVIOUS = Odometry(4_900_000_000, np.array([0.9, 2.0, 0.3]), np.array([0.1, 0.2, 0.3]))
BEFORE = Odometry(4_000_000_000, np.array([0.5, 2.0, 0.3]), np.array([0.1, 0.2, 0.3]))


def passing(number=0, seed=0, sign=1):
    direction = np.array([0.6, 0.8])
    return Passing(NOW, number, BEFORE, PREVIOUS, direction, sign, np.random.default_rng(seed))


def only(sendings):
    (sending,) = sendings
    return sending


def test_silence_sends_nothing():
    assert faults.silent(passing()) == []


def test_frozen_odometry_has_new_stamps_and_old_values():
    sending = only(faults.frozen(passing(3)))
    assert sending.message.stamp == NOW.stamp and sending.good
    np.testing.assert_array_equal(sending.message.pose, BEFORE.pose)


def test_a_repeated_message_is_the_last_one_before_the_fault():
    sending = only(faults.repeated(passing(3)))
    assert sending.message is BEFORE and not sending.good


def test_a_jump_is_half_a_metre_and_leaves_the_yaw():
    sending = only(faults.jumping(passing()))
    np.testing.assert_allclose(sending.message.pose, [1.3, 2.4, 0.3])
    assert not sending.good


@pytest.mark.parametrize(
    ("fault", "is_bad"),
    [
        (faults.not_a_number, np.isnan),
        (faults.infinite, np.isinf),
        (faults.huge, lambda values: np.abs(values) > 1e6),
    ],
)
def test_one_entry_is_bad_and_every_one_but_yaw_has_its_turn(fault, is_bad):
    met = set()
    for seed in range(50):
        sending = only(fault(passing(seed=seed)))
        values = np.array([*sending.message.pose, *sending.message.body_velocity])
        (entry,) = np.flatnonzero(is_bad(values))
        met.add(entry)
        assert not sending.good
    assert met == {0, 1, 3, 4, 5}
    assert np.all(np.isfinite(NOW.pose))  # What the robot measured is left alone.


def test_pairs_are_swapped():
    assert faults.swapped(passing(0)) == []
    later, earlier = faults.swapped(passing(1))
    assert (later.message, earlier.message) == (NOW, PREVIOUS)
    assert later.good and not earlier.good
    assert earlier.origin is PREVIOUS


@pytest.mark.parametrize(
    ("fault", "step", "good"),
    [
        (faults.old_stamps, -10.0, False),
        (faults.clock_steps_by(3600.0), 3600.0, True),
        (faults.clock_steps_by(-3600.0), -3600.0, False),
        (faults.clock_steps_by(0.05), 0.05, True),
    ],
)
def test_stamps_are_off(fault, step, good):
    sending = only(fault(passing()))
    assert sending.message.stamp - NOW.stamp == round(1e9 * step)
    assert sending.good is good


def test_a_clock_steps_either_way():
    fault = faults.clock_steps_by(0.05, either_way=True)
    assert only(fault(passing(sign=-1))).message.stamp - NOW.stamp == -50_000_000


def test_delays_are_drawn_from_their_range():
    fault = faults.late_by(0.1, 0.5)
    delays = np.array([only(fault(passing(seed=seed))).delay for seed in range(200)])
    assert np.all((delays >= 0.1) & (delays <= 0.5))
    assert np.ptp(delays) > 0.35


def test_half_are_lost():
    fault = faults.lost(0.5)
    kept = [len(fault(passing(seed=seed))) for seed in range(200)]
    assert 70 < sum(kept) < 130


def test_doubled_odometry_is_the_same_twice():
    first, second = faults.doubled(passing())
    assert first.message is NOW and second.message is not NOW
    assert second.message.stamp == NOW.stamp and second.good


def test_once_meets_the_first_alone():
    fault = faults.once(faults.silent)
    assert fault(passing(0)) == []
    assert only(fault(passing(1))).message is NOW


def test_a_turned_frame_has_its_yaw_at_pi():
    pose = only(faults.turned(passing())).message.pose
    np.testing.assert_allclose(pose, [-1.0, -2.0, 0.3 - np.pi], atol=1e-12)


def test_a_push_grows_from_the_last_message_before_the_fault():
    pose = only(faults.pushed(passing())).message.pose
    np.testing.assert_allclose(pose, [1.72, 2.96, 0.3])  # 1.2 m/s for 1 s.
