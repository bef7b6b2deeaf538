"""Propagates the tube and tightens the nominal inputs, (4-19) and (4-20)."""

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

from mirte_drake.checks import check_array, check_choice, check_number
from mirte_drake.control.dlqr import DlqrDesign
from mirte_drake.control.tube import horizon_half_widths, stage_disturbances, tighten


@dc.dataclass
class TubeUpdaterConfig:
    """Config of TubeUpdater; the defaults are the study's (thesis table 4-1)."""

    disturbance_bound: np.ndarray = dc.field(  # (3,) [m/s, m/s, rad/s] w_max, body frame.
        default_factory=lambda: np.array([0.04, 0.03, 0.09])
    )
    initial_half_width: np.ndarray = dc.field(  # (3,) [m, m, rad] d_0.
        default_factory=lambda: np.zeros(3)
    )
    initial_input_limit: float = 90.0  # [pwm] Tightened bounds of the first sample.
    # "published": w_max as it is, in the world frame; "rotated": |R(yaw)| w_max, since the
    # disturbance lives in the body frame.
    disturbance_frame: str = "published"
    # Bounds of sample k+1 from |K_k| d_k ("current": the published programs) or from
    # |K_k| d_{k+1} ("next": algorithm 2 in the text).
    tightening_half_width: str = "current"
    # "held": the same bounds for all stages of a solve; "stagewise": (4-19) and (4-20) along the
    # plan, stage by stage.
    tightening_over_horizon: str = "held"

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_array("disturbance_bound", self.disturbance_bound, (3,), minimum=0)
        check_array("initial_half_width", self.initial_half_width, (3,), minimum=0)
        check_number("initial_input_limit", self.initial_input_limit, minimum=0)
        check_choice("disturbance_frame", self.disturbance_frame, ("published", "rotated"))
        check_choice("tightening_half_width", self.tightening_half_width, ("current", "next"))
        check_choice("tightening_over_horizon", self.tightening_over_horizon, ("held", "stagewise"))


class TubeUpdater(LeafSystem):
    """Holds the half-widths d_k of the box around the nominal state, and the tightened bounds.

    .. pydrake_system::

        name: TubeUpdater
        input_ports:
        - designs
        output_ports:
        - half_width
        - input_lower
        - input_upper

    ============  =================  ===========  ==============================================
    port          type               unit         meaning
    ============  =================  ===========  ==============================================
    designs (in)  tuple[DlqrDesign]  -            of the plan's first stage ("held") or of all
                                                  its stages ("stagewise")
    half_width    vector (3,)        [m, m, rad]  d_k, world frame
    input_lower   vector (4 N,)      [pwm]        LB + |K| d per stage, by rows
    input_upper   vector (4 N,)      [pwm]        UB - |K| d per stage, by rows
    ============  =================  ===========  ==============================================

    All outputs are states, without feedthrough. Every ``period`` s:
    d_{k+1} = |A_k - B_k K_k| d_k + T_s w (4-19), and the bounds of sample k+1 by (4-20).
    w_max is a numeric parameter of the Context, so a study can vary it without a new Diagram.

    Raises:
        ValueError: when ``config`` is out of range (at construction).
    """

    def __init__(
        self,
        config: TubeUpdaterConfig,
        *,
        period: float,
        horizon: int,
        input_limit: float = 100.0,
    ) -> None:
        """Declares ports and state.

        Args:
            config: The config.
            period: [s] sample time T_s.
            horizon: N, stages that get bounds.
            input_limit: [pwm] bound on the applied input, LB = -UB.
        """
        super().__init__()
        config.validate()
        self._config, self._period, self._horizon = config, period, horizon
        self._limit = np.full(4, input_limit)
        self._designs_input = self.DeclareAbstractInputPort("designs", AbstractValue.Make(()))
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
        designs: tuple[DlqrDesign, ...] = self._designs_input.Eval(context)
        d = context.get_discrete_state(self._half_width).value()
        w_max = context.get_numeric_parameter(int(self._w_max)).value()
        rotated = self._config.disturbance_frame == "rotated"
        disturbances = stage_disturbances(w_max, designs, self._period, rotated=rotated)
        widths = horizon_half_widths(d, designs, disturbances)
        used = widths[:-1] if self._config.tightening_half_width == "current" else widths[1:]
        bounds = [
            tighten(-self._limit, self._limit, design.gain, width)
            for design, width in zip(designs, used, strict=True)
        ]
        # "held" has one stage; its bounds serve the whole horizon.
        lower, upper = np.array(bounds + bounds[-1:] * (self._horizon - len(bounds))).swapaxes(0, 1)
        next_state.set_value(self._half_width, widths[1])
        next_state.set_value(self._lower, lower.ravel())
        next_state.set_value(self._upper, upper.ravel())


def AddTubeUpdater(
    builder: DiagramBuilder,
    config: TubeUpdaterConfig,
    *,
    period: float,
    horizon: int,
    input_limit: float = 100.0,
    name: str = "tube_updater",
) -> TubeUpdater:
    """Adds a TubeUpdater to ``builder``; the caller connects its ports."""
    system = TubeUpdater(config, period=period, horizon=horizon, input_limit=input_limit)
    return builder.AddNamedSystem(name, system)
