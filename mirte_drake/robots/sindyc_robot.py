"""A simulated robot that moves as an identified model says, plus a disturbance (4-1)."""

import dataclasses as dc
from typing import Any

import numpy as np
from pydrake.systems.framework import BasicVector_, DiagramBuilder, LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from mirte_drake.checks import check_array
from mirte_drake.errors import UserError
from mirte_drake.model.model_file import load_model
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.robots.robot_ports import RobotPorts
from mirte_drake.vectors import POSE, POSE_SIZE, WHEELS, YAW


@dc.dataclass
class SindycRobotConfig:
    """Config of SindycRobot."""

    model: str = "extended_kinematic"  # Name of an identified model, or path of a YAML file.
    # (3,) [m, m, rad] or null: the first pose of the reference.
    initial_pose: np.ndarray | None = None

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        try:
            inputs = load_model(self.model).num_inputs
        except UserError as error:
            raise UserError(f"model: {error}") from None
        if inputs != len(WHEELS):
            raise UserError(f"model: {self.model!r} must have {len(WHEELS)} inputs, got {inputs}")
        if self.initial_pose is not None:
            check_array("initial_pose", self.initial_pose, (3,))


def _turn(
    yaw: Any,  # noqa: ANN401
    vector: np.ndarray,
    direction: int,
) -> list:
    """Returns R(yaw) v (direction 1) or R(yaw)' v (direction -1), for any scalar type."""
    cos, sin = np.cos(yaw), direction * np.sin(yaw)
    return [
        cos * vector[0] - sin * vector[1],
        sin * vector[0] + cos * vector[1],
        vector[YAW],
    ]


@TemplateSystem.define("SindycRobot_")
def SindycRobot_(T):  # noqa: ANN001, ANN201
    """Template of SindycRobot over the scalar types float, AutoDiffXd and Expression."""

    class Impl(LeafSystem_[T]):
        """Integrates xdot = f(x, u) + R(yaw) w in continuous time.

        .. pydrake_system::

            name: SindycRobot
            input_ports:
            - wheel_command
            - disturbance
            output_ports:
            - pose
            - state
            - body_velocity

        ==================  ===========  ==================  ================================
        port                type         unit                meaning
        ==================  ===========  ==================  ================================
        wheel_command (in)  vector (4,)  [pwm]               u
        disturbance (in)    vector (3,)  [m/s, m/s, rad/s]   w, body frame; open: zero
        pose                vector (3,)  [m, m, rad]         world frame, yaw unwrapped
        state               vector (n,)  model's             continuous state x
        body_velocity       vector (3,)  [m/s, m/s, rad/s]   R(yaw)' times the pose's derivative
        ==================  ===========  ==================  ================================

        ``pose`` and ``state`` have no feedthrough. Of a dynamic model the disturbance moves the
        pose, not the velocity states.
        """

        def _construct(
            self, model: PredictionModel, initial_state: np.ndarray, converter: object = None
        ) -> None:
            LeafSystem_[T].__init__(self, converter=converter)
            self._model, self._initial_state = model, np.array(initial_state, dtype=float)
            n = model.num_states
            check_array("initial_state", self._initial_state, (n,))
            self._command_input = self.DeclareVectorInputPort("wheel_command", model.num_inputs)
            self._disturbance_input = self.DeclareVectorInputPort("disturbance", 3)
            state = self.DeclareContinuousState(BasicVector_[T](self._initial_state))
            x = {self.xc_ticket()}
            self.DeclareVectorOutputPort("pose", 3, self._calc_pose, x)
            self.DeclareStateOutputPort("state", state)
            self.DeclareVectorOutputPort(
                "body_velocity",
                3,
                self._calc_body_velocity,
                x | {self._command_input.ticket(), self._disturbance_input.ticket()},
            )

        def _construct_copy(self, other: object, converter: object = None) -> None:
            Impl._construct(self, other._model, other._initial_state, converter)  # type: ignore[attr-defined]

        def _derivative(self, context) -> np.ndarray:  # noqa: ANN001
            x = context.get_continuous_state_vector().CopyToVector()
            derivative = self._model.derivative(x, self._command_input.Eval(context))
            if self._disturbance_input.HasValue(context):
                drift = _turn(x[YAW], self._disturbance_input.Eval(context), 1)
                derivative = np.concatenate([derivative[POSE] + drift, derivative[POSE_SIZE:]])
            return derivative

        def DoCalcTimeDerivatives(self, context, derivatives) -> None:  # noqa: ANN001
            """Gives f(x, u) + R(yaw) w."""
            derivatives.SetFromVector(self._derivative(context))

        def _calc_pose(self, context, output) -> None:  # noqa: ANN001
            output.SetFromVector(context.get_continuous_state_vector().CopyToVector()[POSE])

        def _calc_body_velocity(self, context, output) -> None:  # noqa: ANN001
            yaw = context.get_continuous_state_vector().GetAtIndex(YAW)
            output.SetFromVector(_turn(yaw, self._derivative(context)[POSE], -1))

    return Impl


SindycRobot = SindycRobot_[None]


def AddSindycRobot(
    builder: DiagramBuilder,
    config: SindycRobotConfig,
    *,
    start: np.ndarray,
    name: str = "sindyc_robot",
) -> RobotPorts:
    """Adds a SindycRobot to ``builder`` and returns its ports.

    Args:
        builder: The builder.
        config: The config.
        start: (3,) [m, m, rad] initial pose where the config has none; velocities begin at zero.
        name: Name of the system.

    Raises:
        ValueError: when ``config`` is out of range.
    """
    config.validate()
    model = load_model(config.model)
    pose = start if config.initial_pose is None else config.initial_pose
    initial_state = np.concatenate([pose, np.zeros(model.num_states - POSE_SIZE)])
    robot = builder.AddNamedSystem(name, SindycRobot(model, initial_state))
    return RobotPorts(
        wheel_command=robot.GetInputPort("wheel_command"),
        pose=robot.GetOutputPort("pose"),
        true_pose=robot.GetOutputPort("pose"),
        body_velocity=robot.GetOutputPort("body_velocity"),
        disturbance=robot.GetInputPort("disturbance"),
    )
