import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mirte_drake.hardware.wheel_limits import limit_command, push

WHEEL = st.integers(-100, 100)
ANY = st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=4, max_size=4)


def limited(wanted, last=(0, 0, 0, 0), *, step=1000.0, limit=100.0) -> list[int]:
    return limit_command(np.array(wanted), np.array(last), step, limit).tolist()


def test_rounds_to_the_nearest_whole_number():
    assert limited([12.4, -12.6, 0.4, -0.4]) == [12, -13, 0, 0]


def test_holds_the_command_limit():
    assert limited([120.0, -250.0, 1e308, -1e308]) == [100, -100, 100, -100]
    assert limited([50.0, -50.0, 40.0, 39.0], limit=40.9) == [40, -40, 40, 39]


def test_holds_the_slew_limit_of_each_wheel():
    assert limited([30.0, -30.0, 12.0, 0.0], [10, 10, 10, 10], step=15.9) == [25, -5, 12, 0]


def test_changes_nothing_in_no_time():
    assert limited([30.0, 0.0, -30.0, 7.0], [10, 10, 10, 7], step=0.0) == [10, 10, 10, 7]


def test_may_stop_all_wheels_at_once():
    assert limited([0.0, 0.0, 0.0, 0.0], [100, -100, 50, 3], step=1.0) == [0, 0, 0, 0]
    assert limited([0.3, -0.4, 0.0, 0.5], [100, -100, 50, 3], step=1.0) == [0, 0, 0, 0]


@given(wanted=ANY, last=st.tuples(WHEEL, WHEEL, WHEEL, WHEEL), step=st.floats(0.0, 300.0))
def test_whole_numbers_within_both_limits(wanted, last, step):
    result = limit_command(np.array(wanted), np.array(last), step, 100.0)
    assert result.dtype == int
    assert np.all(np.abs(result) <= 100)
    assert not result.any() or np.all(np.abs(result - last) <= step)


@pytest.mark.parametrize(
    ("command", "pushes"),
    [
        ([40, 40, 40, 40], 40.0),
        ([-40, 40, -40, 40], 40.0),  # To the left.
        ([-40, 40, 40, -40], 40.0),  # Turning.
        ([40, 40, -40, -40], 0.0),  # Front against rear.
        ([0, 48, 0, 48], 48 / 2**0.5),  # Two wheels, diagonally: 34.
        ([50, 30, 10, 30], 1000**0.5),  # Forward 30, turning -10; against each other 10.
        ([0, 0, 0, 0], 0.0),
    ],
)
def test_push_counts_what_wheels_do_together(command, pushes):
    assert push(np.array(command)) == pytest.approx(pushes, abs=0.01)
