"""The tube ahead where its course is not predicted: it stays as it will be at the next sample."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from mirte_drake.control.plan import Plan
from mirte_drake.vectors import POSE


class HeldTube(LeafSystem):
    """Extends the tube of the next sample over the plan.

    .. pydrake_system::

        name: HeldTube
        input_ports:
        - plan
        - half_width
        output_ports:
        - half_widths

    ===============  =================  ===========  ==========================================
    port             type               unit         meaning
    ===============  =================  ===========  ==========================================
    plan (in)        Plan               -            of sample k
    half_width (in)  vector (n,)        model's      d_{k+1}; its first three are of the pose
    half_widths      vector (3 (N+1),)  [m, m, rad]  d_k, d_{k+1}, ..., d_{k+1}, by rows
    ===============  =================  ===========  ==========================================

    The controller does not need this: it is for those who watch. There is no state.
    """

    def __init__(self, *, horizon: int, states: int) -> None:
        """Declares ports.

        Args:
            horizon: N.
            states: n, of the prediction model.
        """
        super().__init__()
        self._horizon = horizon
        self._plan_input = self.DeclareAbstractInputPort("plan", AbstractValue.Make(object()))
        self._half_width_input = self.DeclareVectorInputPort("half_width", states)
        self.DeclareVectorOutputPort(
            "half_widths",
            3 * (horizon + 1),
            self._calc_half_widths,
            {self._plan_input.ticket(), self._half_width_input.ticket()},
        )

    def _calc_half_widths(self, context: Context, output: BasicVector) -> None:
        plan: Plan = self._plan_input.Eval(context)
        later = self._half_width_input.Eval(context)[POSE]
        now = plan.data.half_width[POSE]
        output.SetFromVector(np.concatenate([now, np.tile(later, self._horizon)]))


def AddHeldTube(
    builder: DiagramBuilder, *, horizon: int, states: int, name: str = "held_tube"
) -> HeldTube:
    """Adds a HeldTube to ``builder``; the caller connects its ports."""
    return builder.AddNamedSystem(name, HeldTube(horizon=horizon, states=states))
