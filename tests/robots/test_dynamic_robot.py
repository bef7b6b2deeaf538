import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from mirte_drake.angles import rotation
from mirte_drake.errors import UserError
from mirte_drake.geometry import wheel_speeds
from mirte_drake.model.drivetrain import DrivetrainParameters
from mirte_drake.model.dynamic_model import DynamicParameters, derivative, roll_out
from mirte_drake.model.robot_file import load_robot_file, robot_names
from mirte_drake.robots.dynamic_robot import AddDynamicRobot, DynamicRobot, DynamicRobotConfig

START = np.array([1.0, 2.0, np.pi / 2])
COMMAND = np.array([60.0, 40.0, 50.0, 70.0])
DISTURBANCE = np.array([0.04, 0.03, 0.09])


def make_dut(*, delay=0.0, pose=START, friction=1.0) -> DynamicRobot:
    drivetrain = DrivetrainParameters(friction=np.full((2, 4), friction), delay=delay)
    robot = DynamicParameters(breakaway=0.5, roller_friction=3.0, drivetrain=drivetrain)
    return DynamicRobot(robot, pose)


def make_context(dut, *, command=COMMAND, disturbance=None):
    context = dut.CreateDefaultContext()
    dut.GetInputPort("wheel_command").FixValue(context, command)
    if disturbance is not None:
        dut.GetInputPort("disturbance").FixValue(context, disturbance)
    return context


def simulate(dut, seconds, **inputs) -> Simulator:
    simulator = Simulator(dut, make_context(dut, **inputs))
    simulator.get_mutable_integrator().set_target_accuracy(1e-7)
    simulator.AdvanceTo(seconds)
    return simulator


def read(simulator, port) -> np.ndarray:
    return simulator.get_system().GetOutputPort(port).Eval(simulator.get_context())


def test_ports():
    dut = make_dut()
    inputs = {name: dut.GetInputPort(name).size() for name in ("wheel_command", "disturbance")}
    names = ("true_pose", "true_body_velocity", "wheel_angles", "state")
    outputs = {name: dut.GetOutputPort(name).size() for name in names}
    assert inputs == {"wheel_command": 4, "disturbance": 3}
    assert outputs == {"true_pose": 3, "true_body_velocity": 3, "wheel_angles": 4, "state": 14}
    assert (dut.num_input_ports(), dut.num_output_ports()) == (2, 4)


@pytest.mark.parametrize("delay", [0.0, 0.05])
def test_only_the_disturbance_is_felt_at_once(delay):
    dut = make_dut(delay=delay)
    found = {
        (i, o)
        for i in ("wheel_command", "disturbance")
        for o in ("true_pose", "true_body_velocity", "wheel_angles", "state")
        if dut.HasDirectFeedthrough(
            dut.GetInputPort(i).get_index(), dut.GetOutputPort(o).get_index()
        )
    }
    assert found == {("disturbance", "true_body_velocity")}


def test_derivative_is_the_models_and_the_wheels_follow_the_body():
    dut = make_dut()
    context = make_context(dut, disturbance=DISTURBANCE)
    state = np.concatenate([START, [0.3, 0.1, 0.4], [9.0, 8.0, 7.0, 6.0], np.arange(4)])
    context.SetContinuousState(state)
    rate = dut.EvalTimeDerivatives(context).CopyToVector()
    velocity = [0.34, 0.13, 0.49]
    np.testing.assert_allclose(rate[:3], [-0.13, 0.34, 0.49], atol=1e-15)  # At a quarter turn.
    np.testing.assert_array_equal(rate[3:10], derivative(dut._parameters, state[:10], COMMAND)[3:])
    np.testing.assert_allclose(rate[10:], wheel_speeds(np.array(velocity)))
    actual = dut.GetOutputPort("true_body_velocity").Eval(context)
    np.testing.assert_allclose(actual, velocity)


