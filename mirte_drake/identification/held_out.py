"""How well a fit predicts what it has not seen: blocks of a recording held out in turn."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mirte_drake.identification.recorded_run import RecordedRun
from mirte_drake.model.model_file import Identification

BLOCKS = 8  # Held out in turn.
# [m/s, m/s, rad/s] Errors that count the same: twice what a good model leaves unexplained.
VELOCITY_SCALE = np.array([0.05, 0.03, 0.09])


def held_out_error(
    rows: np.ndarray,
    fit: Callable[[np.ndarray], np.ndarray],
    error: Callable[[np.ndarray], np.ndarray],
    on_fit: Callable[[], None] = lambda: None,
) -> float:
    """Returns the mean square error over samples that had no part in the fit.

    Args:
        rows: (N,) True for the samples to fit or to hold out; the others have no part in either.
        fit: Returns parameters fitted to the rows (N,) that are True.
        error: Returns the errors (N, m) of parameters in all samples.
        on_fit: Called after each of ``BLOCKS`` fits.
    """
    squares = []
    for block in np.array_split(np.flatnonzero(rows), BLOCKS):
        fitted = rows.copy()
        fitted[block] = False
        squares.append(error(fit(fitted))[block] ** 2)
        on_fit()
    return float(np.mean(np.concatenate(squares)))


def identification_record(
    run: RecordedRun,
    date: str,
    structure: object,
    held_out_errors: Mapping[Any, float],
    **settings: str,
) -> Identification:
    """Returns what a file says of a fit whose structure was chosen by held-out samples.

    Args:
        run: The recording that it was fitted to.
        date: ISO date.
        structure: The one that was chosen.
        held_out_errors: Error of each structure.
        settings: More of the fit.
    """
    errors = (f"{structure}: {error:.4f}" for structure, error in held_out_errors.items())
    return Identification(
        source=f"fitted to {run.source}, {len(run.time)} samples",
        data_sha256=run.sha256,
        date=date,
        settings={
            "structure": str(structure),
            "selection": f"{BLOCKS} blocks of the recording held out in turn",
            "held_out_error": ", ".join(errors),
            "velocity_scale": ", ".join(f"{value:g}" for value in VELOCITY_SCALE),
            **settings,
        },
    )


def held_out_text(structure: object, held_out_errors: Mapping[Any, float]) -> str:
    """Returns the held-out errors as a table; a star marks the structure that was taken."""
    width = max(len(str(each)) for each in held_out_errors)
    lines = [f"{'structure':{width}}{'held-out error':>16}"]
    for each, error in held_out_errors.items():
        star = " *" if each == structure else ""
        lines.append(f"{each!s:{width}}{error:16.4f}{star}")
    return "\n".join(lines)
