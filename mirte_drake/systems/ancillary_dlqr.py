"""Adds the ancillary feedback that keeps the robot near the nominal plan (4-15)."""

import dataclasses as dc

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from mirte_drake.angles import pose_error
from mirte_drake.checks import check_array
from mirte_drake.control.dlqr import DlqrDesign, design_dlqr
from mirte_drake.control.plan import Plan, SolveStatus
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.vectors import YAW


@dc.dataclass
class AncillaryDlqrConfig:
    """Config of AncillaryDlqr; the defaults are the study's (thesis table 4-1)."""

    state_weight: np.ndarray = dc.field(  # (3,) diagonal of Q_lqr, on [m, m, rad].
        default_factory=lambda: np.full(3, 1000.0)
    )
    input_weight: np.ndarray = dc.field(  # (4,) diagonal of R_lqr, on [pwm].
        default_factory=lambda: np.full(4, 0.001)
    )

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_array("state_weight", self.state_weight, np.shape(self.state_weight), minimum=1e-9)
        check_array("input_weight", self.input_weight, (4,), minimum=1e-12)


class AncillaryDlqr(LeafSystem):
    """Linearises along the plan, solves the DLQR and corrects the nominal input.

    .. pydrake_system::

        name: AncillaryDlqr
        input_ports:
        - plan
        - state
        output_ports:
        - wheel_command
        - designs

    =============  ==================  =======  ===============================================
    port           type                unit     meaning
    =============  ==================  =======  ===============================================
    plan (in)      Plan                -        xhat_k and ubar_k
    state (in)     vector (n,)         model's  measured x_k
    wheel_command  vector (m,)         [pwm]    u_k = ubar_k - K_k (x_k - xhat_k)   (4-15)
    designs        tuple[DlqrDesign]   -        K and A - B K at the plan's first ``stages`` stages
    =============  ==================  =======  ===============================================

    Stateless. While the plan stops the robot, or the measurement is not finite, the command is
    ubar_k alone. Where the linearised pair cannot be stabilised, the gain is zero.

    Raises:
        ValueError: when ``config`` is out of range, or the model at rest cannot be stabilised
            (at construction).
    """

    def __init__(
        self, config: AncillaryDlqrConfig, model: PredictionModel, *, period: float, stages: int = 1
    ) -> None:
        """Declares ports.

        Args:
            config: The config.
            model: Prediction model.
            period: [s] sample time T_s.
            stages: How many stages of the plan get a design; the first gives the command.
        """
        super().__init__()
        config.validate()
        n, m = model.num_states, model.num_inputs
        check_array("state_weight", config.state_weight, (n,))
        self._model, self._period, self._stages = model, period, stages
        self._Q, self._R = np.diag(config.state_weight), np.diag(config.input_weight)
        at_rest = self._design(np.zeros(n), np.zeros(m))
        self._plan_input = self.DeclareAbstractInputPort("plan", AbstractValue.Make(object()))
        self._state_input = self.DeclareVectorInputPort("state", n)
        self._designs_output = self.DeclareAbstractOutputPort(
            "designs",
            lambda: AbstractValue.Make((at_rest,)),
            self._calc_designs,
            {self._plan_input.ticket()},
        )
        self.DeclareVectorOutputPort(
            "wheel_command",
            m,
            self._calc_wheel_command,
            {self._plan_input.ticket(), self._state_input.ticket()},
        )

    def _design(self, x: np.ndarray, u: np.ndarray) -> DlqrDesign:
        return design_dlqr(self._model, x, u, self._period, self._Q, self._R)

    def _calc_designs(self, context: Context, output: AbstractValue) -> None:
        plan: Plan = self._plan_input.Eval(context)
        designs = []
        for x, u in zip(plan.states[: self._stages], plan.inputs[: self._stages], strict=True):
            try:
                designs.append(self._design(x, u))
            except ValueError:
                designs.append(self._without_feedback(x, u))
        output.set_value(tuple(designs))

    def _without_feedback(self, x: np.ndarray, u: np.ndarray) -> DlqrDesign:
        _, A, _ = self._model.linearise(x, u)
        gain = np.zeros((self._model.num_inputs, self._model.num_states))
        return DlqrDesign(float(x[YAW]), gain, np.eye(len(A)) + self._period * A)

    def _calc_wheel_command(self, context: Context, output: BasicVector) -> None:
        plan: Plan = self._plan_input.Eval(context)
        error = pose_error(self._state_input.Eval(context), plan.nominal_state)
        if plan.status is SolveStatus.STOPPING or not np.all(np.isfinite(error)):
            output.SetFromVector(plan.nominal_input)
            return
        gain = self._designs_output.Eval(context)[0].gain
        output.SetFromVector(plan.nominal_input - gain @ error)


def AddAncillaryDlqr(
    builder: DiagramBuilder,
    config: AncillaryDlqrConfig,
    model: PredictionModel,
    *,
    period: float,
    stages: int = 1,
    name: str = "ancillary_dlqr",
) -> AncillaryDlqr:
    """Adds an AncillaryDlqr to ``builder``; the caller connects its ports."""
    system = AncillaryDlqr(config, model, period=period, stages=stages)
    return builder.AddNamedSystem(name, system)