def test_it_starts_at_rest_at_the_pose():
    dut = make_dut()
    simulator = Simulator(dut, make_context(dut))
    np.testing.assert_array_equal(read(simulator, "true_pose"), START)
    np.testing.assert_array_equal(read(simulator, "true_body_velocity"), np.zeros(3))
    np.testing.assert_array_equal(read(simulator, "wheel_angles"), np.zeros(4))


def test_the_integrator_agrees_with_the_roll_out():
    dut = make_dut()
    simulator = simulate(dut, 1.0)
    start = np.concatenate([START, np.zeros(7)])
    expected = roll_out(dut._parameters, start, np.tile(COMMAND, (1000, 1)), np.full(1000, 1e-3))
    np.testing.assert_allclose(read(simulator, "state")[:10], expected[-1], atol=1e-4)
    assert np.linalg.norm(expected[-1, :2] - START[:2]) > 0.1


def test_wheel_angles_are_those_of_the_path():
    # Straight ahead by 1 / R radians a metre.
    simulator = simulate(make_dut(), 2.0, command=np.full(4, 50.0))
    travelled = read(simulator, "true_pose")[1] - START[1]
    np.testing.assert_allclose(read(simulator, "wheel_angles"), travelled / 0.051, rtol=1e-6)
    assert travelled > 0.5


def test_encoders_see_the_disturbance():
    simulator = simulate(make_dut(), 1.0, command=np.zeros(4), disturbance=[0.1, 0.0, 0.0])
    expected = START + rotation(START[2]) @ [0.1, 0.0, 0.0]
    np.testing.assert_allclose(read(simulator, "true_pose"), expected, atol=1e-9)
    np.testing.assert_allclose(read(simulator, "wheel_angles"), 0.1 / 0.051, rtol=1e-9)


@pytest.mark.parametrize("command", [np.zeros(4), np.full(4, 7.0)])
def test_below_breakaway_it_stands_still_with_large_steps(command):
    dut = make_dut()
    simulator = simulate(dut, 20.0, command=command)
    np.testing.assert_allclose(read(simulator, "true_pose"), START, atol=1e-12)
    # No chattering: an error-controlled integrator grows its steps to the largest.
    assert simulator.get_integrator().get_num_steps_taken() < 1000


def test_stopping_takes_no_tiny_steps():
    simulator = simulate(make_dut(), 1.0)
    before = simulator.get_integrator().get_num_steps_taken()
    dut, context = simulator.get_system(), simulator.get_mutable_context()
    dut.GetInputPort("wheel_command").FixValue(context, np.zeros(4))
    simulator.AdvanceTo(3.0)
    assert simulator.get_integrator().get_num_steps_taken() - before < 2000
    np.testing.assert_allclose(read(simulator, "true_body_velocity"), 0.0, atol=1e-6)


def step_response(delay, step_time) -> np.ndarray:
    """True body velocity vx every 10 ms under a command that jumps at a time."""
    builder = DiagramBuilder()
    robot = builder.AddSystem(make_dut(delay=delay, pose=np.zeros(3)))
    commands = np.array([np.zeros(4), np.full(4, 50.0), np.full(4, 50.0)]).T
    jump = PiecewisePolynomial.ZeroOrderHold([0.0, step_time, 1.0], commands)
    source = builder.AddSystem(TrajectorySource(jump))
    builder.Connect(source.get_output_port(), robot.GetInputPort("wheel_command"))
    simulator = Simulator(builder.Build())
    simulator.get_mutable_integrator().set_maximum_step_size(1e-3)
    context = robot.GetMyContextFromRoot(simulator.get_context())
    speeds = []
    for k in range(60):
        simulator.AdvanceTo(0.01 * k)
        speeds.append(robot.GetOutputPort("true_body_velocity").Eval(context)[0])
    return np.array(speeds)


