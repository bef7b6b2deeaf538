import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mirte_drake.hardware.messages import Odometry
from mirte_drake.hardware.odometry_check import OdometryLimits, check

LIMITS = OdometryLimits()
CLOCK = 1_700_000_000_000_000_000  # [ns] The robot's clock where ours shows 100 s.


def odometry(time, pose=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0), *, late=0.0, step=0.0):
    """Measured at ``time`` [s] after our 100 s, by a clock that has stepped, and late."""
    return Odometry(
        stamp=CLOCK + round(1e9 * (time + step)),
        pose=np.array(pose),
        body_velocity=np.array(velocity),
        arrival=100.0 + time + late,
    )


def track_of(*messages, limits=LIMITS):
    """The track of messages that must all be accepted."""
    track = None
    for message in messages:
        track, reason = check(track, message, limits)
        assert reason is None
    return track


def rejection(message, *before):
    """Why a message is rejected after others, then leaving the track as it was; or None."""
    track = track_of(*before)
    after, reason = check(track, message, LIMITS)
    assert (after is track) == (reason is not None)
    return reason


# What is accepted.


def test_the_first_message_is_accepted_as_it_is():
    track = track_of(odometry(0.0, (1.0, -2.0, 3.0), (0.1, 0.2, 0.3)))
    assert track.last.pose.tolist() == [1.0, -2.0, 3.0]
    assert track.last.body_velocity.tolist() == [0.1, 0.2, 0.3]
    assert track.age(100.0) == 0.0


def test_a_track_keeps_its_values_when_the_message_changes():
    message = odometry(0.0)
    track = track_of(message)
    message.pose[:] = 7.0
    assert track.last.pose.tolist() == [0.0, 0.0, 0.0]


def test_full_speed_is_no_jump():
    # 0.96 m/s and 4.3 rad/s, what the wheels make at 100 pwm.
    messages = [odometry(0.1 * k, (0.096 * k, 0.0, 0.43 * k), (0.96, 0.0, 4.3)) for k in range(30)]
    assert track_of(*messages).last.pose[0] == pytest.approx(0.096 * 29)


def test_yaw_across_pi_is_no_jump_and_is_unwrapped():
    yaws = [3.0, 3.1, -3.08, -2.98, -3.08, 3.1]
    messages = [odometry(0.1 * k, (0.0, 0.0, yaw)) for k, yaw in enumerate(yaws)]
    got = [track_of(*messages[: k + 1]).last.pose[2] for k in range(len(yaws))]
    assert got == pytest.approx(
        [3.0, 3.1, 2 * math.pi - 3.08, 2 * math.pi - 2.98, 3.2032, 3.1], abs=1e-4
    )


def test_a_robot_may_move_further_between_messages_that_were_lost():
    # 1.5 m/s times 0.4 s and the encoders' 0.02 s: 0.63 m.
    before = odometry(0.0)
    assert rejection(odometry(0.4, (0.62, 0.0, 0.0)), before) is None
    reason = rejection(odometry(0.4, (0.64, 0.0, 0.0)), before)
    assert reason == "jump of 0.64 m in 0.420 s (limit 1.5 m/s)"


# What is rejected.


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("entry", [0, 1, 2])
def test_rejects_what_is_not_finite(bad, entry):
    values = [0.0, 0.0, 0.0]
    values[entry] = bad
    assert rejection(odometry(0.1, pose=values)).startswith("pose: must be finite")
    assert rejection(odometry(0.1, velocity=values)).startswith("body_velocity: must be finite")


@pytest.mark.parametrize(
    "value", [[0.0, 0.0], [[0.0, 0.0, 0.0]], 0.0, [], None, ["a", "b", "c"], [10**400, 0, 0]]
)
def test_rejects_wrong_shapes_and_types(value):
    good = odometry(0.0)
    for name in ("pose", "body_velocity"):
        message = Odometry(**{**vars(good), name: value})
        assert rejection(message).startswith(f"{name}: must ")


def test_rejects_what_is_no_stamp():
    # The last number has more digits than Python prints.
    for stamp in (-1, 2**63, 10**400, None, "1", math.nan, True, 10**5000):
        assert rejection(Odometry(stamp, np.zeros(3), np.zeros(3), 100.0))


@pytest.mark.parametrize("entry", [0, 1, 2])
def test_rejects_coordinates_beyond_the_limit(entry):
    pose = np.zeros(3)
    pose[entry] = -1e4
    assert rejection(odometry(0.0, pose)) is None
    pose[entry] = -1.001e4
    assert rejection(odometry(0.0, pose)) == "pose: 1.001e+04 is out of range (limit 10000)"


