"""Pieces of an SDF model as text: links, shapes, joints."""

from collections.abc import Iterable

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw


def numbers(values: Iterable[float]) -> str:
    """Returns numbers as SDF writes them, free of the rounding of sines and cosines."""
    return " ".join(f"{round(float(value), 12) + 0.0:.12g}" for value in values)


def pose(X: RigidTransform, relative_to: str) -> str:
    """Returns the pose ``X`` in a frame; the empty name means SDF's own choice."""
    frame = f' relative_to="{relative_to}"' if relative_to else ""
    values = [*X.translation(), *RollPitchYaw(X.rotation()).vector()]
    return f"<pose{frame}>{numbers(values)}</pose>"


def box(size: Iterable[float]) -> str:
    """Returns a box of a size (3,) [m]."""
    return f"<box><size>{numbers(size)}</size></box>"


def cylinder(radius: float, length: float) -> str:
    """Returns a cylinder along z, of a radius and a length [m]."""
    return f"<cylinder><radius>{radius:g}</radius><length>{length:g}</length></cylinder>"


def ellipsoid(radii: Iterable[float]) -> str:
    """Returns an ellipsoid of semi-axes (3,) [m]."""
    return f"<ellipsoid><radii>{numbers(radii)}</radii></ellipsoid>"


def visual(name: str, X: RigidTransform, shape: str, color: Iterable[float]) -> str:
    """Returns a shape to look at.

    Args:
        name: Its name, unique in its link.
        X: Its pose in the link.
        shape: Its geometry.
        color: (4,) red, green, blue, opacity.
    """
    return (
        f'<visual name="{name}">{pose(X, "")}<geometry>{shape}</geometry>'
        f"<material><diffuse>{numbers(color)}</diffuse></material></visual>"
    )


def collision(shape: str, *, friction: float, stiffness: float, dissipation: float) -> str:
    """Returns a shape that touches others, in the middle of its link.

    Args:
        shape: Its geometry.
        friction: [-] coefficient of friction.
        stiffness: [N/m] of the contact point.
        dissipation: [s/m] of Hunt and Crossley.
    """
    return (
        f'<collision name="contact"><geometry>{shape}</geometry>'
        f"<surface><friction><ode><mu>{friction:g}</mu><mu2>{friction:g}</mu2></ode></friction>"
        "</surface><drake:proximity_properties>"
        f"<drake:point_contact_stiffness>{stiffness:g}</drake:point_contact_stiffness>"
        f"<drake:hunt_crossley_dissipation>{dissipation:g}</drake:hunt_crossley_dissipation>"
        "</drake:proximity_properties></collision>"
    )


def link(
    name: str,
    X: RigidTransform,
    content: Iterable[str],
    *,
    mass: float,
    moments: np.ndarray,
    center: Iterable[float] = (0, 0, 0),
    relative_to: str = "",
) -> str:
    """Returns a rigid body.

    Args:
        name: Its name.
        X: Its pose in the frame ``relative_to``, by default the model's.
        content: Its shapes.
        mass: [kg].
        moments: (3,) [kg m^2] of inertia about the centre of mass, along the link's axes.
        center: (3,) [m] the centre of mass in the link.
        relative_to: Name of a frame.
    """
    ixx, iyy, izz = moments
    return (
        f'<link name="{name}">{pose(X, relative_to)}'
        f"<inertial>{pose(RigidTransform(list(center)), '')}<mass>{mass:.12g}</mass>"
        f"<inertia><ixx>{ixx:.12g}</ixx><iyy>{iyy:.12g}</iyy><izz>{izz:.12g}</izz>"
        "<ixy>0</ixy><ixz>0</ixz><iyz>0</iyz></inertia></inertial>"
        f"{''.join(content)}</link>"
    )


def revolute(
    name: str,
    parent: str,
    child: str,
    axis: Iterable[float],
    *,
    damping: float = 0.0,
    effort: float = 0.0,
    speed_gain: float = 0.0,
) -> str:
    """Returns a joint in the origin of its child.

    Args:
        name: Its name.
        parent: Name of a link.
        child: Name of a link.
        axis: (3,) in the child's frame.
        damping: [N m s/rad].
        effort: [N m] largest torque of its motor; zero: no motor.
        speed_gain: [N m s/rad] torque of the motor per error of speed.
    """
    gains = f'<drake:controller_gains p="0" d="{speed_gain:g}"/>' if speed_gain else ""
    return (
        f'<joint name="{name}" type="revolute"><parent>{parent}</parent><child>{child}</child>'
        f"<axis><xyz>{numbers(axis)}</xyz><limit><effort>{effort:g}</effort></limit>"
        f"<dynamics><damping>{damping:g}</damping></dynamics></axis>{gains}</joint>"
    )
