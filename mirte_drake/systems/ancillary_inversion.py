"""Adds the ancillary feedback that inverts the input map (docs/concepts/rigorous_tube.md)."""

import dataclasses as dc

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    LeafSystem,
    ValueProducer,
)

from mirte_drake.angles import pose_error
from mirte_drake.checks import check_number
from mirte_drake.control.input_inversion import Inversion, invert
from mirte_drake.control.plan import Plan, SolveStatus
from mirte_drake.control.turning_map import turning_map
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.vectors import YAW


@dc.dataclass
class AncillaryInversionConfig:
    """Config of AncillaryInversion."""

    # [1/s] k: without disturbance each sample leaves 1 - k T_s of the error, so at most 1 / T_s.
    feedback: float = 9.5

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_number("feedback", self.feedback, above=0)


class AncillaryInversion(LeafSystem):
    """Finds the wheel command that leaves 1 - k T_s of the error after a sample, as predicted.

    .. pydrake_system::

        name: AncillaryInversion
        input_ports:
        - plan
        - state
        output_ports:
        - wheel_command
        - reached

    =============  ===========  =========  ===================================================
    port           type         unit       meaning
    =============  ===========  =========  ===================================================
    plan (in)      Plan         -          xhat_k and ubar_k
    state (in)     vector (3,)  [m, rad]   measured x_k
    wheel_command  vector (4,)  [pwm]      u_k near ubar_k with step(x_k, u_k) - xbar_{k+1} =
                                           (1 - k T_s) (x_k - xhat_k)
    reached        vector (1,)  -          fraction of the wanted change that u_k gives: 1 but
                                           where limits forbid it
    =============  ===========  =========  ===================================================

    ``step`` is the model's, over T_s. Stateless. While the plan stops the robot, or the
    measurement is not finite, the command is ubar_k alone, and all that is wanted.

    Deviation: the published law (4-15) is linear, u = ubar - K (x - xhat); its large moves meet
    the products of inputs in the yaw rate, which no linearisation sees. This one is exact.

    Raises:
        ValueError: when ``config`` is out of range, k is more than 1 / T_s, or the model is not
            one of ``turning_map`` (at construction).
    """

    def __init__(
        self,
        config: AncillaryInversionConfig,
        model: PredictionModel,
        *,
        period: float,
        input_limit: float = 100.0,
    ) -> None:
        """Declares ports.

        Args:
            config: The config.
            model: Prediction model.
            period: [s] sample time T_s.
            input_limit: [pwm] bound on the command of every wheel.
        """
        super().__init__()
        config.validate()
        check_number("feedback", config.feedback, maximum=1.0 / period)
        self._feedback, self._period = config.feedback, period
        self._mapping = turning_map(model)
        self._limit = np.full(4, input_limit)
        self._plan_input = self.DeclareAbstractInputPort("plan", AbstractValue.Make(object()))
        self._state_input = self.DeclareVectorInputPort("state", model.num_states)
        inversion = self.DeclareCacheEntry(
            "inversion",
            ValueProducer(lambda: AbstractValue.Make(object()), self._calc_inversion),
            {self._plan_input.ticket(), self._state_input.ticket()},
        )
        self._inversion = inversion
        ticket = {self.cache_entry_ticket(inversion.cache_index())}
        self.DeclareVectorOutputPort("wheel_command", 4, self._calc_wheel_command, ticket)
        self.DeclareVectorOutputPort("reached", 1, self._calc_reached, ticket)

    def _calc_inversion(self, context: Context, output: AbstractValue) -> None:
        plan: Plan = self._plan_input.Eval(context)
        x, xhat, ubar = self._state_input.Eval(context), plan.nominal_state, plan.nominal_input
        if plan.status is SolveStatus.STOPPING or not np.all(np.isfinite(x)):
            output.set_value(Inversion(ubar, 1.0))
            return
        nominal = (plan.nominal_next - xhat) / self._period
        wanted = nominal - self._feedback * pose_error(x, xhat)
        # Of an input with the wanted yaw rate, this is the mean velocity over the sample.
        mean = self._mapping.over(x[YAW], wanted[YAW], self._period)
        output.set_value(invert(mean, wanted, ubar, -self._limit, self._limit))

    def _calc_wheel_command(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._inversion.Eval(context).input)

    def _calc_reached(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([self._inversion.Eval(context).fraction])


def AddAncillaryInversion(
    builder: DiagramBuilder,
    config: AncillaryInversionConfig,
    model: PredictionModel,
    *,
    period: float,
    input_limit: float = 100.0,
    name: str = "ancillary_inversion",
) -> AncillaryInversion:
    """Adds an AncillaryInversion to ``builder``; the caller connects its ports."""
    system = AncillaryInversion(config, model, period=period, input_limit=input_limit)
    return builder.AddNamedSystem(name, system)
