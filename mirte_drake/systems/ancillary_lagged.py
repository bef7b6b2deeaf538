"""Adds the feedback that keeps a robot whose velocity lags near the nominal plan."""

import dataclasses as dc

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from mirte_drake.checks import check_array
from mirte_drake.control.input_inversion import InputMap, invert
from mirte_drake.control.lagged_axis import feedback_gains
from mirte_drake.control.lagged_law import tracking_error, wanted_velocity
from mirte_drake.control.plan import Plan, SolveStatus
from mirte_drake.model.lagged_model import LaggedModel
from mirte_drake.vectors import POSE_SIZE


@dc.dataclass
class AncillaryLaggedConfig:
    """Config of AncillaryLagged: weights by axis, forward, sideways, turning."""

    # (3,) On squared errors of the pose [m, m, rad].
    position_weight: np.ndarray = dc.field(default_factory=lambda: np.full(POSE_SIZE, 9.0))
    # (3,) On squared errors of the velocity [m/s, m/s, rad/s].
    velocity_weight: np.ndarray = dc.field(default_factory=lambda: np.full(POSE_SIZE, 0.1))
    # (3,) On the squared velocity asked for beside the nominal one [m/s, m/s, rad/s].
    command_weight: np.ndarray = dc.field(default_factory=lambda: np.ones(POSE_SIZE))

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        for field in dc.fields(self):
            check_array(field.name, getattr(self, field.name), (POSE_SIZE,), minimum=1e-9)


class AncillaryLagged(LeafSystem):
    """Corrects the velocity that the nominal input settles at, and tells the wheels.

    .. pydrake_system::

        name: AncillaryLagged
        input_ports:
        - plan
        - state
        - bias
        output_ports:
        - wheel_command

    =============  ===========  ==================  ==============================================
    port           type         unit                meaning
    =============  ===========  ==================  ==============================================
    plan (in)      Plan         -                   nominal state and input, effective commands
    state (in)     vector (6,)  model's             estimated, when the command begins to act
    bias (in)      vector (3,)  [m/s, m/s, rad/s]   of the velocity that the model settles at
    wheel_command  vector (4,)  [pwm]               for the effective command that settles at
                                                    ``wanted_velocity``
    =============  ===========  ==================  ==============================================

    Stateless. Of the effective commands that settle there, the one near the nominal input is
    taken, see ``invert``. While the plan stops the robot, or the state is not finite, the command
    is that for the nominal input alone.

    Raises:
        ValueError: when ``config`` is out of range (at construction).
    """

    def __init__(
        self,
        config: AncillaryLaggedConfig,
        model: LaggedModel,
        *,
        period: float,
        input_limit: float,
    ) -> None:
        """Declares ports.

        Args:
            config: The config.
            model: The model.
            period: [s] sample time T_s.
            input_limit: [pwm] bound of every effective command.
        """
        super().__init__()
        config.validate()
        self._model, self._limit = model, np.full(model.num_inputs, input_limit)
        self._gains = feedback_gains(
            model.parameters.lag,
            period,
            config.position_weight,
            config.velocity_weight,
            config.command_weight,
        )
        G = model.effective().steady_velocity_jacobian(np.zeros(model.num_inputs))
        self._map = InputMap(np.zeros(POSE_SIZE), G, np.zeros((*G.shape, model.num_inputs)))
        self._plan_input = self.DeclareAbstractInputPort("plan", AbstractValue.Make(object()))
        self._state_input = self.DeclareVectorInputPort("state", model.num_states)
        self._bias_input = self.DeclareVectorInputPort("bias", POSE_SIZE)
        self.DeclareVectorOutputPort(
            "wheel_command",
            model.num_inputs,
            self._calc_wheel_command,
            {port.ticket() for port in (self._plan_input, self._state_input, self._bias_input)},
        )

    def _calc_wheel_command(self, context: Context, output: BasicVector) -> None:
        plan: Plan = self._plan_input.Eval(context)
        state, effective = self._state_input.Eval(context), plan.nominal_input
        if plan.status is not SolveStatus.STOPPING and np.all(np.isfinite(state)):
            error = tracking_error(state, plan.nominal_state)
            wanted = wanted_velocity(
                error, self._map.linear @ effective, self._bias_input.Eval(context), self._gains
            )
            effective = invert(self._map, wanted, effective, -self._limit, self._limit).input
        output.SetFromVector(self._model.command_for(effective))


def AddAncillaryLagged(
    builder: DiagramBuilder,
    config: AncillaryLaggedConfig,
    model: LaggedModel,
    *,
    period: float,
    input_limit: float,
    name: str = "ancillary_lagged",
) -> AncillaryLagged:
    """Adds an AncillaryLagged to ``builder``; the caller connects its ports."""
    system = AncillaryLagged(config, model, period=period, input_limit=input_limit)
    return builder.AddNamedSystem(name, system)
