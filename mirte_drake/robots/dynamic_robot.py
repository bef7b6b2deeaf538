"""A simulated robot with motors, inertia and friction: Newton's model behind the drivetrain."""

import dataclasses as dc

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
)

from mirte_drake.angles import rotation
from mirte_drake.checks import check_array, check_number
from mirte_drake.errors import UserError
from mirte_drake.geometry import wheel_speeds
from mirte_drake.model.drivetrain import MAX_DELAY
from mirte_drake.model.dynamic_model import (
    BODY_VELOCITY,
    STATE_SIZE,
    DynamicParameters,
    derivative,
)
from mirte_drake.model.fleet import loaded, scaled
from mirte_drake.model.robot_file import load_robot_file
from mirte_drake.vectors import POSE, POSE_SIZE, WHEELS, YAW

DELAY_STEP = 0.01  # [s] Delays are whole numbers of these.


@dc.dataclass
class DynamicRobotConfig:
    """Config of DynamicRobot."""

    robot: str = "fitted"  # Name of a robot that comes with the package, or path of a YAML file.
    # (3,) [m, m, rad] or null: the first pose of the reference.
    initial_pose: np.ndarray | None = None
    payload: float = 0.0  # [kg] Added to the robot's mass, between its wheels.
    gain_factor: float = 1.0  # On the gains of all wheels.
    friction_factor: float = 1.0  # On the friction of wheels and rollers.
    delay: float | None = None  # [s] Instead of the robot's, in steps of 0.01 s.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        try:
            load_robot_file(self.robot)
        except UserError as error:
            raise UserError(f"robot: {error}") from None
        if self.initial_pose is not None:
            check_array("initial_pose", self.initial_pose, (3,))
        check_number("payload", self.payload, minimum=0)
        check_number("gain_factor", self.gain_factor, above=0)
        check_number("friction_factor", self.friction_factor, minimum=0)
        if self.delay is not None:
            check_number("delay", self.delay, minimum=0, maximum=MAX_DELAY)

    def parameters(self) -> DynamicParameters:
        """Returns the parameters of the robot that is configured."""
        robot = load_robot_file(self.robot).parameters
        robot = scaled(
            robot,
            gain=self.gain_factor,
            friction=self.friction_factor,
            rollers=self.friction_factor,
        )
        robot = loaded(robot, self.payload)
        if self.delay is not None:
            robot.drivetrain.delay = self.delay
        return robot