def test_rejects_speeds_beyond_the_limit():
    assert rejection(odometry(0.0, velocity=(0.9, 1.2, 0.0))) is None  # 1.5 m/s
    reason = rejection(odometry(0.0, velocity=(0.9, -1.21, 0.0)))
    assert reason == "speed: 1.508 m/s is out of range (limit 1.5 m/s)"


def test_rejects_yaw_rates_beyond_the_limit():
    assert rejection(odometry(0.0, velocity=(0.0, 0.0, -6.0))) is None
    reason = rejection(odometry(0.0, velocity=(0.0, 0.0, -6.01)))
    assert reason == "yaw rate: 6.01 rad/s is out of range (limit 6 rad/s)"


def test_rejects_a_message_that_came_before():
    first = odometry(0.0)
    assert rejection(first, first) == "stamp: came before"
    changed = odometry(0.0, (0.01, 0.0, 0.0), late=0.05)
    assert rejection(changed, first) == "stamp: came before"


def test_rejects_a_message_out_of_order():
    late = odometry(0.1, late=0.15)
    assert (
        rejection(late, odometry(0.0), odometry(0.2)) == "stamp: 0.100 s older than the last one's"
    )


def test_rejects_a_jump_of_the_position():
    before = odometry(0.0, (1.0, 1.0, 0.0))
    # 1.5 m/s times 0.1 s and the encoders' 0.02 s: 0.18 m.
    assert rejection(odometry(0.1, (1.0, 1.179, 0.0)), before) is None
    reason = rejection(odometry(0.1, (1.0, 1.181, 0.0)), before)
    assert reason == "jump of 0.181 m in 0.120 s (limit 1.5 m/s)"


def test_what_makes_no_sense_leaves_the_track_as_it_is():
    assert rejection(odometry(0.1, (math.nan, 0.0, 0.0)), odometry(0.0)).startswith("pose: ")
    assert rejection(odometry(0.1, (2e4, 0.0, 0.0)), odometry(0.0)).startswith("pose: ")


def test_the_stamps_say_how_long_the_robot_had():
    # A clock that steps back by 0.06 s leaves 0.04 s, and the encoders' 0.02 s.
    reason = rejection(odometry(0.1, (0.1, 0.0, 0.0), step=-0.06), odometry(0.0))
    assert reason == "jump of 0.1 m in 0.060 s (limit 1.5 m/s)"


def test_rejects_a_jump_of_the_yaw():
    before = odometry(0.0, (0.0, 0.0, 3.0))
    # 6 rad/s times 0.12 s: 0.72 rad, across pi.
    wrapped = 3.0 - 2 * math.pi
    assert rejection(odometry(0.1, (0.0, 0.0, wrapped + 0.719)), before) is None
    reason = rejection(odometry(0.1, (0.0, 0.0, wrapped + 0.721)), before)
    assert reason == "jump of 0.721 rad in 0.120 s (limit 6 rad/s)"
    reason = rejection(odometry(0.1, (0.0, 0.0, 3.0 - 0.721)), before)
    assert reason == "jump of 0.721 rad in 0.120 s (limit 6 rad/s)"


# Age and clocks.


def test_age_counts_from_the_arrival_of_the_fastest_message():
    track = track_of(odometry(0.0), odometry(0.1, late=0.03))
    assert track.age(100.13) == pytest.approx(0.03, abs=1e-6)
    assert track.age(100.2) == pytest.approx(0.1, abs=1e-6)


def test_age_of_another_stamp():
    first, second = odometry(0.0), odometry(0.1)
    track = track_of(first, second)
    assert track.age(100.15, first.stamp) == pytest.approx(0.15, abs=1e-6)
    assert track.age(100.15, second.stamp) == pytest.approx(0.05, abs=1e-6)
    assert track.age(100.15, odometry(0.2).stamp) == pytest.approx(-0.05, abs=1e-6)


def test_a_late_first_message_is_found_out_by_the_next():
    track = track_of(odometry(0.0, late=0.3), odometry(0.25, late=0.06), odometry(0.3, late=0.04))
    assert track.age(100.34) == 0.0  # Nothing faster was seen.
    track, _ = check(track, odometry(0.4), LIMITS)
    track, _ = check(track, odometry(0.5, late=0.1), LIMITS)
    assert track.age(100.6) == pytest.approx(0.1, abs=1e-6)


def test_a_delay_that_lasts_is_seen_until_the_window_has_forgotten():
    limits = OdometryLimits(window=5)
    track = track_of(odometry(0.0), limits=limits)
    for k in range(1, 5):
        track, _ = check(track, odometry(0.1 * k, late=0.2), limits)
        assert track.age(track.last.arrival) == pytest.approx(0.2, abs=1e-6)
    track, _ = check(track, odometry(0.5, late=0.2), limits)
    assert track.age(track.last.arrival) == pytest.approx(0.0, abs=1e-6)


