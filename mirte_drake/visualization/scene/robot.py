"""The robot in the scene: it drives, its wheels turn, and bars show what they are told."""

import numpy as np
from pydrake.geometry import Cylinder, Meshcat
from pydrake.math import RigidTransform, RotationMatrix

from mirte_drake.geometry import WHEEL_POSITIONS
from mirte_drake.vectors import WHEELS
from mirte_drake.visualization.scene.colors import rgba
from mirte_drake.visualization.scene.frame import Frame
from mirte_drake.visualization.scene.shapes import RobotShapes, draw_robot_shapes
from mirte_drake.visualization.scene.solids import draw_solid, stretch
from mirte_drake.visualization.scene.stage import ROOT

ROBOT = f"{ROOT}/robot"
COMMANDS = f"{ROBOT}/commands"
BAR_LENGTH = 0.2  # [m] Of 100 PWM.

_BAR_RADIUS = 0.01  # [m]
_BAR_DISTANCE = 0.06  # [m] From the middle of the wheel, outwards.
_DIRECTIONS = {"forward": 1, "backward": -1}


def draw_robot(meshcat: Meshcat, robot: RobotShapes) -> None:
    """Draws the robot, and beside each wheel a glass whose filling is the wheel's command."""
    draw_robot_shapes(meshcat, ROBOT, robot)
    middle = RigidTransform([0, 0, BAR_LENGTH / 2])
    glass, filling = (Cylinder(r, BAR_LENGTH) for r in (_BAR_RADIUS, 1.05 * _BAR_RADIUS))
    for wheel, (x, y) in zip(WHEELS, WHEEL_POSITIONS, strict=True):
        place = f"{COMMANDS}/{wheel}"
        beside = [x, y + np.sign(y) * _BAR_DISTANCE, 0.0]
        meshcat.SetTransform(place, RigidTransform(beside))
        draw_solid(meshcat, f"{place}/glass", glass, rgba("glass", 0.3), middle)
        for direction in _DIRECTIONS:
            path = f"{place}/{direction}/filling"
            draw_solid(meshcat, path, filling, rgba(direction), middle)


def move_robot(meshcat: Meshcat, robot: RobotShapes, frame: Frame, time: float | None) -> None:
    """Moves the robot to its true pose, turns its wheels and fills its bars."""
    x, y, yaw = frame.true_pose
    X = RigidTransform(RotationMatrix.MakeZRotation(yaw), [x, y, 0.0])
    meshcat.SetTransform(ROBOT, X, time)
    told = zip(WHEELS, frame.wheel_angles, frame.wheel_command, strict=True)
    for wheel, angle, command in told:
        turn = RigidTransform(RotationMatrix.MakeYRotation(angle), [0.0, 0.0, 0.0])
        meshcat.SetTransform(f"{ROBOT}/{wheel}", robot.wheels[wheel] @ turn, time)
        for direction, sign in _DIRECTIONS.items():
            bar = f"{COMMANDS}/{wheel}/{direction}"
            stretch(meshcat, bar, [1.0, 1.0, sign * command / 100], time)