class DynamicRobot(LeafSystem):
    """Integrates the dynamic model in continuous time, and what the encoders see of it.

    .. pydrake_system::

        name: DynamicRobot
        input_ports:
        - wheel_command
        - disturbance
        output_ports:
        - true_pose
        - true_body_velocity
        - wheel_angles
        - state

    ==================  ============  ==================  ====================================
    port                type          unit                meaning
    ==================  ============  ==================  ====================================
    wheel_command (in)  vector (4,)   [pwm]               u, before delay and saturation
    disturbance (in)    vector (3,)   [m/s, m/s, rad/s]   w, body frame; open: zero
    true_pose           vector (3,)   [m, m, rad]         world frame, yaw unwrapped
    true_body_velocity  vector (3,)   [m/s, m/s, rad/s]   v + w
    wheel_angles        vector (4,)   [rad]               turned since the start
    state               vector (14,)  [m, rad, s]         of ``dynamic_model``, wheel angles
    ==================  ============  ==================  ====================================

    The pose moves by R(yaw) (v + w). Wheels do not slip in this model, so they turn with v + w
    too, as in the recordings that w is estimated from, where odometry saw it. Only
    ``true_body_velocity`` has feedthrough, from ``disturbance``.

    An integrator with a target accuracy of 0.01 is enough: over 3 s of random commands its pose
    is within 0.1 mm and 0.1 mrad of that at 0.0001, at a quarter of the steps.

    Delay: the command is read just before each full DELAY_STEP, so that one that changes there
    takes effect whole steps later, whichever of two simultaneous updates comes first.
    """

    def __init__(self, parameters: DynamicParameters, initial_pose: np.ndarray) -> None:
        """Declares ports and state; the robot starts at rest.

        Args:
            parameters: The robot.
            initial_pose: (3,) [m, m, rad].

        Raises:
            ValueError: when a parameter or the pose is out of range.
        """
        super().__init__()
        parameters.validate()
        check_array("initial_pose", initial_pose, (POSE_SIZE,))
        self._parameters = parameters
        self._command_input = self.DeclareVectorInputPort("wheel_command", len(WHEELS))
        self._disturbance_input = self.DeclareVectorInputPort("disturbance", POSE_SIZE)
        start = np.zeros(STATE_SIZE + len(WHEELS))
        start[POSE] = initial_pose
        state = self.DeclareContinuousState(BasicVector(start))
        x = {self.xc_ticket()}
        self.DeclareVectorOutputPort("true_pose", POSE_SIZE, self._calc_true_pose, x)
        self.DeclareVectorOutputPort(
            "true_body_velocity",
            POSE_SIZE,
            self._calc_true_body_velocity,
            x | {self._disturbance_input.ticket()},
        )
        self.DeclareVectorOutputPort("wheel_angles", len(WHEELS), self._calc_wheel_angles, x)
        self.DeclareStateOutputPort("state", state)
        self._delay_steps = round(parameters.drivetrain.delay / DELAY_STEP)
        if self._delay_steps:
            self.DeclareDiscreteState(np.zeros(self._delay_steps * len(WHEELS)))
            self.DeclarePeriodicDiscreteUpdateEvent(
                DELAY_STEP, 0.999 * DELAY_STEP, self._shift_commands
            )

    def DoCalcTimeDerivatives(self, context: Context, derivatives: ContinuousState) -> None:
        """Gives the model's derivative, moved on by w, and the wheels' speeds."""
        x = context.get_continuous_state_vector().CopyToVector()
        rate = derivative(self._parameters, x[:STATE_SIZE], self._delayed_command(context))
        if self._disturbance_input.HasValue(context):
            rate[POSE] += rotation(x[YAW]) @ self._disturbance_input.Eval(context)
        rolling = wheel_speeds(self._velocity(context))
        derivatives.SetFromVector(np.concatenate([rate, rolling]))

    def _velocity(self, context: Context) -> np.ndarray:
        """Returns v + w (3,)."""
        velocity = context.get_continuous_state_vector().CopyToVector()[BODY_VELOCITY]
        if self._disturbance_input.HasValue(context):
            velocity = velocity + self._disturbance_input.Eval(context)
        return velocity

    def _delayed_command(self, context: Context) -> np.ndarray:
        if self._delay_steps:
            return context.get_discrete_state_vector().value()[: len(WHEELS)]
        return self._command_input.Eval(context)

    def _shift_commands(self, context: Context, next_state: DiscreteValues) -> None:
        older = context.get_discrete_state_vector().value()[len(WHEELS) :]
        next_state.set_value(np.concatenate([older, self._command_input.Eval(context)]))

    def _calc_true_pose(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_continuous_state_vector().CopyToVector()[POSE])

    def _calc_true_body_velocity(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._velocity(context))

    def _calc_wheel_angles(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_continuous_state_vector().CopyToVector()[STATE_SIZE:])


def AddDynamicRobot(
    builder: DiagramBuilder,
    config: DynamicRobotConfig,
    *,
    start: np.ndarray,
    name: str = "dynamic_robot",
) -> DynamicRobot:
    """Adds a DynamicRobot to ``builder``; the caller connects its ports.

    Args:
        builder: The builder.
        config: The config.
        start: (3,) [m, m, rad] initial pose where the config has none.
        name: Name of the system.

    Raises:
        ValueError: when ``config`` is out of range.
    """
    config.validate()
    pose = start if config.initial_pose is None else config.initial_pose
    return builder.AddNamedSystem(name, DynamicRobot(config.parameters(), pose))
