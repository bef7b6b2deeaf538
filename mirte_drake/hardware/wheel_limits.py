"""Wheel commands as they may go on the wire: whole, within limits, and how much they push."""

import math

import numpy as np

from mirte_drake.geometry import FORWARD_KINEMATICS
from mirte_drake.vectors import WHEELS

STILL = np.zeros(len(WHEELS), dtype=int)  # [pwm]
STILL.setflags(write=False)
# (3, 4) How each wheel helps to move forward, to the left, and to turn counter-clockwise.
MOTIONS = np.sign(FORWARD_KINEMATICS)


def limit_command(wanted: np.ndarray, last: np.ndarray, step: float, limit: float) -> np.ndarray:
    """Returns the whole numbers (4,) [pwm] nearest to a command that its limits allow.

    Args:
        wanted: (4,) [pwm] finite numbers.
        last: (4,) [pwm] whole numbers within the limit, the command before.
        step: [pwm] largest change of a wheel; but all may stop at once.
        limit: [pwm] largest command of a wheel.
    """
    whole = np.rint(wanted)
    if not whole.any():
        return STILL
    step, limit = math.floor(step), math.floor(limit)
    return np.clip(np.clip(whole, last - step, last + step), -limit, limit).astype(int)


def push(command: np.ndarray) -> float:
    """Returns the command [pwm] of four wheels alike that pushes the robot as much as this (4,).

    It is the root mean square of the wheels, without what they do against each other.
    """
    return float(np.linalg.norm(MOTIONS @ command)) / len(WHEELS)
