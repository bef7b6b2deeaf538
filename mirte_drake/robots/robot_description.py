"""The MIRTE Master as one self-contained SDF model, from the constants of ``geometry``.

The multibody robot parses this text, so what others get is what is simulated here.
"""

from pathlib import Path
from xml.dom import minidom

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, RpyFloatingJoint

from mirte_drake.files import replacing
from mirte_drake.geometry import ROLLER_AXES, WHEEL_POSITIONS, WHEEL_RADIUS
from mirte_drake.robots.chassis import BASE, chassis_sdf
from mirte_drake.robots.mecanum_wheel import hub_name, wheel_sdf
from mirte_drake.robots.sdf import revolute
from mirte_drake.vectors import WHEELS

STALL_TORQUE = 1.0  # [N m] Assumption: a 12 V gear motor of 180 rpm, the speed of 100 PWM.
MOTOR_GAIN = 2.0  # [N m s/rad] Torque per error of speed: stiff, the lag is the drivetrain's.


def robot_sdf() -> str:
    """Returns the robot as SDF: a base, four wheels with motors and free rollers.

    The model's frame lies on the floor below the middle. Links and joints of the wheels bear the
    names of ``vectors.WHEELS``. A motor gives the torque MOTOR_GAIN (desired - actual speed), at
    most STALL_TORQUE. Without meshes; tags of Drake's own are ignored elsewhere.
    """
    parts = [chassis_sdf()]
    for name, position, axis in zip(WHEELS, WHEEL_POSITIONS, ROLLER_AXES, strict=True):
        parts.append(wheel_sdf(name, np.array([*position, WHEEL_RADIUS]), axis))
        parts.append(
            revolute(
                name, BASE, hub_name(name), [0, 1, 0], effort=STALL_TORQUE, speed_gain=MOTOR_GAIN
            )
        )
    text = (
        '<sdf version="1.8" xmlns:drake="http://drake.mit.edu">'
        f'<model name="mirte_master">{"".join(parts)}</model></sdf>'
    )
    return minidom.parseString(text).toprettyxml(indent="  ")


def add_robot(plant: MultibodyPlant) -> tuple[ModelInstanceIndex, RpyFloatingJoint]:
    """Adds the robot to a plant with a SceneGraph, free to move.

    Returns:
        The robot, and the joint between the world and its base, whose yaw does not wrap.
    """
    (robot,) = Parser(plant).AddModelsFromString(robot_sdf(), "sdf")
    base = plant.GetFrameByName(BASE, robot)
    return robot, plant.AddJoint(RpyFloatingJoint("floating_base", plant.world_frame(), base))


def write_robot_sdf(path: Path) -> None:
    """Writes the robot's SDF, complete or not at all.

    Raises:
        UserError: when the file cannot be written.
    """
    with replacing(path) as temporary:
        temporary.write_text(robot_sdf(), encoding="utf-8")
