"""What sits between the wheels, in SDF: the body that bears the mass, and what to look at."""

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import UnitInertia

from mirte_drake.geometry import HALF_TRACK, WHEEL_POSITIONS, WHEEL_RADIUS
from mirte_drake.robots import palette
from mirte_drake.robots.mecanum_wheel import WHEEL_WIDTH
from mirte_drake.robots.sdf import box, cylinder, ellipsoid, link, visual

BASE = "base_link"  # Its frame: on the floor below the middle, x forward, y left, z up.
BASE_MASS = 5.0  # [kg] The robot's URDF.
# (3,) [m] Assumptions: the mass is spread over a box that fits between the wheels.
BODY_SIZE = np.array([0.29, 0.19, 0.06])
BODY_CENTER = np.array([0.0, 0.0, 0.07])

_CORNER = 0.03  # [m] Radius of the body's and the decks' upright edges.
_DECK = BODY_CENTER[2] + BODY_SIZE[2] / 2  # [m] Height of the lower deck, which is the body's top.
_UPPER_DECK = 0.15  # [m] Height of the upper deck.
_UPPER_X = -0.035  # [m] Its middle, behind that of the body.
_FRONT = BODY_SIZE[0] / 2  # [m]


def chassis_sdf() -> str:
    """Returns the base's link."""
    inertia = UnitInertia.SolidBox(*BODY_SIZE)
    shapes = _body() + _motors() + _upper_deck() + _lidar() + _camera() + _front_markers()
    moments = BASE_MASS * inertia.get_moments()
    return link(BASE, RigidTransform(), shapes, mass=BASE_MASS, moments=moments, center=BODY_CENTER)


def _rounded(name: str, center: list, size: list, color: list) -> list[str]:
    """Returns a box with round upright edges, as two boxes and four cylinders."""
    (length, width, height), r = size, _CORNER
    x, y = length / 2 - r, width / 2 - r
    parts = [(f"{name}_long", [0, 0, 0], box([length, width - 2 * r, height]))]
    parts.append((f"{name}_wide", [0, 0, 0], box([length - 2 * r, width, height])))
    for i, (dx, dy) in enumerate([(x, y), (x, -y), (-x, -y), (-x, y)]):
        parts.append((f"{name}_edge_{i}", [dx, dy, 0], cylinder(r, height)))
    return [
        visual(part, RigidTransform(np.add(center, offset)), shape, color)
        for part, offset, shape in parts
    ]


def _body() -> list[str]:
    length, width, _ = BODY_SIZE
    deck = _rounded(
        "deck", [0, 0, _DECK + 0.002], [length + 0.01, width + 0.01, 0.004], palette.DARK
    )
    stripe = _rounded(
        "stripe", [0, 0, 0.09], [length + 0.003, width + 0.003, 0.006], palette.ORANGE
    )
    return _rounded("body", list(BODY_CENTER), list(BODY_SIZE), palette.WHITE) + stripe + deck


def _motors() -> list[str]:
    lying = RotationMatrix.MakeXRotation(np.pi / 2)
    length = HALF_TRACK - WHEEL_WIDTH / 2 - BODY_SIZE[1] / 2 + 0.01
    y = HALF_TRACK - WHEEL_WIDTH / 2 - length / 2
    return [
        visual(
            f"motor_{i}",
            RigidTransform(lying, [position[0], np.sign(position[1]) * y, WHEEL_RADIUS]),
            cylinder(0.017, length),
            palette.METAL,
        )
        for i, position in enumerate(WHEEL_POSITIONS)
    ]


def _upper_deck() -> list[str]:
    length, width = 0.17, 0.15
    plate = _rounded("upper", [_UPPER_X, 0, _UPPER_DECK], [length, width, 0.004], palette.WHITE)
    height, inset = _UPPER_DECK - _DECK, 0.022
    corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * [
        length / 2 - inset,
        width / 2 - inset,
    ]
    return plate + [
        visual(
            f"post_{i}",
            RigidTransform([_UPPER_X + x, y, _DECK + height / 2]),
            cylinder(0.004, height),
            palette.METAL,
        )
        for i, (x, y) in enumerate(corners)
    ]


def _lidar() -> list[str]:
    layers = [  # Name, height above the deck, shape, colour.
        ("base", 0.009, cylinder(0.036, 0.014), palette.DARK),
        ("window", 0.024, cylinder(0.032, 0.016), palette.GLASS),
        ("dome", 0.032, ellipsoid([0.034, 0.034, 0.012]), palette.DARK),
    ]
    return [
        visual(f"lidar_{name}", RigidTransform([_UPPER_X, 0, _UPPER_DECK + z]), shape, color)
        for name, z, shape, color in layers
    ]


def _camera() -> list[str]:
    forward = RotationMatrix.MakeYRotation(np.pi / 2)
    x, z = _FRONT - 0.02, _DECK + 0.035
    shapes = [
        visual(
            "camera_post",
            RigidTransform([x, 0, _DECK + 0.012]),
            cylinder(0.006, 0.024),
            palette.METAL,
        ),
        visual("camera", RigidTransform([x, 0, z]), box([0.022, 0.09, 0.024]), palette.DARK),
    ]
    for name, y, radius in (("left", 0.03, 0.008), ("right", -0.03, 0.008), ("middle", 0.0, 0.005)):
        lens = RigidTransform(forward, [x + 0.011, y, z])
        shapes.append(visual(f"lens_{name}", lens, cylinder(radius, 0.004), palette.GLASS))
    return shapes


def _front_markers() -> list[str]:
    """Returns an arrow head on the deck and two lights: where forward is."""
    shapes = []
    for side, sign in (("left", 1), ("right", -1)):
        turned = RotationMatrix.MakeZRotation(-sign * np.pi / 4)
        arm = RigidTransform(turned, [0.083, sign * 0.019, _DECK + 0.005])
        shapes.append(visual(f"arrow_{side}", arm, box([0.06, 0.012, 0.003]), palette.ORANGE))
        light = RigidTransform([_FRONT, sign * 0.05, 0.068])
        shapes.append(
            visual(f"light_{side}", light, ellipsoid([0.005, 0.012, 0.008]), palette.LIGHT)
        )
    return shapes
