"""The floor: friction, patches of another friction, slope."""

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from pydrake.geometry import AddContactMaterial, Box, ProximityProperties
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant

from mirte_drake.checks import check_array, check_number
from mirte_drake.robots import palette
from mirte_drake.robots.mecanum_wheel import (
    CONTACT_DISSIPATION,
    CONTACT_STIFFNESS,
    ROLLER_FRICTION,
)

GRAVITY = 9.81  # [m/s^2]
FLOOR_SIZE = 200.0  # [m] Side of the square, its middle in the world's origin.
FLOOR_DEPTH = 1.0  # [m]
PATCH_THICKNESS = 2e-4  # [m] A patch is a sheet on the floor: more than the rollers sink in.
GRID_GAP = 1e-3  # [m] What is shown of the floor lies below a viewer's grid at z = 0.


@dc.dataclass
class FrictionPatch:
    """A rectangular sheet of another friction that lies on the floor."""

    center: np.ndarray = dc.field(default_factory=lambda: np.zeros(2))  # (2,) [m] World frame.
    size: np.ndarray = dc.field(default_factory=lambda: np.ones(2))  # (2,) [m] Along x and y.
    friction: float = 0.1  # [-] Between rollers and patch.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_array("center", self.center, (2,))
        check_array("size", self.size, (2,), minimum=PATCH_THICKNESS)
        check_friction("friction", self.friction)


def check_friction(name: str, friction: float) -> None:
    """Checks a coefficient of friction between rollers and floor.

    Raises:
        ValueError: when it is not above zero and at most that of the rollers.
    """
    check_number(name, friction, above=0, maximum=ROLLER_FRICTION)


def surface_friction(friction: float) -> float:
    """Returns the coefficient of a surface that makes ``friction`` with the rollers.

    Drake combines two surfaces to 2 m1 m2 / (m1 + m2).
    """
    return friction * ROLLER_FRICTION / (2 * ROLLER_FRICTION - friction)


def gravity_on_slope(slope: np.ndarray) -> np.ndarray:
    """Returns gravity (3,) [m/s^2] in the frame of a sloping floor, whose z is its normal.

    Args:
        slope: (2,) [rad] angle of the slope times the direction uphill, in the floor's x and y.
    """
    angle = float(np.linalg.norm(slope))
    along = np.sinc(angle / np.pi) * np.asarray(slope)  # sin(angle) times the direction.
    return -GRAVITY * np.array([*along, np.cos(angle)])


def add_floor(plant: MultibodyPlant, friction: float, patches: Sequence[FrictionPatch]) -> None:
    """Adds the floor, whose surface is z = 0, and its patches.

    Args:
        plant: Plant with a SceneGraph.
        friction: [-] between rollers and floor.
        patches: What lies on it.
    """
    ground = FrictionPatch(size=np.full(2, FLOOR_SIZE), friction=friction)
    _add_slab(plant, "floor", ground, top=0.0, shown_top=-GRID_GAP, color=palette.FLOOR)
    for i, patch in enumerate(patches):
        height = PATCH_THICKNESS
        _add_slab(plant, f"patch_{i}", patch, top=height, shown_top=height, color=palette.PATCH)


def _add_slab(
    plant: MultibodyPlant,
    name: str,
    surface: FrictionPatch,
    *,
    top: float,
    shown_top: float,
    color: list,
) -> None:
    coefficient = surface_friction(surface.friction)
    properties = ProximityProperties()
    AddContactMaterial(
        dissipation=CONTACT_DISSIPATION,
        point_stiffness=CONTACT_STIFFNESS,
        friction=CoulombFriction(coefficient, coefficient),
        properties=properties,
    )
    # Deep, so that no roller finds the underside nearer than the top.
    shape = Box(*surface.size, FLOOR_DEPTH)
    X, shown = (RigidTransform([*surface.center, z - FLOOR_DEPTH / 2]) for z in (top, shown_top))
    world = plant.world_body()
    plant.RegisterCollisionGeometry(world, X, shape, name, properties)
    plant.RegisterVisualGeometry(world, shown, shape, name, color)
