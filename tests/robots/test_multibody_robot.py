"""MultibodyRobot; RANDOM_DRIVE=600 in the environment drives it at random for ten minutes."""

import os
import time

import numpy as np
import pytest
from pydrake.geometry import Meshcat, MeshcatVisualizer
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder

from mirte_drake.angles import rotation
from mirte_drake.geometry import PWM_SPEED, WHEEL_RADIUS, body_velocity
from mirte_drake.model.drivetrain import DrivetrainParameters
from mirte_drake.robots.floor import GRAVITY, FrictionPatch
from mirte_drake.robots.multibody_robot import AddMultibodyRobot, MultibodyRobotConfig
from mirte_drake.typed_yaml import parse_typed
from mirte_drake.vectors import YAW

FORWARD = 50.0 * np.array([1, 1, 1, 1])  # [pwm]
LEFT = 50.0 * np.array([-1, 1, -1, 1])
TURN = 50.0 * np.array([-1, 1, 1, -1])  # Counter-clockwise.
FORWARD_LEFT = 50.0 * np.array([0, 1, 0, 1])
FORWARD_RIGHT = 50.0 * np.array([1, 0, 1, 0])
STOP = np.zeros(4)
RANDOM_DRIVE = float(os.environ.get("RANDOM_DRIVE", "60"))  # [s]


class Drive:
    """A robot, alone in its Diagram, that is driven by hand."""

    def __init__(self, diagram: Diagram | None = None, **config):
        self.simulator = Simulator(diagram or make_diagram(**config))
        self.dut = self.simulator.get_system().GetSubsystemByName("multibody_robot")
        self.context = self.dut.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())

    def run(self, command, duration, every=0.05) -> dict[str, np.ndarray]:
        """Holds a command; returns samples of the outputs at the ends of equal steps."""
        self.dut.GetInputPort("wheel_command").FixValue(self.context, command)
        begin, steps = self.context.get_time(), round(duration / every)
        samples = []
        for k in range(1, steps + 1):
            self.simulator.AdvanceTo(begin + k * every)
            samples.append([self.read("true_pose"), self.read("true_body_velocity")])
        pose, velocity = np.swapaxes(samples, 0, 1)
        return {"pose": pose, "velocity": velocity}

    def read(self, port: str) -> np.ndarray:
        return self.dut.GetOutputPort(port).Eval(self.context)


def make_diagram(*, start=(0.0, 0.0, 0.0), **config) -> Diagram:
    builder = DiagramBuilder()
    AddMultibodyRobot(builder, MultibodyRobotConfig(**config), start=np.array(start))
    return builder.Build()


def steady_velocity(command, **config) -> np.ndarray:
    """Mean body velocity over a second, after the motors have settled."""
    drive = Drive(**config)
    drive.run(command, 1.0, every=1.0)
    return drive.run(command, 1.0, every=0.02)["velocity"].mean(axis=0)


def odometry_yaw(angles: np.ndarray) -> float:
    """Yaw that wheel angles (4,) stand for, since they were zero."""
    return body_velocity(angles)[YAW]


def test_ports():
    dut = Drive().dut
    assert dut.GetInputPort("wheel_command").size() == 4
    sizes = {"true_pose": 3, "true_body_velocity": 3, "wheel_angles": 4}
    assert {name: dut.GetOutputPort(name).size() for name in sizes} == sizes
    assert dut.HasOutputPort("geometry_query")
    assert (dut.num_input_ports(), dut.num_output_ports()) == (1, 4)
    assert not dut.HasAnyDirectFeedthrough()


def test_add_names_the_diagram_and_returns_it():
    builder = DiagramBuilder()
    config = MultibodyRobotConfig()
    robot = AddMultibodyRobot(builder, config, start=np.zeros(3), name="mirte")
    assert builder.Build().GetSubsystemByName("mirte") is robot


def test_a_visualizer_connects_from_outside():
    builder, meshcat = DiagramBuilder(), Meshcat()
    robot = AddMultibodyRobot(builder, MultibodyRobotConfig(), start=np.zeros(3))
    MeshcatVisualizer.AddToBuilder(builder, robot.GetOutputPort("geometry_query"), meshcat)
    diagram = builder.Build()
    diagram.ForcedPublish(diagram.CreateDefaultContext())
    for link in ("base_link", "front_left_wheel", "rear_right_roller_9"):
        assert meshcat.HasPath(f"/drake/visualizer/mirte_master/{link}")


