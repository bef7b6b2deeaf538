"""What the tests call in other processes, which find it by its name."""

import os
import time

import numpy as np


def square(x: float) -> tuple[float, int]:
    """Returns x squared and the process in which it was."""
    time.sleep(0.05)
    if x < 0:
        raise ValueError(f"{x} is negative")
    if np.isnan(x):
        os._exit(1)  # As when a process is killed.
    return x**2, os.getpid()
