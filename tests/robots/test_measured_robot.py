import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from mirte_drake.robots.dynamic_robot import DynamicRobotConfig
from mirte_drake.robots.measured_robot import AddMeasuredRobot, MakeMeasuredRobot
from mirte_drake.robots.multibody_robot import MultibodyRobotConfig
from mirte_drake.robots.odometry_sensor import OdometrySensorConfig, body_increment
from mirte_drake.robots.sindyc_robot import SindycRobotConfig

ROBOTS = {
    "sindyc_robot": SindycRobotConfig,
    "dynamic_robot": DynamicRobotConfig,
    "multibody_robot": MultibodyRobotConfig,
}
START = np.array([1.0, 2.0, 0.5])
robots = pytest.mark.parametrize("name", ROBOTS)


def make(name, start=START, seed=0, config=None, **odometry):
    odometry = OdometrySensorConfig(**odometry)
    return MakeMeasuredRobot(config or ROBOTS[name](), odometry, start=start, seed=seed)


def drive(dut, command, duration) -> Simulator:
    simulator = Simulator(dut)
    dut.GetInputPort("wheel_command").FixValue(simulator.get_mutable_context(), command)
    simulator.AdvanceTo(duration)
    return simulator


def read(simulator, port) -> np.ndarray:
    return simulator.get_system().GetOutputPort(port).Eval(simulator.get_context())


@robots
def test_ports_are_the_documented_ones(name):
    dut = make(name)
    assert dut.get_name() == name
    inputs = {dut.get_input_port(i).get_name() for i in range(dut.num_input_ports())}
    outputs = {dut.get_output_port(i).get_name() for i in range(dut.num_output_ports())}
    bodies = name == "multibody_robot"
    assert inputs == {"wheel_command"} | (set() if bodies else {"disturbance"})
    assert outputs == {"pose", "body_velocity", "true_pose", "wheel_angles"} | (
        {"geometry_query"} if bodies else set()
    )
    for port in ("pose", "body_velocity", "true_pose"):
        assert dut.GetOutputPort(port).size() == 3
    assert {system.get_name() for system in dut.GetSystems()} >= {"motion", "odometry_sensor"}


@robots
def test_begins_at_the_start_with_odometry_and_truth(name):
    config = ROBOTS[name](initial_pose=np.array([3.0, -1.0, 2.0]))
    for dut, expected in ((make(name), START), (make(name, config=config), config.initial_pose)):
        simulator = Simulator(dut)
        dut.GetInputPort("wheel_command").FixValue(simulator.get_mutable_context(), np.zeros(4))
        np.testing.assert_array_equal(read(simulator, "pose"), expected)
        np.testing.assert_allclose(read(simulator, "true_pose"), expected, atol=1e-12)


@robots
@pytest.mark.parametrize(
    ("command", "direction"),
    [
        ([50, 50, 50, 50], [1, 0, 0]),
        ([-50, 50, -50, 50], [0, 1, 0]),
        ([-50, 50, 50, -50], [0, 0, 1]),
        ([0, 50, 0, 50], [1, 1, 0]),
    ],
    ids=["forward", "left", "counter_clockwise", "diagonal"],
)
def test_every_robot_moves_where_it_is_sent(name, command, direction):
    """Signs of all, whatever gains and friction make of the size; odometry and truth alike."""
    simulator = drive(make(name, start=np.zeros(3)), np.array(command, dtype=float), 1.0)
    for port in ("true_pose", "pose"):
        moved = read(simulator, port)
        wanted = np.array(direction, dtype=bool)
        assert np.all(moved[wanted] > 0.05)
        # The fitted robots drift, sideways the most.
        assert np.all(np.abs(moved[:2][~wanted[:2]]) < 0.5 * moved[wanted].max())
    assert np.all(read(simulator, "body_velocity")[wanted] > 0.05)


@robots
def test_odometry_follows_the_truth_where_wheels_do_not_slip(name):
    simulator = drive(make(name, start=np.zeros(3)), np.array([50.0, 50.0, 50.0, 50.0]), 2.0)
    # One tick is 0.24 mm at the rim; rollers slip by some per cent, and SINDYc's yaw rate turns
    # the path by what rounding of the yaw costs.
    np.testing.assert_allclose(read(simulator, "pose"), read(simulator, "true_pose"), atol=0.03)


def test_samples_of_the_multibody_robot_come_at_its_steps():
    """No sample is a step early or late: at a steady command all are as far apart."""
    config = OdometrySensorConfig()
    simulator = drive(make("multibody_robot", start=np.zeros(3)), np.full(4, 50.0), 1.5)
    velocity, x = [], []
    for k in range(16, 61):
        simulator.AdvanceTo(k * 0.1)
        velocity.append(read(simulator, "body_velocity")[0])
        x.append(read(simulator, "true_pose")[0])
    quantum = body_increment(np.ones(4), config)[0] / config.period
    assert np.ptp(velocity) <= 1.1 * quantum
    np.testing.assert_allclose(np.diff(x), np.diff(x).mean(), rtol=1e-3)


@robots
def test_seed_is_that_of_the_jitter(name):
    command = np.array([60.0, 40.0, 60.0, 40.0])
    first, again, other = (
        drive(make(name, seed=seed, jitter=0.012), command, 0.75) for seed in (1, 1, 2)
    )
    for port in ("pose", "body_velocity"):
        np.testing.assert_array_equal(read(first, port), read(again, port))
        assert np.any(read(first, port) != read(other, port))
    np.testing.assert_array_equal(read(first, "true_pose"), read(other, "true_pose"))


@robots
def test_interleaved_simulators_do_not_disturb_each_other(name):
    dut = make(name)
    commands = [np.array([60.0, 40.0, 60.0, 40.0]), np.full(4, -50.0)]
    both = [drive(dut, command, 0.0) for command in commands]
    alone = [drive(make(name), command, 0.0) for command in commands]
    for k in range(1, 4):
        for simulator in (*both, *alone):
            simulator.AdvanceTo(0.1 * k)
    for shared, own in zip(both, alone, strict=True):
        for port in ("pose", "true_pose", "body_velocity"):
            np.testing.assert_array_equal(read(shared, port), read(own, port))


@robots
def test_add_returns_the_ports_of_the_diagram(name):
    builder = DiagramBuilder()
    ports = AddMeasuredRobot(builder, ROBOTS[name](), OdometrySensorConfig(), start=START)
    robot = builder.GetSubsystemByName(name)
    assert ports.wheel_command is robot.GetInputPort("wheel_command")
    for port in ("pose", "body_velocity", "true_pose"):
        assert getattr(ports, port) is robot.GetOutputPort(port)
    assert (ports.disturbance is None) == (name == "multibody_robot")


@robots
def test_rejects_bad_odometry(name):
    with pytest.raises(ValueError, match=r"^jitter: "):
        make(name, jitter=-1.0)
