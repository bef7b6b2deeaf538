"""Sparse regression: sequentially thresholded least squares (STLSQ), (3-3)."""

import dataclasses as dc

import numpy as np


@dc.dataclass
class StlsqConfig:
    """Settings of STLSQ; the defaults are the published programs'."""

    ridge: float = 1e-5  # lambda_r, on the columns scaled to unit norm.
    max_iterations: int = 10
    tolerance: float = 1e-8  # Largest change of the coefficients (2-norm) that ends it.


def stlsq(
    Theta: np.ndarray, y: np.ndarray, threshold: float, config: StlsqConfig | None = None
) -> np.ndarray:
    """Returns sparse coefficients xi with y close to Theta xi.

    Columns are scaled to unit norm for the ridge regression, but the threshold is compared with
    the coefficients of the columns as they are (as the published programs do).

    Args:
        Theta: (N, L) candidate terms, a column each.
        y: (N,) derivative.
        threshold: lambda_k: smaller coefficients become zero.
        config: Settings.

    Returns:
        (L,) coefficients.

    Raises:
        ValueError: when a column is zero or not finite.
    """
    config = config or StlsqConfig()
    norms = np.linalg.norm(Theta, axis=0)
    if not (np.all(np.isfinite(Theta)) and np.all(np.isfinite(y))):
        raise ValueError("STLSQ: candidate terms and derivative must be finite")
    if np.any(norms == 0):
        raise ValueError(f"STLSQ: candidate term {int(np.argmin(norms))} is zero in all samples")
    xi = _ridge(Theta / norms, y, config.ridge) / norms
    for _ in range(config.max_iterations):
        active = np.abs(xi) >= threshold
        refitted = np.zeros_like(xi)
        if active.any():
            columns = Theta[:, active] / norms[active]
            refitted[active] = _ridge(columns, y, config.ridge) / norms[active]
        change = np.linalg.norm(refitted - xi)
        xi = refitted
        if change < config.tolerance:
            break
    return xi


def _ridge(Theta: np.ndarray, y: np.ndarray, ridge: float) -> np.ndarray:
    gram = Theta.T @ Theta + ridge * np.eye(Theta.shape[1])
    return np.linalg.solve(gram, Theta.T @ y)


@dc.dataclass(frozen=True)
class ThresholdRow:
    """One line of the error table of a threshold search."""

    threshold: float  # lambda_k
    terms: int  # Terms left.
    training_error: float  # RMSE of the derivative on the samples fitted.
    held_out_error: float  # The same on samples not fitted.


def threshold_table(
    Theta: np.ndarray,
    y: np.ndarray,
    thresholds: np.ndarray,
    config: StlsqConfig | None = None,
    held_out: float = 0.25,
) -> list[ThresholdRow]:
    """Returns how the errors grow with the threshold, for one state derivative (section 3-3).

    The equations of the states share no unknown, so the search over R^3 is three searches.

    Args:
        Theta: (N, L) candidate terms.
        y: (N,) derivative.
        thresholds: Values to try.
        config: Settings of STLSQ.
        held_out: Share of samples, the last of the run, that are not fitted.
    """
    split = round(len(y) * (1 - held_out))
    rows = []
    for threshold in thresholds:
        xi = stlsq(Theta[:split], y[:split], threshold, config)
        error = y - Theta @ xi
        training, rest = (float(np.sqrt(np.mean(e**2))) for e in np.split(error, [split]))
        rows.append(ThresholdRow(float(threshold), int(np.count_nonzero(xi)), training, rest))
    return rows


def best_threshold(rows: list[ThresholdRow], criterion: str = "held_out") -> ThresholdRow:
    """Returns the row of least error, of equals the sparsest.

    Args:
        rows: A table.
        criterion: "training": least error on the samples fitted, as the thesis selects (it
            favours many terms); "held_out": least error on the others.

    Raises:
        ValueError: for an unknown criterion.
    """
    if criterion not in ("training", "held_out"):
        raise ValueError(f"criterion: must be training or held_out, got {criterion!r}")
    errors = {id(row): getattr(row, f"{criterion}_error") for row in rows}
    return min(rows, key=lambda row: (round(errors[id(row)], 9), row.terms, -row.threshold))