@pytest.mark.parametrize(
    ("command", "least_share"),
    [(FORWARD, 0.97), (LEFT, 0.90), (TURN, 0.95), (FORWARD_LEFT, 0.95), (FORWARD_RIGHT, 0.95)],
)
def test_steady_motion_is_nearly_that_of_the_kinematics(command, least_share):
    ideal = body_velocity(PWM_SPEED * command)
    actual = steady_velocity(command)
    share = actual @ ideal / (ideal @ ideal)
    assert least_share <= share <= 1.005
    # What is not along the ideal motion, against its speed.
    assert np.linalg.norm(actual - share * ideal) < 0.01 * np.linalg.norm(ideal)


@pytest.mark.parametrize(("command", "axis"), [(FORWARD, 0), (LEFT, 1), (TURN, 2)])
def test_backwards_is_the_reverse(command, axis):
    there, back = steady_velocity(command), steady_velocity(-command)
    assert there[axis] > 0
    np.testing.assert_allclose(back, -there, atol=0.01 * there[axis])


def test_begins_at_the_start_and_stays_there():
    drive = Drive(start=(1.0, -2.0, 3.0))
    np.testing.assert_array_equal(drive.read("true_pose"), [1.0, -2.0, 3.0])
    np.testing.assert_array_equal(drive.read("wheel_angles"), np.zeros(4))
    drive.run(STOP, 1.0)
    np.testing.assert_allclose(drive.read("true_pose"), [1.0, -2.0, 3.0], atol=1e-4)
    np.testing.assert_allclose(drive.read("true_body_velocity"), np.zeros(3), atol=1e-4)


def test_initial_pose_of_the_config_goes_before_the_start():
    drive = Drive(initial_pose=np.array([4.0, 5.0, 6.0]), start=(1.0, 2.0, 3.0))
    np.testing.assert_array_equal(drive.read("true_pose"), [4.0, 5.0, 6.0])


def test_body_velocity_is_the_derivative_of_the_pose_in_the_body_frame():
    drive = Drive(start=(0.0, 0.0, 2.0))
    command = FORWARD + 0.2 * TURN
    drive.run(command, 1.0)
    before = drive.read("true_pose")
    pose, velocity = drive.run(command, 0.1, every=0.0125).values()
    middle_yaw = (before[YAW] + pose[-1][YAW]) / 2
    mean = rotation(middle_yaw).T @ (pose[-1] - before) / 0.1
    np.testing.assert_allclose(velocity.mean(axis=0), mean, atol=2e-3)


def test_yaw_does_not_wrap_over_many_turns():
    drive = Drive(start=(0.0, 0.0, 3.0))
    yaw = drive.run(2 * TURN, 5.0)["pose"][:, YAW]
    assert yaw[-1] > 3.0 + 3 * 2 * np.pi
    assert np.all(np.diff(yaw) > 0)
    assert np.diff(yaw).max() < 0.3  # No jump of a turn.


def test_wheel_angles_are_what_the_motors_turn():
    drive = Drive()
    drive.run(LEFT, 1.0)
    before = drive.read("wheel_angles")
    drive.run(LEFT, 1.0)
    turned = drive.read("wheel_angles") - before
    np.testing.assert_allclose(turned, PWM_SPEED * LEFT, rtol=0.01)


def rectangle_commands(recordings=None) -> list[tuple[np.ndarray, float]]:
    """Commands and durations [s] of the constant-heading rectangle."""
    if recordings is None:
        return [(FORWARD, 4.0), (LEFT, 2.0), (-FORWARD, 4.0), (-LEFT, 2.0)]
    columns = ["Left_Front_Input", "Right_Front_Input", "Right_Rear_Input", "Left_Rear_Input"]
    data = np.genfromtxt(recordings / "validation_const_rect.csv", delimiter=",", names=True)
    commands = np.stack([data[column] for column in columns], axis=1)
    return [(command, 0.1) for command in commands]


def drive_rectangle(commands, motors="drifting", **config) -> tuple[Drive, float]:
    """Drives the rectangle; returns also the peak of the yaw rate in lateral motion."""
    drive, peak = Drive(motors=motors, **config), 0.0
    for command, duration in commands:
        yaw_before = drive.read("true_pose")[YAW]
        yaw = drive.run(command, duration, every=0.1)["pose"][:, YAW]
        if command[0] == -command[1]:
            # As recorded: means over 0.1 s.
            rates = np.diff(yaw, prepend=yaw_before) / 0.1
            peak = max(peak, np.abs(rates).max())
    return drive, peak


def test_drifting_robot_turns_on_the_recorded_rectangle_as_the_thesis_saw(recordings):
    drive, peak = drive_rectangle(rectangle_commands(recordings))
    assert drive.read("true_pose")[YAW] == pytest.approx(0.7, abs=0.15)
    assert peak == pytest.approx(0.3, abs=0.05)


