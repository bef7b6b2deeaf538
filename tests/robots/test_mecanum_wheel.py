from xml.etree import ElementTree

import numpy as np
import pytest

from mirte_drake.geometry import WHEEL_RADIUS
from mirte_drake.robots.mecanum_wheel import (
    HUB_RADIUS,
    ROLLER_COUNT,
    ROLLER_RADIUS,
    WHEEL_MASS,
    roller_half_length,
    wheel_sdf,
)


def axle_height(turn: float) -> float:
    """Height of the axle above the lowest point of all rollers, from points on them."""
    around, along = np.meshgrid(np.linspace(0, 2 * np.pi, 181), np.linspace(0, np.pi, 361))
    a, b = roller_half_length(), ROLLER_RADIUS
    points = np.stack(
        [
            a * np.cos(along),
            b * np.sin(along) * np.cos(around),
            b * np.sin(along) * np.sin(around),
        ]
    )
    lowest = []
    for angle in turn + 2 * np.pi * np.arange(ROLLER_COUNT) / ROLLER_COUNT:
        # At 45 degrees to x in the wheel, then turned about y: the world's z of each point.
        x, z = (points[0] - points[1]) / np.sqrt(2), points[2] - HUB_RADIUS
        lowest.append(np.min(-np.sin(angle) * x + np.cos(angle) * z))
    return -min(lowest)


def test_wheel_is_round():
    half_step = np.pi / ROLLER_COUNT
    assert axle_height(0.0) == pytest.approx(WHEEL_RADIUS, abs=1e-6)
    assert axle_height(half_step) == pytest.approx(WHEEL_RADIUS, abs=1e-6)
    heights = [axle_height(turn) for turn in np.linspace(0, 2 * half_step, 9)]
    assert np.ptp(heights) < 1e-4  # A fifth of a percent of the radius.


def test_rollers_clear_each_other():
    # Neighbours' axes are nearly parallel: their distance across them, at the middle.
    between = HUB_RADIUS * 2 * np.pi / ROLLER_COUNT / np.sqrt(2)
    assert between > 2 * ROLLER_RADIUS


def test_parts_of_a_wheel_add_up():
    text = wheel_sdf("front_left", np.zeros(3), np.array([1.0, -1.0]))
    root = ElementTree.fromstring(f'<r xmlns:drake="d">{text}</r>')
    assert len(root.findall("link")) == 1 + ROLLER_COUNT
    assert len(root.findall("joint")) == ROLLER_COUNT
    masses = [float(mass.text) for mass in root.iterfind("link/inertial/mass")]
    assert sum(masses) == pytest.approx(WHEEL_MASS, rel=1e-12)
