import numpy as np
import pytest

from mirte_drake.identification.held_out import BLOCKS, held_out_error


def test_each_sample_is_judged_by_a_fit_that_has_not_seen_it():
    values = np.arange(80.0)
    rows = values > 0  # The first has no part in anything.
    seen = []

    def fit(fitted):
        seen.append(fitted.copy())
        return np.mean(values[fitted])

    calls = []
    error = held_out_error(
        rows, fit, lambda mean: (values - mean)[:, None], lambda: calls.append(1)
    )
    assert len(seen) == len(calls) == BLOCKS
    held_out = np.array([rows & ~fitted for fitted in seen])
    np.testing.assert_array_equal(held_out.sum(axis=0), rows)
    expected = [
        (values[out] - np.mean(values[fitted])) ** 2
        for out, fitted in zip(held_out, seen, strict=True)
    ]
    assert error == pytest.approx(np.mean(np.concatenate(expected)))
