"""Where a robot is now, from where it was and the commands that it was sent since."""

from collections.abc import Sequence

import numpy as np

from mirte_drake.model.prediction_model import PredictionModel


def roll_forward(
    model: PredictionModel,
    state: np.ndarray,
    sent: Sequence[tuple[float, np.ndarray]],
    start: float,
    end: float,
) -> np.ndarray:
    """Returns the state (n,) at ``end``, predicted from the one at ``start``.

    Args:
        model: Prediction model.
        state: (n,) at ``start``.
        sent: Times [s] and commands (m,) [pwm], oldest first; each holds until the next. Before
            the first the wheels stand still.
        start: [s] when ``state`` was.
        end: [s] when it is wanted; nothing changes where it is not after ``start``.
    """
    for k, (since, command) in enumerate(sent):
        until = sent[k + 1][0] if k + 1 < len(sent) else end
        duration = min(until, end) - max(since, start)
        if duration > 0:
            state = model.step(state, command, duration)
    return state
