import numpy as np
import pytest

from mirte_drake.checks import check_array, check_choice, check_number


@pytest.mark.parametrize("value", [[1, 2], [1.0, -2.0], np.array([0.0, 1e-300]), (3, 4)])
def test_array_of_finite_numbers_passes(value):
    check_array("a", value, (2,))


@pytest.mark.parametrize(
    ("value", "problem"),
    [
        ([1.0], r"a: must have shape \(2,\), got shape \(1,\)"),
        ([[1.0, 2.0]], r"a: must have shape \(2,\), got shape \(1, 2\)"),
        (1.0, r"a: must have shape"),
        ([1.0, np.nan], "a: must be finite"),
        ([np.inf, 1.0], "a: must be finite"),
        ([1.0, None], "a: must be finite"),
        ([1.0, "x"], "a: must be numbers"),
        ([[1.0], [1.0, 2.0]], "a: must be numbers"),
        ([1.0, -0.1], r"a: every entry must be >= 0, got \[1.0, -0.1\]"),
    ],
)
def test_bad_array_is_named(value, problem):
    with pytest.raises(ValueError, match=problem):
        check_array("a", value, (2,), minimum=0)


def test_array_may_meet_its_minimum():
    check_array("a", [0.0, 1.0], (2,), minimum=0)


def test_number_may_meet_minimum_and_maximum_but_not_above():
    check_number("n", 0, minimum=0, maximum=0)
    with pytest.raises(ValueError, match="n: must be > 0, got 0"):
        check_number("n", 0, above=0)


@pytest.mark.parametrize(
    ("value", "problem"),
    [
        (-1, "n: must be >= 0, got -1"),
        (2.5, "n: must be <= 2, got 2.5"),
        (np.nan, "n: must be a finite number"),
        (np.inf, "n: must be a finite number"),
        (True, "n: must be a finite number, got True"),
        ("1", "n: must be a finite number"),
        (None, "n: must be a finite number"),
        (np.array([1.0]), "n: must be a finite number"),
    ],
)
def test_bad_number_is_named(value, problem):
    with pytest.raises(ValueError, match=problem):
        check_number("n", value, minimum=0, maximum=2)


def test_integer_beyond_all_floats_is_a_bad_value_not_a_crash():
    with pytest.raises(ValueError, match="n: must be"):
        check_number("n", 10**400, maximum=1)


def test_array_entry_beyond_all_floats_is_a_bad_value_not_a_crash():
    with pytest.raises(ValueError, match="a: must be"):
        check_array("a", [10**400], (1,))


def test_choice_lists_what_is_allowed():
    check_choice("c", "left", ("left", "right"))
    for value in ("up", None, ["left"]):
        with pytest.raises(ValueError, match="c: must be one of left, right, got"):
            check_choice("c", value, ("left", "right"))
