"""Propagates the tube of the inverting ancillary law, and tightens the nominal inputs."""

import dataclasses as dc

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
)

from mirte_drake.checks import check_array, check_number
from mirte_drake.control.inversion_tube import (
    check_linear_position,
    propagate_inversion_tube,
    required_room,
)
from mirte_drake.control.plan import Plan
from mirte_drake.control.turning_map import turning_map
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.vectors import YAW


@dc.dataclass
class InversionTubeUpdaterConfig:
    """Config of InversionTubeUpdater; the defaults are the study's disturbance."""

    disturbance_bound: np.ndarray = dc.field(  # (3,) [m/s, m/s, rad/s] w_max, body frame.
        default_factory=lambda: np.array([0.04, 0.03, 0.09])
    )
    initial_half_width: np.ndarray = dc.field(  # (3,) [m, m, rad] d_0.
        default_factory=lambda: np.zeros(3)
    )
    initial_input_limit: float = 90.0  # [pwm] Tightened bounds of the first sample.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_array("disturbance_bound", self.disturbance_bound, (3,), minimum=0)
        check_array("initial_half_width", self.initial_half_width, (3,), minimum=0)
        check_number("initial_input_limit", self.initial_input_limit, minimum=0)


class InversionTubeUpdater(LeafSystem):
    """Holds the half-widths d_k of the box around the nominal state, and the tightened bounds.

    .. pydrake_system::

        name: InversionTubeUpdater
        input_ports:
        - plan
        - state
        - wheel_command
        output_ports:
        - half_width
        - input_lower
        - input_upper

    ==================  =============  ===========  ===========================================
    port                type           unit         meaning
    ==================  =============  ===========  ===========================================
    plan (in)           Plan           -            xhat_k, ubar_k, xbar_{k+1}, ubar_{k+1}
    state (in)          vector (3,)    [m, rad]     measured x_k
    wheel_command (in)  vector (4,)    [pwm]        u_k, as it is applied
    half_width          vector (3,)    [m, m, rad]  d_k, world frame
    input_lower         vector (4 N,)  [pwm]        -input_limit + room per stage, by rows
    input_upper         vector (4 N,)  [pwm]        input_limit - room per stage, by rows
    ==================  =============  ===========  ===========================================

    All outputs are states, without feedthrough. Every ``period`` s, ``propagate_inversion_tube``
    gives d_{k+1}, and ``required_room`` at the plan's next stage the bounds of sample k + 1, the
    same for all stages. Where the law needs more than there is, both bounds are zero. w_max is a
    numeric parameter of the Context, so a study can vary it without a new Diagram.

    Raises:
        ValueError: when ``config`` is out of range, or the model is not one of ``turning_map`` and
            ``check_linear_position`` (at construction).
    """

    def __init__(
        self,
        config: InversionTubeUpdaterConfig,
        model: PredictionModel,
        *,
        period: float,
        horizon: int,
        feedback: float,
        input_limit: float = 100.0,
    ) -> None:
        """Declares ports and state.

        Args:
            config: The config.
            model: Prediction model.
            period: [s] sample time T_s.
            horizon: N, stages that get bounds.
            feedback: [1/s] k of the ancillary law.
            input_limit: [pwm] bound on the applied input.
        """
        super().__init__()
        config.validate()
        self._model, self._mapping = model, turning_map(model)
        check_linear_position(self._mapping, model.name)
        self._period, self._horizon = period, horizon
        self._feedback, self._limit = feedback, input_limit
        self._plan_input = self.DeclareAbstractInputPort("plan", AbstractValue.Make(object()))
        self._state_input = self.DeclareVectorInputPort("state", model.num_states)
        self._command_input = self.DeclareVectorInputPort("wheel_command", model.num_inputs)
        self._w_max = self.DeclareNumericParameter(BasicVector(config.disturbance_bound))
        first = np.full(4 * horizon, min(config.initial_input_limit, input_limit))
        self._half_width = self.DeclareDiscreteState(config.initial_half_width)
        self._lower = self.DeclareDiscreteState(-first)
        self._upper = self.DeclareDiscreteState(first)
        self.DeclareStateOutputPort("half_width", self._half_width)
        self.DeclareStateOutputPort("input_lower", self._lower)
        self.DeclareStateOutputPort("input_upper", self._upper)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, next_state: DiscreteValues) -> None:
        plan: Plan = self._plan_input.Eval(context)
        half_width = propagate_inversion_tube(
            self._model,
            self._mapping,
            (plan.nominal_state, plan.nominal_next),
            self._state_input.Eval(context),
            self._command_input.Eval(context),
            context.get_discrete_state(self._half_width).value(),
            context.get_numeric_parameter(int(self._w_max)).value(),
            self._feedback,
            self._period,
        )
        room = required_room(
            self._mapping,
            plan.nominal_next[YAW],
            plan.inputs[min(1, self._horizon - 1)],
            half_width,
            self._feedback,
            self._period,
            self._limit,
        )
        upper = np.tile(np.maximum(self._limit - room, 0.0), self._horizon)
        next_state.set_value(self._half_width, half_width)
        next_state.set_value(self._lower, -upper)
        next_state.set_value(self._upper, upper)


def AddInversionTubeUpdater(
    builder: DiagramBuilder,
    config: InversionTubeUpdaterConfig,
    model: PredictionModel,
    *,
    period: float,
    horizon: int,
    feedback: float,
    input_limit: float = 100.0,
    name: str = "inversion_tube_updater",
) -> InversionTubeUpdater:
    """Adds an InversionTubeUpdater to ``builder``; the caller connects its ports."""
    system = InversionTubeUpdater(
        config,
        model,
        period=period,
        horizon=horizon,
        feedback=feedback,
        input_limit=input_limit,
    )
    return builder.AddNamedSystem(name, system)