def test_gains_of_the_fitted_robot_turn_it_by_less(recordings):
    """What the recordings alone give, with all that the fit puts down to friction."""
    drive, peak = drive_rectangle(rectangle_commands(recordings), motors="fitted")
    assert drive.read("true_pose")[YAW] == pytest.approx(0.44, abs=0.02)
    assert peak == pytest.approx(0.145, abs=0.01)


def test_drifting_robot_turns_on_the_rectangle_with_left_first_too():
    drive, peak = drive_rectangle(rectangle_commands())
    assert drive.read("true_pose")[YAW] == pytest.approx(0.7, abs=0.15)
    assert peak == pytest.approx(0.3, abs=0.05)


def test_odometry_and_truth_part_on_a_slippery_floor():
    parted = {}
    for friction in (0.8, 0.05):
        drive, _ = drive_rectangle(rectangle_commands(), floor_friction=friction)
        yaw = odometry_yaw(drive.read("wheel_angles"))
        parted[friction] = abs(drive.read("true_pose")[YAW] - yaw)
    assert parted[0.8] < 0.1
    assert parted[0.05] > 0.2


def test_clean_robot_drives_a_rectangle_without_turning():
    drive = Drive()
    for command, duration in rectangle_commands():
        drive.run(command, duration / 4)
    assert abs(drive.read("true_pose")[YAW]) < 0.01
    np.testing.assert_allclose(drive.read("true_pose")[:2], 0.0, atol=0.1)


def test_low_friction_patch_below_the_left_wheels_turns_the_robot_to_the_left():
    patch = FrictionPatch(center=np.array([0.0, 0.135]), size=np.array([2.0, 0.1]), friction=0.05)
    plain, patched = Drive().run(FORWARD, 1.0), Drive(patches=[patch]).run(FORWARD, 1.0)
    assert abs(plain["pose"][-1][YAW]) < 1e-3
    assert patched["pose"][-1][YAW] > 0.3


def test_patch_elsewhere_changes_nothing():
    patch = FrictionPatch(center=np.array([50.0, 0.0]), friction=0.05)
    plain, patched = Drive().run(FORWARD, 0.5), Drive(patches=[patch]).run(FORWARD, 0.5)
    np.testing.assert_allclose(patched["pose"], plain["pose"], atol=1e-9)


def test_driving_onto_a_patch_is_no_bump():
    patch = FrictionPatch(center=np.array([1.0, 0.0]), friction=0.8)
    velocity = Drive(patches=[patch]).run(FORWARD, 2.5, every=0.01)["velocity"][100:]
    ideal = 50 * PWM_SPEED * WHEEL_RADIUS
    np.testing.assert_allclose(velocity[:, 0], ideal, rtol=0.03)


def test_stopped_robot_creeps_on_a_slope_by_what_its_motors_give_way():
    # A motor holds by a speed error; that and the contact's creep are below 1 cm/s at 0.1 rad.
    for slope, axis in (([0.1, 0.0], 0), ([0.0, 0.1], 1)):
        velocity = Drive(slope=np.array(slope)).run(STOP, 1.0)["velocity"][-1]
        assert -0.01 < velocity[axis] < 0.0
        np.testing.assert_allclose(np.delete(velocity, axis), 0.0, atol=1e-3)


@pytest.mark.parametrize(("slope", "axis"), [([0.1, 0.0], 0), ([0.0, 0.1], 1)])
def test_stopped_robot_slides_down_a_slippery_slope(slope, axis):
    # Rollers are held along their axes only, at 45 degrees: friction acts by its cosine.
    expected = -GRAVITY * (np.sin(0.1) - 0.05 * np.cos(0.1) / np.sqrt(2))
    velocity = Drive(slope=np.array(slope), floor_friction=0.05).run(STOP, 1.0)["velocity"]
    acceleration = (velocity[-1] - velocity[9])[axis] / 0.5
    assert acceleration == pytest.approx(expected, rel=0.05)


def test_runs_are_equal_bit_for_bit():
    command = np.array([80.0, -30.0, 55.0, 20.0])
    first, second = (Drive(floor_friction=0.3).run(command, 1.0) for _ in range(2))
    np.testing.assert_array_equal(first["pose"], second["pose"])


def test_interleaved_simulators_do_not_disturb_each_other():
    diagram = make_diagram()
    commands = (FORWARD, TURN)
    both = [Drive(diagram), Drive(diagram)]
    alone = [Drive(), Drive()]
    for _ in range(4):
        for drive, command in zip((*both, *alone), (*commands, *commands), strict=True):
            drive.run(command, 0.1)
    for shared, own in zip(both, alone, strict=True):
        for port in ("true_pose", "true_body_velocity", "wheel_angles"):
            np.testing.assert_array_equal(shared.read(port), own.read(port))
    assert not np.allclose(both[0].read("true_pose"), both[1].read("true_pose"))


