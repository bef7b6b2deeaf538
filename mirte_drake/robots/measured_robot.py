"""Any simulated robot together with the odometry that measures it."""

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, System

from mirte_drake.robots.dynamic_robot import AddDynamicRobot, DynamicRobotConfig
from mirte_drake.robots.multibody_robot import AddMultibodyRobot, MultibodyRobotConfig
from mirte_drake.robots.odometry_sensor import AddOdometrySensor, OdometrySensorConfig
from mirte_drake.robots.robot_ports import RobotPorts
from mirte_drake.robots.rolling_odometry import AddRollingOdometry
from mirte_drake.robots.sindyc_robot import AddSindycRobot, SindycRobotConfig

RobotConfig = SindycRobotConfig | DynamicRobotConfig | MultibodyRobotConfig


def MakeMeasuredRobot(
    config: RobotConfig, odometry: OdometrySensorConfig, *, start: np.ndarray, seed: int = 0
) -> Diagram:
    """Builds a robot, called ``motion``, and the odometry that is all that it knows of itself.

    .. pydrake_system::

        name: MeasuredRobot
        input_ports:
        - wheel_command
        - disturbance
        output_ports:
        - pose
        - body_velocity
        - true_pose
        - wheel_angles
        - geometry_query

    ==================  ===========  ==================  =======================================
    port                type         unit                meaning
    ==================  ===========  ==================  =======================================
    wheel_command (in)  vector (4,)  [pwm]               u
    disturbance (in)    vector (3,)  [m/s, m/s, rad/s]   body frame; not of a multibody robot
    pose                vector (3,)  [m, m, rad]         of odometry, world frame, yaw unwrapped
    body_velocity       vector (3,)  [m/s, m/s, rad/s]   of odometry, mean over its last period
    true_pose           vector (3,)  [m, m, rad]         world frame, yaw unwrapped
    wheel_angles        vector (4,)  [rad]               turned since the start
    geometry_query      abstract     -                   of a multibody robot, for a visualizer
    ==================  ===========  ==================  =======================================

    A SINDYc robot has no wheels: some that do not slip roll under it. The Diagram is named after
    the kind of robot.

    Args:
        config: The robot.
        odometry: What it measures with.
        start: (3,) [m, m, rad] initial pose where the robot's config has none; that of the
            odometry is the same.
        seed: Seed >= 0 of the odometry's jitter.

    Raises:
        ValueError: when a value is out of range.
    """
    odometry.validate()
    builder = DiagramBuilder()
    start = start if config.initial_pose is None else config.initial_pose
    match config:
        case SindycRobotConfig():
            name = "sindyc_robot"
            ports = AddSindycRobot(builder, config, start=start, name="motion")
            ports = AddRollingOdometry(builder, ports, odometry, start=start, seed=seed)
        case DynamicRobotConfig():
            name = "dynamic_robot"
            dynamic = AddDynamicRobot(builder, config, start=start, name="motion")
            ports = _with_encoders(builder, dynamic, odometry, start=start, seed=seed)
        case MultibodyRobotConfig():
            name = "multibody_robot"
            bodies = AddMultibodyRobot(builder, config, start=start, name="motion")
            ports = _with_encoders(builder, bodies, odometry, start=start, seed=seed)
            builder.ExportOutput(bodies.GetOutputPort("geometry_query"), "geometry_query")
    builder.ExportInput(ports.wheel_command, "wheel_command")
    if ports.disturbance is not None:
        builder.ExportInput(ports.disturbance, "disturbance")
    assert ports.true_pose is not None and ports.wheel_angles is not None
    builder.ExportOutput(ports.pose, "pose")
    builder.ExportOutput(ports.body_velocity, "body_velocity")
    builder.ExportOutput(ports.true_pose, "true_pose")
    builder.ExportOutput(ports.wheel_angles, "wheel_angles")
    robot = builder.Build()
    robot.set_name(name)
    return robot


def AddMeasuredRobot(
    builder: DiagramBuilder,
    config: RobotConfig,
    odometry: OdometrySensorConfig,
    *,
    start: np.ndarray,
    seed: int = 0,
) -> RobotPorts:
    """Adds a robot with its odometry to ``builder``; see ``MakeMeasuredRobot``."""
    robot = MakeMeasuredRobot(config, odometry, start=start, seed=seed)
    return _ports(builder.AddSystem(robot), robot)


def _with_encoders(
    builder: DiagramBuilder,
    robot: System,
    odometry: OdometrySensorConfig,
    *,
    start: np.ndarray,
    seed: int,
) -> RobotPorts:
    """Adds the odometry that reads a robot's own wheels."""
    sensor = AddOdometrySensor(builder, odometry, start=start, seed=seed)
    builder.Connect(robot.GetOutputPort("wheel_angles"), sensor.GetInputPort("wheel_angles"))
    return _ports(robot, sensor)


def _ports(robot: System, measured: System) -> RobotPorts:
    return RobotPorts(
        wheel_command=robot.GetInputPort("wheel_command"),
        pose=measured.GetOutputPort("pose"),
        body_velocity=measured.GetOutputPort("body_velocity"),
        true_pose=robot.GetOutputPort("true_pose"),
        wheel_angles=robot.GetOutputPort("wheel_angles"),
        disturbance=robot.GetInputPort("disturbance")
        if robot.HasInputPort("disturbance")
        else None,
    )