@pytest.mark.parametrize("step_time", [0.1, 0.2 + 1e-9])
def test_delay_shifts_the_response(step_time):
    steps = 7
    delayed, direct = step_response(0.07, step_time), step_response(0.0, step_time)
    assert np.all(delayed[: round(step_time / 0.01) + steps] == 0)
    np.testing.assert_allclose(delayed[steps:], direct[:-steps], atol=1e-3)


def test_interleaved_simulators_do_not_disturb_each_other():
    dut = make_dut(delay=0.03)
    commands = (COMMAND, -COMMAND)
    both = [Simulator(dut, make_context(dut, command=c)) for c in commands]
    others = [make_dut(delay=0.03), make_dut(delay=0.03)]
    alone = [
        Simulator(other, make_context(other, command=c))
        for other, c in zip(others, commands, strict=True)
    ]
    for k in range(1, 4):
        for simulator in (*both, *alone):
            simulator.AdvanceTo(0.1 * k)
    states = [read(simulator, "state") for simulator in (*both, *alone)]
    np.testing.assert_array_equal(states[:2], states[2:])
    assert not np.allclose(states[0], states[1])


@pytest.mark.parametrize("name", robot_names())
def test_every_robot_of_the_fleet_drives(name):
    builder = DiagramBuilder()
    dut = AddDynamicRobot(builder, DynamicRobotConfig(robot=name), start=np.zeros(3))
    simulator = Simulator(dut, make_context(dut, command=np.full(4, 60.0)))
    simulator.AdvanceTo(2.0)
    assert 0.3 < read(simulator, "true_body_velocity")[0] < 0.8


def test_config_changes_the_robot():
    fitted = load_robot_file("fitted").parameters
    config = DynamicRobotConfig(payload=5.0, gain_factor=0.9, friction_factor=2.0, delay=0.1)
    robot = config.parameters()
    assert robot.mass == fitted.mass + 5.0 and robot.yaw_inertia > fitted.yaw_inertia
    np.testing.assert_allclose(robot.drivetrain.gain, 0.9 * fitted.drivetrain.gain)
    np.testing.assert_allclose(robot.drivetrain.friction, 2.0 * fitted.drivetrain.friction)
    assert robot.drivetrain.delay == 0.1


def test_default_config_is_the_fitted_robot():
    fitted, robot = load_robot_file("fitted").parameters, DynamicRobotConfig().parameters()
    np.testing.assert_equal(vars(robot.drivetrain), vars(fitted.drivetrain))
    assert (robot.mass, robot.roller_friction) == (fitted.mass, fitted.roller_friction)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("robot", "rocket"),
        ("robot", "nowhere.yaml"),
        ("initial_pose", np.zeros(2)),
        ("payload", -1.0),
        ("gain_factor", 0.0),
        ("friction_factor", -0.1),
        ("delay", -0.1),
    ],
)
def test_rejects_bad_config(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        AddDynamicRobot(DiagramBuilder(), DynamicRobotConfig(**{field: value}), start=START)


def test_rejects_a_bad_pose():
    with pytest.raises(ValueError, match=r"^initial_pose: "):
        make_dut(pose=np.array([0.0, np.nan, 0.0]))


def test_unknown_robot_names_the_known_ones():
    with pytest.raises(UserError, match="'rocket' is not known: use one of clean, fitted"):
        DynamicRobotConfig(robot="rocket").validate()


def test_add_names_the_system_and_places_it():
    builder = DiagramBuilder()
    first = AddDynamicRobot(builder, DynamicRobotConfig(), start=START, name="mirte")
    pose = np.array([4.0, 5.0, 6.0])
    second = AddDynamicRobot(builder, DynamicRobotConfig(initial_pose=pose), start=START)
    diagram = builder.Build()
    assert diagram.GetSubsystemByName("mirte") is first
    assert diagram.GetSubsystemByName("dynamic_robot") is second
    for dut, expected in ((first, START), (second, pose)):
        actual = dut.GetOutputPort("true_pose").Eval(dut.CreateDefaultContext())
        np.testing.assert_array_equal(actual, expected)
