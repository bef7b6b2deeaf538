"""Wheel odometry for a simulated robot that has no wheels, only a body velocity."""

import dataclasses as dc

import numpy as np
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Integrator, MatrixGain

from mirte_drake.geometry import INVERSE_KINEMATICS
from mirte_drake.robots.odometry_sensor import AddOdometrySensor, OdometrySensorConfig
from mirte_drake.robots.robot_ports import RobotPorts
from mirte_drake.vectors import WHEELS


def AddRollingOdometry(
    builder: DiagramBuilder,
    robot: RobotPorts,
    config: OdometrySensorConfig,
    *,
    start: np.ndarray,
    seed: int = 0,
) -> RobotPorts:
    """Adds wheels that roll without slip under a robot (2-2), and the odometry that reads them.

    Args:
        builder: The builder that the robot is in.
        robot: Its ports; ``body_velocity`` is the true one, at every instant.
        config: Of the odometry.
        start: (3,) [m, m, rad] pose that the odometry begins with.
        seed: Seed >= 0 of the jitter.

    Returns:
        The robot's ports, with pose and body velocity as the odometry measures them.

    Raises:
        ValueError: when ``config``, ``start`` or ``seed`` is out of range.
    """
    speeds = builder.AddNamedSystem("wheel_speeds", MatrixGain(INVERSE_KINEMATICS))
    angles = builder.AddNamedSystem("wheel_angles", Integrator(len(WHEELS)))
    sensor = AddOdometrySensor(builder, config, start=start, seed=seed)
    builder.Connect(robot.body_velocity, speeds.get_input_port())
    builder.Connect(speeds.get_output_port(), angles.get_input_port())
    builder.Connect(angles.get_output_port(), sensor.GetInputPort("wheel_angles"))
    return dc.replace(
        robot,
        pose=sensor.GetOutputPort("pose"),
        body_velocity=sensor.GetOutputPort("body_velocity"),
    )
