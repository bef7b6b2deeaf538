import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mirte_drake.identification.sparse_regression import (
    StlsqConfig,
    ThresholdRow,
    best_threshold,
    stlsq,
    threshold_table,
)

EXACT = StlsqConfig(ridge=1e-14)


def problem(seed=0, samples=200, terms=8):
    rng = np.random.default_rng(seed)
    return rng, rng.normal(size=(samples, terms)) * 10.0 ** rng.integers(-2, 3, terms)


@given(seed=st.integers(0, 10_000))
def test_sparse_coefficients_are_recovered(seed):
    rng, Theta = problem(seed)
    xi = np.where(rng.uniform(size=8) < 0.4, rng.uniform(0.5, 2.0, 8), 0.0)
    np.testing.assert_allclose(stlsq(Theta, Theta @ xi, 0.1, EXACT), xi, atol=1e-8)


def test_no_threshold_gives_ridge_regression_on_unit_columns():
    rng, Theta = problem()
    y = rng.normal(size=200)
    norms = np.linalg.norm(Theta, axis=0)
    unit = Theta / norms
    expected = np.linalg.solve(unit.T @ unit + 0.1 * np.eye(8), unit.T @ y) / norms
    np.testing.assert_allclose(stlsq(Theta, y, 0.0, StlsqConfig(ridge=0.1)), expected, rtol=1e-10)


def test_the_threshold_looks_at_raw_coefficients():
    """A large column with a small coefficient matters much, and is dropped all the same."""
    rng, _ = problem()
    Theta = np.column_stack([1000 * rng.normal(size=200), rng.normal(size=200)])
    xi = stlsq(Theta, Theta @ [0.01, 0.5], 0.1, EXACT)
    assert xi[0] == 0.0 and xi[1] != 0.0


def test_survivors_are_fitted_anew():
    rng, Theta = problem(terms=3)
    Theta[:, 1] = Theta[:, 0] + 0.3 * np.abs(Theta[:, 0]).max() * rng.normal(size=200)
    y = Theta @ [1.0, 0.05, 2.0]
    xi = stlsq(Theta, y, 0.1, EXACT)
    kept, *_ = np.linalg.lstsq(Theta[:, [0, 2]], y, rcond=None)
    np.testing.assert_allclose(xi[[0, 2]], kept, rtol=1e-8)


def test_a_threshold_above_all_leaves_nothing():
    _, Theta = problem()
    assert not stlsq(Theta, Theta @ np.ones(8), 1e9).any()


@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf])
def test_a_useless_column_is_named(bad):
    _, Theta = problem()
    Theta[:, 3] = bad
    with pytest.raises(ValueError, match=r"term 3 is zero|must be finite"):
        stlsq(Theta, np.ones(200), 0.1)


def test_the_table_counts_terms_and_errors():
    _, Theta = problem()
    xi = np.array([1.0, 0.1, 0.01, 0, 0, 0, 0, 0])
    rows = threshold_table(Theta, Theta @ xi, np.array([1e-3, 0.05, 0.5]), EXACT)
    assert [row.terms for row in rows] == [3, 2, 1]
    assert rows[0].training_error < 1e-9 < rows[1].training_error < rows[2].training_error
    assert rows[0].held_out_error < 1e-9


def test_the_best_row_has_the_least_error_and_then_the_fewest_terms():
    rows = [
        ThresholdRow(1e-5, 9, 0.10, 0.30),
        ThresholdRow(1e-4, 5, 0.11, 0.20),
        ThresholdRow(2e-4, 4, 0.11, 0.20),
        ThresholdRow(3e-4, 4, 0.12, 0.20),
    ]
    assert best_threshold(rows, "training") is rows[0]
    assert best_threshold(rows, "held_out") is rows[3]
    with pytest.raises(ValueError, match="criterion"):
        best_threshold(rows, "beauty")