def test_a_burst_after_a_delay_is_no_jump():
    # 0.45 m/s; three messages come at the same time.
    messages = [
        odometry(t, (0.45 * t, 0.0, 0.0), late=late)
        for t, late in [(0.0, 0.0), (0.1, 0.2), (0.2, 0.1), (0.3, 0.0)]
    ]
    assert track_of(*messages).age(100.3) == 0.0


def test_a_clock_that_steps_forward_is_survived():
    track = track_of(odometry(0.0), odometry(0.1), odometry(0.2, step=3600.0))
    assert track.age(100.25) == pytest.approx(0.05, abs=1e-6)
    track, _ = check(track, odometry(0.3, step=3600.0, late=0.07), LIMITS)
    assert track.age(100.4) == pytest.approx(0.1, abs=1e-6)


def test_a_clock_that_steps_forward_lets_no_jump_in():
    reason = rejection(odometry(0.1, (0.5, 0.0, 0.0), step=3600.0), odometry(0.0))
    assert reason == "jump of 0.5 m in 0.120 s (limit 1.5 m/s)"


def test_a_clock_that_steps_back_a_little_makes_odometry_older():
    track = track_of(odometry(0.0), odometry(0.1), odometry(0.2, step=-0.06))
    assert track.age(100.2) == pytest.approx(0.06, abs=1e-6)


def test_a_clock_that_steps_back_is_out_of_order_until_the_track_begins_anew():
    track = track_of(odometry(0.0), odometry(0.1))
    for k in range(2, 12):  # Up to 1.0 s after the last one that was accepted.
        before = track
        track, reason = check(track, odometry(0.1 * k, step=-50.0), LIMITS)
        assert reason.endswith("s older than the last one's")
        assert track is before
    track, reason = check(track, odometry(1.2, (5.0, 5.0, 1.0), step=-50.0), LIMITS)
    assert reason is None
    assert track.age(101.2) == 0.0
    assert len(track.delays) == 1


def test_an_impossible_message_does_not_begin_a_track_anew():
    track = track_of(odometry(0.0))
    after, reason = check(track, odometry(5.0, velocity=(9.0, 0.0, 0.0)), LIMITS)
    assert reason == "speed: 9 m/s is out of range (limit 1.5 m/s)"
    assert after is track


@given(
    st.lists(
        st.tuples(st.floats(0.001, 0.5), st.floats(0.0, 0.4), st.floats(-0.2, 0.2)), max_size=60
    )
)
def test_age_is_never_less_than_the_time_since_arrival(steps):
    """Whatever the delays and the steps of the robot's clock."""
    track, time, clock = None, 0.0, 0.0
    arrival = 0.0
    for step, late, jump in steps:
        time += step
        clock += jump
        arrival = max(arrival, time + late)
        message = odometry(time, step=clock)
        message = Odometry(message.stamp, message.pose, message.body_velocity, 100.0 + arrival)
        track, _ = check(track, message, LIMITS)
        assert track.age(100.0 + arrival) >= 100.0 + arrival - track.last.arrival
        assert track.age(101.0 + arrival) >= 101.0 + arrival - track.last.arrival
        assert len(track.delays) <= LIMITS.window


# Freezing.


def test_values_that_stay_the_same_are_counted_from_their_first_arrival():
    pose, velocity = (1.0, 2.0, -3.0), (0.3, 0.0, 0.1)
    messages = [odometry(0.1 * k, pose, velocity) for k in range(5)]
    assert track_of(odometry(-0.1, pose), *messages).unchanged_since == 100.0


@pytest.mark.parametrize("changed", ["pose", "velocity"])
def test_a_change_of_pose_or_velocity_is_no_freeze(changed):
    first = odometry(0.0, (0.0, 0.0, 0.0), (0.3, 0.0, 0.0))
    tiny = (1e-9, 0.0, 0.0)
    second = (
        odometry(0.1, tiny, (0.3, 0.0, 0.0))
        if changed == "pose"
        else odometry(0.1, (0.0, 0.0, 0.0), (0.3, 0.0, 1e-9))
    )
    assert track_of(first, second).unchanged_since == 100.1


def test_a_yaw_that_was_unwrapped_can_freeze():
    yaws = [3.1, -3.1, -3.1, -3.1]
    messages = [odometry(0.1 * k, (0.0, 0.0, yaw)) for k, yaw in enumerate(yaws)]
    assert track_of(*messages).unchanged_since == 100.1


# Limits.


@pytest.mark.parametrize(
    "bad",
    [
        {"max_coordinate": 0.0},
        {"max_speed": -1.0},
        {"max_yaw_rate": math.nan},
        {"tick_age": -0.01},
        {"window": 0},
        {"restart_after": math.inf},
    ],
)
def test_rejects_bad_limits(bad):
    with pytest.raises(ValueError, match=rf"^{next(iter(bad))}: "):
        OdometryLimits(**bad).validate()
