"""The number of a sample, from a time that has been rounded."""

import numpy as np

ROUND_OFF = 1e-6  # [samples] By which a time may be short of its sample's.


def sample_number(time: float | np.ndarray, period: float) -> np.ndarray:
    """Returns the k (...) of the last sample k ``period`` at times (...) [s], as integers."""
    return np.floor(np.asarray(time) / period + ROUND_OFF).astype(int)
