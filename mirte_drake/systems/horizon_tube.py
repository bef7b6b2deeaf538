"""The tube ahead: its half-widths at every stage of the plan, (4-19)."""

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from mirte_drake.control.dlqr import DlqrDesign
from mirte_drake.control.plan import Plan
from mirte_drake.control.tube import horizon_half_widths, stage_disturbances
from mirte_drake.systems.tube_updater import TubeUpdaterConfig


class HorizonTube(LeafSystem):
    """Predicts the half-widths of the tube around the plan.

    .. pydrake_system::

        name: HorizonTube
        input_ports:
        - plan
        - designs
        output_ports:
        - half_widths

    ============  =================  ===========  =============================================
    port          type               unit         meaning
    ============  =================  ===========  =============================================
    plan (in)     Plan               -            of sample k
    designs (in)  tuple[DlqrDesign]  -            of its first stage, or of all its stages
    half_widths   vector (3 (N+1),)  [m, m, rad]  d_k, ..., d_{k+N}, by rows
    ============  =================  ===========  =============================================

    Where there is one design, it serves the whole horizon. The controller does not need this:
    it is for those who watch. There is no state.

    Raises:
        ValueError: when ``config`` is out of range (at construction).
    """

    def __init__(self, config: TubeUpdaterConfig, *, period: float, horizon: int) -> None:
        """Declares ports.

        Args:
            config: Of the TubeUpdater.
            period: [s] sample time T_s.
            horizon: N.
        """
        super().__init__()
        config.validate()
        self._config, self._period, self._horizon = config, period, horizon
        self._plan_input = self.DeclareAbstractInputPort("plan", AbstractValue.Make(object()))
        self._designs_input = self.DeclareAbstractInputPort("designs", AbstractValue.Make(()))
        self.DeclareVectorOutputPort(
            "half_widths",
            3 * (horizon + 1),
            self._calc_half_widths,
            {self._plan_input.ticket(), self._designs_input.ticket()},
        )

    def _calc_half_widths(self, context: Context, output: BasicVector) -> None:
        plan: Plan = self._plan_input.Eval(context)
        designs: tuple[DlqrDesign, ...] = self._designs_input.Eval(context)
        stages = designs + designs[-1:] * (self._horizon - len(designs))
        disturbances = stage_disturbances(
            self._config.disturbance_bound,
            stages,
            self._period,
            rotated=self._config.disturbance_frame == "rotated",
        )
        widths = horizon_half_widths(plan.data.half_width, stages, disturbances)
        output.SetFromVector(widths.ravel())


def AddHorizonTube(
    builder: DiagramBuilder,
    config: TubeUpdaterConfig,
    *,
    period: float,
    horizon: int,
    name: str = "horizon_tube",
) -> HorizonTube:
    """Adds a HorizonTube to ``builder``; the caller connects its ports."""
    return builder.AddNamedSystem(name, HorizonTube(config, period=period, horizon=horizon))