def test_delay_of_the_drivetrain_shifts_the_motion():
    command, lag = np.full(4, 50.0), np.full(4, 0.16)
    late = Drive(motor_parameters=DrivetrainParameters(lag=lag, delay=0.03), delay=0.02)
    prompt = Drive(motor_parameters=DrivetrainParameters(lag=lag))
    moved = late.run(command, 0.35, every=0.0125)["pose"][:, 0]
    expected = prompt.run(command, 0.3, every=0.0125)["pose"][:, 0]
    np.testing.assert_allclose(moved[4:], expected, rtol=0, atol=1e-5)
    assert np.abs(moved[:4]).max() < 1e-6 and moved[-1] > 0.05


def test_delay_is_added_to_the_named_motors():
    late, prompt = Drive(motors="drifting", delay=0.1), Drive(motors="drifting")
    moved, expected = late.run(FORWARD, 0.6, every=0.1), prompt.run(FORWARD, 0.5, every=0.1)
    np.testing.assert_allclose(moved["pose"][1:], expected["pose"], rtol=0, atol=1e-5)
    assert moved["pose"][-1, 0] > 0.1


def test_config_loads_from_yaml():
    text = """
        floor_friction: 0.3
        patches:
        - {center: [1.0, 2.0], size: [0.5, 0.5], friction: 0.05}
        slope: [0.0, 0.1]
        motor_parameters: {lag: [0.1, 0.1, 0.1, 0.2]}
        """
    config = parse_typed(MultibodyRobotConfig, text, "test")
    config.validate()
    assert config.patches[0].friction == 0.05
    assert config.motor_parameters.lag[3] == 0.2


@pytest.mark.parametrize(
    ("field", "config"),
    [
        ("floor_friction", {"floor_friction": 0.0}),
        ("floor_friction", {"floor_friction": np.nan}),
        ("patches[0].size", {"patches": [FrictionPatch(size=np.zeros(2))]}),
        ("slope", {"slope": np.zeros(3)}),
        ("slope", {"slope": np.array([1.0, 0.0])}),
        ("motors", {"motors": "dirty"}),
        ("motor_parameters.lag", {"motor_parameters": DrivetrainParameters(lag=np.zeros(4))}),
        (
            "motor_parameters",
            {"motor_parameters": DrivetrainParameters(), "motors": "drifting"},
        ),
        ("delay", {"delay": -0.1}),
        ("time_step", {"time_step": 0.0}),
        ("time_step", {"time_step": 0.1}),
        ("initial_pose", {"initial_pose": np.zeros(2)}),
    ],
)
def test_rejects_bad_config(field, config):
    with pytest.raises(ValueError) as error:
        make_diagram(**config)
    assert str(error.value).startswith(f"{field}: ")


def random_drive(friction: float, duration: float) -> Drive:
    """Drives at random, with a new command each 0.3 s; checks that the robot stays on the floor."""
    rng = np.random.default_rng(7)
    patch = FrictionPatch(center=np.array([0.3, 0.3]), friction=0.1)
    drive = Drive(floor_friction=friction, motors="drifting", patches=[patch])
    for _ in range(round(duration / 0.3)):
        command = rng.uniform(-100, 100, 4)
        samples = drive.run(command, 0.3, every=0.3)
        speed = np.linalg.norm(samples["velocity"][-1][:2])
        assert speed < 1.5 * 100 * PWM_SPEED * WHEEL_RADIUS
    plant = drive.dut.GetSubsystemByName("plant")
    context = plant.GetMyContextFromRoot(drive.simulator.get_context())
    pose = plant.GetBodyByName("base_link").EvalPoseInWorld(context)
    assert abs(pose.translation()[2]) < 1e-3
    np.testing.assert_allclose(pose.rotation().matrix()[2], [0, 0, 1], atol=0.02)
    return drive


@pytest.mark.parametrize("friction", [0.05, 0.3, 0.8])
def test_drives_at_random(friction):
    drive = random_drive(friction, 6.0)
    assert drive.context.get_time() == pytest.approx(6.0)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.05, 0.3, 0.8])
def test_drives_at_random_for_long_three_times_faster_than_real_time(friction):
    begin = time.process_time()
    drive = random_drive(friction, RANDOM_DRIVE)
    assert drive.context.get_time() > 3 * (time.process_time() - begin)
