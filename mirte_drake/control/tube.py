"""The box tube: its recursion (4-19), the tightened inputs (4-20), a turned disturbance box."""

from collections.abc import Sequence

import numpy as np

from mirte_drake.angles import rotation
from mirte_drake.control.dlqr import DlqrDesign


def propagate_tube(
    half_width: np.ndarray, closed_loop: np.ndarray, disturbance: np.ndarray
) -> np.ndarray:
    """Returns d_{k+1} = |A_k - B_k K_k| d_k + w, componentwise (4-19).

    Args:
        half_width: (n,) d_k.
        closed_loop: (n, n) A_k - B_k K_k.
        disturbance: (n,) T_s w_max, the largest effect of one sample.
    """
    return np.abs(closed_loop) @ half_width + disturbance


def tighten(
    lower: np.ndarray, upper: np.ndarray, gain: np.ndarray, half_width: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the bounds (m,) on the nominal input that leave room for |K| d (4-20).

    Where |K| d takes more than there is, both bounds meet in the middle: the nominal controller
    then has no freedom left, and the limiter behind it guards the input set.
    """
    room = np.abs(gain) @ half_width
    middle = 0.5 * (lower + upper)
    return np.minimum(lower + room, middle), np.maximum(upper - room, middle)


def rotated_bound(bound: np.ndarray, yaw: float) -> np.ndarray:
    """Returns |R(yaw)| w: the smallest world-frame box (3,) around a turned body-frame box."""
    return np.abs(rotation(yaw)) @ bound


def stage_disturbances(
    bound: np.ndarray, designs: Sequence[DlqrDesign], period: float, *, rotated: bool
) -> np.ndarray:
    """Returns T_s w (S, n) of each stage: what a sample's disturbance does at most.

    Args:
        bound: (n,) w_max, body frame.
        designs: S of them, whose yaw says how the body frame is turned.
        period: [s] T_s.
        rotated: Whether the bound is turned into the world frame; else it is taken as it is.
    """
    if not rotated:
        return np.tile(period * bound, (len(designs), 1))
    return np.array([period * rotated_bound(bound, design.yaw) for design in designs])


def horizon_half_widths(
    half_width: np.ndarray, designs: Sequence[DlqrDesign], disturbances: np.ndarray
) -> np.ndarray:
    """Returns d (S + 1, n): the tube now, and after each of S stages (4-19).

    Args:
        half_width: (n,) d_k.
        designs: DLQR of each stage.
        disturbances: (S, n) T_s w of each stage.
    """
    widths = [half_width]
    for design, disturbance in zip(designs, disturbances, strict=True):
        widths.append(propagate_tube(widths[-1], design.closed_loop, disturbance))
    return np.array(widths)
