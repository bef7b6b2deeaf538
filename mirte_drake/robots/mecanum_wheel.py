"""A mecanum wheel with free rollers, in SDF."""

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import UnitInertia

from mirte_drake.geometry import WHEEL_RADIUS
from mirte_drake.robots import palette
from mirte_drake.robots.sdf import collision, cylinder, ellipsoid, link, revolute, visual

ROLLER_COUNT = 10  # Per wheel.
ROLLER_RADIUS = 0.009  # [m] At its middle: so that ten rollers just clear each other.
WHEEL_MASS = 2.15  # [kg] With its rollers; the robot's URDF.
ROLLER_MASS = 0.012  # [kg] Assumption: solid rubber.
ROLLER_DAMPING = 1e-5  # [N m s/rad] Of its bearing: what makes lateral motion lose speed.
ROLLER_FRICTION = 1.0  # [-] Higher than that of a floor, see ``floor.surface_friction``.
CONTACT_STIFFNESS = 1e6  # [N/m] Assumption: sinks in by less than 0.1 mm.
CONTACT_DISSIPATION = 10.0  # [s/m] Assumption: no bounce.

HUB_RADIUS = WHEEL_RADIUS - ROLLER_RADIUS  # [m] From the wheel's axis to those of the rollers.
WHEEL_WIDTH = 0.045  # [m] Of the hub, between the plates that hold the rollers.

_LYING = RotationMatrix.MakeXRotation(np.pi / 2)  # Turns a cylinder's axis from z to y.


def roller_half_length() -> float:
    """Returns the semi-axis [m] along a roller that makes the wheel round.

    A roller is an ellipsoid of semi-axes (a, b, b) at 45 degrees to the wheel. With the wheel
    turned by psi from where the roller stands in the middle, the wheel's centre is at the height

        h(psi) = (R - b) cos(psi) + sqrt(b^2 + (a^2 - b^2) sin(psi)^2 / 2).

    This a makes h = R in the middle and where the next roller takes over.
    """
    b, psi = ROLLER_RADIUS, np.pi / ROLLER_COUNT
    reach = WHEEL_RADIUS - HUB_RADIUS * np.cos(psi)
    return float(np.sqrt(b**2 + 2 * (reach**2 - b**2) / np.sin(psi) ** 2))


def hub_name(wheel: str) -> str:
    """Returns the name of a wheel's link."""
    return f"{wheel}_wheel"


def wheel_sdf(name: str, center: np.ndarray, roller_axis: np.ndarray) -> str:
    """Returns the links of a wheel and the joints of its rollers.

    Args:
        name: Front left and so on; links are NAME_wheel and NAME_roller_0 and so on.
        center: (3,) [m] in the model's frame; the wheel turns about y.
        roller_axis: (2,) direction in x and y of the roller that touches the ground.
    """
    rollers = "".join(_roller(name, roller_axis, i) for i in range(ROLLER_COUNT))
    return _hub(name, center) + rollers


def _hub(name: str, center: np.ndarray) -> str:
    mass = WHEEL_MASS - ROLLER_COUNT * ROLLER_MASS
    inertia = UnitInertia.SolidCylinder(HUB_RADIUS, WHEEL_WIDTH, [0, 1, 0])
    core = cylinder(0.6 * HUB_RADIUS, WHEEL_WIDTH)
    shapes = [visual("core", RigidTransform(_LYING, [0, 0, 0]), core, palette.DARK)]
    for side, y in (("left", WHEEL_WIDTH / 2), ("right", -WHEEL_WIDTH / 2)):
        plate, cap = cylinder(0.88 * HUB_RADIUS, 0.003), cylinder(0.3 * HUB_RADIUS, 0.008)
        X = RigidTransform(_LYING, [0, y, 0])
        shapes.append(visual(f"{side}_plate", X, plate, palette.DARK))
        shapes.append(visual(f"{side}_cap", X, cap, palette.METAL))
    X = RigidTransform(center)
    return link(hub_name(name), X, shapes, mass=mass, moments=mass * inertia.get_moments())


def _roller(wheel: str, axis: np.ndarray, index: int) -> str:
    name = f"{wheel}_roller_{index}"
    radii = [roller_half_length(), ROLLER_RADIUS, ROLLER_RADIUS]
    turn = RotationMatrix.MakeYRotation(2 * np.pi * index / ROLLER_COUNT)
    along = RotationMatrix.MakeZRotation(np.arctan2(axis[1], axis[0]))
    X = RigidTransform(turn @ along, turn @ np.array([0, 0, -HUB_RADIUS]))
    shape = ellipsoid(radii)
    contact = collision(
        shape,
        friction=ROLLER_FRICTION,
        stiffness=CONTACT_STIFFNESS,
        dissipation=CONTACT_DISSIPATION,
    )
    body = link(
        name,
        X,
        [visual("rubber", RigidTransform(), shape, palette.RUBBER), contact],
        mass=ROLLER_MASS,
        moments=ROLLER_MASS * UnitInertia.SolidEllipsoid(*radii).get_moments(),
        relative_to=hub_name(wheel),
    )
    axle = f"{name}_axle"
    return body + revolute(axle, hub_name(wheel), name, [1, 0, 0], damping=ROLLER_DAMPING)
