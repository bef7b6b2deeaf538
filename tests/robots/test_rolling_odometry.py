import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from mirte_drake.robots.odometry_sensor import OdometrySensorConfig
from mirte_drake.robots.robot_ports import RobotPorts
from mirte_drake.robots.rolling_odometry import AddRollingOdometry
from mirte_drake.robots.sindyc_robot import AddSindycRobot, SindycRobotConfig

START = np.array([1.0, 2.0, 0.5])
COMMAND = np.array([40.0, 10.0, 30.0, 20.0])


def driven(**config) -> tuple[Simulator, RobotPorts, RobotPorts]:
    builder = DiagramBuilder()
    bare = AddSindycRobot(builder, SindycRobotConfig(model="kinematic"), start=START)
    robot = AddRollingOdometry(builder, bare, OdometrySensorConfig(**config), start=START)
    command = builder.AddSystem(ConstantVectorSource(COMMAND))
    builder.Connect(command.get_output_port(), robot.wheel_command)
    return Simulator(builder.Build()), bare, robot


def read(simulator, port) -> np.ndarray:
    return port.Eval(port.get_system().GetMyContextFromRoot(simulator.get_context()))


def test_odometry_measures_what_the_robot_does():
    simulator, bare, robot = driven()
    simulator.AdvanceTo(3.0)
    # The yaw is off by two steps at most; turning by the yaw at the end of a sample costs half of
    # its turn of a path of 0.6 m.
    true, rate = read(simulator, bare.pose), read(simulator, bare.body_velocity)[2]
    np.testing.assert_allclose(read(simulator, robot.pose)[2], true[2], rtol=0, atol=6e-4)
    np.testing.assert_allclose(
        read(simulator, robot.pose)[:2], true[:2], rtol=0, atol=0.6 * 0.05 * abs(rate) + 1e-3
    )
    # A mean over 0.1 s in whole ticks of four wheels.
    np.testing.assert_allclose(
        read(simulator, robot.body_velocity),
        read(simulator, bare.body_velocity),
        rtol=0,
        atol=4 * 0.00270,
    )


def test_only_what_is_measured_is_replaced():
    _, bare, robot = driven()
    assert robot.wheel_command is bare.wheel_command
    assert robot.true_pose is bare.true_pose
    assert robot.disturbance is bare.disturbance
    assert robot.pose.get_system().get_name() == "odometry_sensor"
    assert robot.body_velocity.get_system().get_name() == "odometry_sensor"


def test_a_wrong_radius_makes_the_odometry_short():
    simulator, _, _ = driven()
    half, _, robot = driven(wheel_radius=0.0255)
    for one in (simulator, half):
        one.AdvanceTo(1.0)
    port = robot.body_velocity
    right = (
        simulator.get_system().GetSubsystemByName("odometry_sensor").GetOutputPort("body_velocity")
    )
    np.testing.assert_allclose(2 * read(half, port), read(simulator, right), rtol=1e-12)
