"""Wheel odometry for a simulated robot that has no wheels, only a body velocity."""

import dataclasses as dc

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Integrator, MatrixGain

from mirte_drake.geometry import INVERSE_KINEMATICS
from mirte_drake.robots.odometry_sensor import AddOdometrySensor, OdometrySensorConfig
from mirte_drake.robots.robot_ports import RobotPorts
from mirte_drake.vectors import WHEELS


def AddRollingWheels(builder: DiagramBuilder, body_velocity: OutputPort) -> OutputPort:
    """Adds wheels that roll without slip under a robot (2-2).

    Args:
        builder: The builder that the robot is in.
        body_velocity: (3,) [m/s, m/s, rad/s] the true one, at every instant.

    Returns:
        The angles (4,) [rad] by which they have turned.
    """
    speeds = builder.AddNamedSystem("wheel_speeds", MatrixGain(INVERSE_KINEMATICS))
    angles = builder.AddNamedSystem("wheel_angles", Integrator(len(WHEELS)))
    builder.Connect(body_velocity, speeds.get_input_port())
    builder.Connect(speeds.get_output_port(), angles.get_input_port())
    return angles.get_output_port()


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
        The robot's ports, with pose and body velocity as the odometry measures them, and its
        wheels.

    Raises:
        ValueError: when ``config``, ``start`` or ``seed`` is out of range.
    """
    angles = AddRollingWheels(builder, robot.body_velocity)
    sensor = AddOdometrySensor(builder, config, start=start, seed=seed)
    builder.Connect(angles, sensor.GetInputPort("wheel_angles"))
    return dc.replace(
        robot,
        pose=sensor.GetOutputPort("pose"),
        body_velocity=sensor.GetOutputPort("body_velocity"),
        wheel_angles=angles,
    )
