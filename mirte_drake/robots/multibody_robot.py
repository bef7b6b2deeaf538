"""A simulated robot of rigid bodies, whose rollers slip on a floor."""

import dataclasses as dc

import numpy as np
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    ContactModel,
    DiscreteContactApproximation,
)
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import DiscreteTimeDelay

from mirte_drake.checks import check_array, check_choice, check_number
from mirte_drake.model.drivetrain import MAX_DELAY, DrivetrainParameters
from mirte_drake.robots.floor import FrictionPatch, add_floor, check_friction, gravity_on_slope
from mirte_drake.robots.motor import MOTORS, Motor, motor_parameters
from mirte_drake.robots.planar_state import PlanarState
from mirte_drake.robots.robot_description import add_robot
from mirte_drake.vectors import WHEELS


@dc.dataclass
class MultibodyRobotConfig:
    """Config of the multibody robot; the defaults are a clean robot on a level, dry floor."""

    floor_friction: float = 0.8  # [-] Between rollers and floor. Assumption: dry and hard.
    patches: list[FrictionPatch] = dc.field(default_factory=list)  # Of another friction.
    # (2,) [rad] angle of the slope times the direction uphill, in the world frame's x and y: the
    # world frame lies in the floor.
    slope: np.ndarray = dc.field(default_factory=lambda: np.zeros(2))
    # A named set: "clean", "drifting" or "fitted". The last has the gains and the sliding friction
    # of the dynamic robot, but not its static friction: these wheels do not stick.
    motors: str = "clean"
    motor_parameters: DrivetrainParameters | None = None  # Others than the named ones.
    delay: float = 0.0  # [s] Added to that of the motors; together rounded to whole time steps.
    # [s] 32 k steps of 0.1 s / 32 are exactly the float k * 0.1, where a sensor or controller
    # samples. 20 k steps of 0.005 s are not, in the last bit: some samples come a step early or
    # late, and a velocity at a steady command differs by as much as the step's share of 0.1 s.
    # Where slip takes the true pose, behind an odometry that hides it, converges with no step: in
    # closed loop its RMSE on a circle lies anywhere in 4 to 36 mm for steps of 0.005 to 0.0008 s.
    time_step: float = 0.1 / 32
    # (3,) [m, m, rad] or null: the first pose of the reference.
    initial_pose: np.ndarray | None = None

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_friction("floor_friction", self.floor_friction)
        for i, patch in enumerate(self.patches):
            try:
                patch.validate()
            except ValueError as error:
                raise ValueError(f"patches[{i}].{error}") from None
        check_array("slope", self.slope, (2,))
        check_number("slope", float(np.linalg.norm(self.slope)), maximum=np.pi / 4)
        check_choice("motors", self.motors, tuple(MOTORS))
        if self.motor_parameters is not None:
            try:
                self.motor_parameters.validate()
            except ValueError as error:
                raise ValueError(f"motor_parameters.{error}") from None
            if self.motors != MultibodyRobotConfig.motors:
                raise ValueError(
                    f"motor_parameters: must be null with motors {self.motors!r}, which they would "
                    "replace; a delay may be added by the field delay"
                )
        check_number("delay", self.delay, minimum=0, maximum=MAX_DELAY)
        check_number("time_step", self.time_step, minimum=1e-4, maximum=0.01)
        if self.initial_pose is not None:
            check_array("initial_pose", self.initial_pose, (3,))


def AddMultibodyRobot(
    builder: DiagramBuilder,
    config: MultibodyRobotConfig,
    *,
    start: np.ndarray,
    name: str = "multibody_robot",
) -> Diagram:
    """Adds the multibody robot to ``builder`` and returns its Diagram.

    .. pydrake_system::

        name: MultibodyRobot
        input_ports:
        - wheel_command
        output_ports:
        - true_pose
        - true_body_velocity
        - wheel_angles
        - geometry_query

    ==================  ===========  ==================  ========================================
    port                type         unit                meaning
    ==================  ===========  ==================  ========================================
    wheel_command (in)  vector (4,)  [pwm]               u
    true_pose           vector (3,)  [m, m, rad]         world frame, yaw unwrapped
    true_body_velocity  vector (3,)  [m/s, m/s, rad/s]   body frame
    wheel_angles        vector (4,)  [rad]               what encoders see
    geometry_query      abstract     -                   of the SceneGraph, for a visualizer
    ==================  ===========  ==================  ========================================

    No output has feedthrough. The state moves on at multiples of ``time_step``: one who samples
    there may see it before or after its step, as rounding has it, unless both times are the same
    float, as multiples of 0.1 s are with the default.

    There is no disturbance port: what disturbs this robot is its floor.
    On a slope a stopped robot is held, but not locked: its motors give way by a small speed, and
    where friction does not hold it, it slides, with friction along the rollers' axes only.

    Contact is Drake's lagged approximation: with SAP, Drake's default, the robot loses 6 to 16 %
    of its speed where one roller takes over from another.

    Args:
        builder: The builder.
        config: The config.
        start: (3,) [m, m, rad] initial pose where the config has none; velocities begin at zero.
        name: Name of the Diagram.

    Raises:
        ValueError: when ``config`` is out of range.
    """
    config.validate()
    robot = _make_robot(config, start if config.initial_pose is None else config.initial_pose)
    return builder.AddNamedSystem(name, robot)


def _make_robot(config: MultibodyRobotConfig, pose: np.ndarray) -> Diagram:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, config.time_step)
    # A plant with sampled outputs moves on before all discrete updates: a controller that plans in
    # an unrestricted update and holds its command in a discrete one would see two states.
    plant.SetUseSampledOutputPorts(False)
    plant.set_contact_model(ContactModel.kPoint)
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kLagged)
    robot, floating = add_robot(plant)
    add_floor(plant, config.floor_friction, config.patches)
    plant.mutable_gravity_field().set_gravity_vector(gravity_on_slope(config.slope))
    plant.Finalize()
    x, y, yaw = pose
    floating.set_default_translation([x, y, 0])
    floating.set_default_angles([0, 0, yaw])

    motors = config.motor_parameters or motor_parameters(config.motors)
    motor = builder.AddNamedSystem("motor", Motor(motors, period=config.time_step))
    planar = builder.AddNamedSystem("planar_state", PlanarState(plant, robot, floating))
    builder.Connect(motor.GetOutputPort("desired_state"), plant.get_desired_state_input_port(robot))
    builder.Connect(plant.get_state_output_port(robot), planar.GetInputPort("plant_state"))
    command = motor.GetInputPort("wheel_command")
    steps = round((motors.delay + config.delay) / config.time_step)
    if steps:
        # It holds its input as well, which is one step of delay.
        delay = DiscreteTimeDelay(config.time_step, steps - 1, len(WHEELS))
        delay = builder.AddNamedSystem("command_delay", delay)
        builder.Connect(delay.get_output_port(), command)
        command = delay.get_input_port()
    builder.ExportInput(command, "wheel_command")
    for port in ("true_pose", "true_body_velocity", "wheel_angles"):
        builder.ExportOutput(planar.GetOutputPort(port), port)
    builder.ExportOutput(scene_graph.get_query_output_port(), "geometry_query")
    return builder.Build()
