"""Sets of prediction errors with a stated coverage: split conformal and adaptive conformal.

Errors are given as scores, how many times as large as the set's shape they are; a set is a scale.
"""

import dataclasses as dc
from typing import NamedTuple

import numpy as np

from mirte_drake.checks import check_number

ROUNDING = 1e-9  # Of (n + 1) level, which may be meant to be a whole number.


def conformal_rank(n: int, level: float) -> int:
    """Returns ceil((n + 1) level): the place, from 1, of the conformal quantile of n scores.

    A further score that is exchangeable with them is at most the score of that rank with
    probability >= level, whatever the distribution. A rank above n means that they are too few.
    """
    return int(np.ceil((n + 1) * level - ROUNDING))


def box_scores(errors: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Returns the scores (...): by which factor a box must grow to hold each error.

    Args:
        errors: (..., m)
        shape: (m,) half-widths of the box, > 0.
    """
    return np.max(np.abs(errors) / shape, axis=-1)


@dc.dataclass(frozen=True)
class AdaptiveConformal:
    """Settings of ``adapt``."""

    target: float = 0.9  # Share of errors that the set shall hold.
    gain: float = 0.05  # gamma: by how much one miss lowers the miss rate that is aimed for.
    window: int = 100  # Scores that the quantile is taken of.
    cap: float = 10.0  # Largest scale.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_number("target", self.target, above=0, maximum=1 - 1e-9)
        check_number("gain", self.gain, above=0, maximum=1)
        check_number("window", self.window, minimum=1)
        check_number("cap", self.cap, above=0)


class Calibration(NamedTuple):
    """State of ``adapt``."""

    miss_rate: float  # alpha: what the quantile is taken for.
    scale: float  # Of the set that the next error is judged by.
    scores: np.ndarray  # (<= window,) the last ones, oldest first.


def first_calibration(settings: AdaptiveConformal, scale: float = 1.0) -> Calibration:
    """Returns the state before the first score, with a set of a given scale."""
    return Calibration(1.0 - settings.target, min(scale, settings.cap), np.empty(0))


def missed(calibration: Calibration, score: float) -> bool:
    """Tells whether the set misses an error; the set of scale zero is empty."""
    return score > calibration.scale or calibration.scale <= 0.0


def adapt(settings: AdaptiveConformal, before: Calibration, score: float) -> Calibration:
    """Returns the state after one more score (Gibbs and Candes 2021).

    alpha+ = alpha + gamma (alpha* - miss), alpha* = 1 - target; the set is the conformal quantile
    of the window for alpha+, the whole capped set where alpha+ <= 0, empty where alpha+ >= 1. It
    does not shrink while the window fills and a quantile for the target takes more scores.

    What is guaranteed, for any sequence of scores whatever: of the first T that are not above the
    cap, the share missed differs from alpha* by at most (max(alpha_1, 1 - alpha_1) + gamma) /
    (gamma T). That is coverage on average over time. It is no bound for any single sample, and
    none for any stretch of samples; a tube on such a set is not invariant. Scores above the cap
    leave the miss rate as it is, and their misses come on top.
    """
    rate = before.miss_rate
    if score <= settings.cap:
        rate += settings.gain * (1.0 - settings.target - missed(before, score))
    scores = np.append(before.scores, score)[-settings.window :]
    if rate <= 0.0:
        scale = settings.cap
    elif rate >= 1.0:
        scale = 0.0
    else:
        rank = max(min(conformal_rank(len(scores), 1.0 - rate), len(scores)), 1)
        scale = float(np.partition(scores, rank - 1)[rank - 1])
        few = len(scores) < settings.window
        if few and conformal_rank(len(scores), settings.target) > len(scores):
            scale = max(scale, before.scale)  # So few scores are no reason to make it smaller.
        scale = min(scale, settings.cap)
    return Calibration(rate, scale, scores)
