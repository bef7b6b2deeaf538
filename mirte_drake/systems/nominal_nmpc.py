"""Plans the nominal motion: one solve of the optimal control problem (4-9) per sample."""

import dataclasses as dc

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    InputPort,
    LeafSystem,
    State,
)

from mirte_drake.checks import check_array, check_choice, check_number
from mirte_drake.control.dlqr import straight_line_terminal_weight
from mirte_drake.control.nmpc_solver import SOLVERS, NmpcSolver, make_nmpc_solver
from mirte_drake.control.plan import Plan, idle_plan, next_plan, warm_start
from mirte_drake.control.tracking_problem import TrackingData, TrackingProblem
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.vectors import POSE_SIZE

# Published programs of the study; thesis table 4-1 calls it the DLQR solution P.
STUDY_TERMINAL_WEIGHT = (
    (3511.06992126953, 233.248480516098, -90.1364787673133),
    (233.248480516098, 7447.46289178297, -30.9808550672083),
    (-90.1364787673133, -30.9808550672083, 1411.99502643508),
)

# Four wheels have three velocities: what they do beyond is decided by the weight on inputs alone,
# and below this the Hessian is singular but for rounding.
SMALLEST_INPUT_WEIGHT = 1e-9


@dc.dataclass
class NominalNmpcConfig:
    """Config of NominalNmpc; the defaults are the study's (thesis table 4-1)."""

    horizon: int = 10  # N_p = N_c, samples.
    state_weight: np.ndarray = dc.field(  # (3,) diagonal of Q, on [m, m, rad].
        default_factory=lambda: np.full(3, 1000.0)
    )
    input_weight: np.ndarray = dc.field(  # (4,) diagonal of R, on [pwm].
        default_factory=lambda: np.full(4, 0.001)
    )
    rate_weight: np.ndarray = dc.field(  # (4,) diagonal of R_d, on the input rate.
        default_factory=lambda: np.full(4, 0.001)
    )
    rate_limit: float = 30.0  # Bound on every input's rate.
    # Unit of the rate in rate_weight and rate_limit: "pwm_per_sample" (study) or "pwm_per_s"
    # (robot): the published programs differ in it.
    rate_unit: str = "pwm_per_sample"
    # (3, 3) P, or null: the Riccati matrix of Q and R along a straight line.
    terminal_weight: np.ndarray | None = dc.field(
        default_factory=lambda: np.array(STUDY_TERMINAL_WEIGHT)
    )
    # Factor on the stage costs against the terminal cost. A program made with acados integrates
    # its stage costs, a factor of T_s, and takes the terminal cost as it is.
    stage_cost_factor: float = 1.0
    # Predicted state k+1 is compared with reference k ("published": one sample of lag is built
    # in) or with reference k+1 ("aligned").
    reference_alignment: str = "published"
    # "realtime" (one iteration per sample), "converged", or by MathematicalProgram "snopt" or
    # "ipopt".
    solver: str = "converged"
    tolerance: float | None = None  # Optimality tolerance; null: the solver's own.
    # [s] A solve that takes longer ends: "realtime" and "converged" with their best iterate, the
    # others have failed.
    time_limit: float = 5.0

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_number("horizon", self.horizon, minimum=1)
        check_array("state_weight", self.state_weight, (3,), minimum=1e-9)
        check_array("input_weight", self.input_weight, (4,), minimum=1e-12)
        least = SMALLEST_INPUT_WEIGHT * np.max(self.state_weight)
        if np.min(self.input_weight) < least:
            raise ValueError(
                f"input_weight: must be at least {least:g}, {SMALLEST_INPUT_WEIGHT:g} of the "
                f"largest state_weight, got {np.min(self.input_weight):g}"
            )
        check_array("rate_weight", self.rate_weight, (4,), minimum=0)
        check_number("rate_limit", self.rate_limit, above=0)
        check_choice("rate_unit", self.rate_unit, ("pwm_per_sample", "pwm_per_s"))
        check_number("stage_cost_factor", self.stage_cost_factor, above=0)
        check_choice("reference_alignment", self.reference_alignment, ("published", "aligned"))
        check_choice("solver", self.solver, SOLVERS)
        if self.tolerance is not None:
            check_number("tolerance", self.tolerance, above=0)
            if self.solver == "realtime":
                raise ValueError("tolerance: one iteration has none; leave it null")
        check_number("time_limit", self.time_limit, above=0)
        if self.terminal_weight is not None:
            P = self.terminal_weight
            check_array("terminal_weight", P, (3, 3))
            if not np.allclose(P, P.T) or np.any(np.linalg.eigvalsh(P) < 0):
                raise ValueError("terminal_weight: must be symmetric and positive semidefinite")


def make_tracking_problem(
    config: NominalNmpcConfig, model: PredictionModel, period: float
) -> TrackingProblem:
    """Returns the optimal control problem that a config describes, rates per sample.

    Raises:
        ValueError: when ``config`` is out of range.
    """
    config.validate()
    per_sample = period if config.rate_unit == "pwm_per_s" else 1.0
    factor = config.stage_cost_factor
    Q, R = factor * np.diag(config.state_weight), factor * np.diag(config.input_weight)
    P = config.terminal_weight
    if P is None:
        # Deviation: the thesis takes the P of the ancillary DLQR. The OCP's own weights give the
        # cost that the horizon cuts off; with the study's weights both are the same.
        P = straight_line_terminal_weight(model, period, Q, R)
    return TrackingProblem(
        model=model,
        period=period,
        horizon=config.horizon,
        state_weight=Q,
        input_weight=R,
        rate_weight=factor * np.diag(config.rate_weight) / per_sample**2,
        terminal_weight=P,
        rate_limit=np.full(model.num_inputs, config.rate_limit * per_sample),
        aligned=config.reference_alignment == "aligned",
    )


class NominalNmpc(LeafSystem):
    """Solves the optimal control problem once per sample and keeps the plan in its state.

    .. pydrake_system::

        name: NominalNmpc
        input_ports:
        - state
        - reference_window
        - half_width
        - input_lower
        - input_upper
        - applied_input
        output_ports:
        - plan
        - nominal_state
        - nominal_next
        - nominal_input
        - solve_status

    =====================  ==================  ============  =====================================
    port                   type                unit          meaning
    =====================  ==================  ============  =====================================
    state (in)             vector (n,)         model's       measured x_k; of a kinematic model the
                                                             pose, yaw unwrapped
    reference_window (in)  vector (3 (N+d+1))  [m, m, rad]   r_k, ..., r_{k+d+N}; tracked from
                                                             r_{k+d} on, with d the lead
    half_width (in)        vector (n,)         model's       d_k; open: zeros, xhat_k = x_k
    input_lower (in)       vector (N m,)       [pwm]         bounds per stage, within +-input_limit;
                                                             open: -input_limit
    input_upper (in)       vector (N m,)       [pwm]         the same; open: +input_limit
    applied_input (in)     vector (m,)         [pwm]         last command to the wheels, where the
                                                             ramp to a stop begins; open: ubar_{k-1}
    plan                   Plan                -             a state
    nominal_state          vector (n,)         model's       xhat_k
    nominal_next           vector (n,)         model's       xbar_{k+1}
    nominal_input          vector (m,)         [pwm]         ubar_k
    solve_status           vector (1,)         -             SolveStatus as a number
    =====================  ==================  ============  =====================================

    The plan is abstract state, set by an unrestricted update: Drake runs those before discrete
    updates of the same instant, so what follows from it is not a sample late. No output has
    feedthrough. A failed solve never ends the process: see ``next_plan``.

    Raises:
        ValueError: when ``config`` is out of range (at construction).
    """

    def __init__(
        self,
        config: NominalNmpcConfig,
        model: PredictionModel,
        *,
        period: float,
        input_limit: float = 100.0,
        lead: int = 0,
    ) -> None:
        """Builds the program.

        Args:
            config: The config.
            model: Prediction model.
            period: [s] sample time T_s.
            input_limit: [pwm] bound of every input while the bound ports are open.
            lead: d, samples from now to when the plan begins, which ``state`` is about.
        """
        super().__init__()
        self._problem = make_tracking_problem(config, model, period)
        self._solver = make_nmpc_solver(
            self._problem,
            config.solver,
            tolerance=config.tolerance,
            time_limit=config.time_limit,
        )
        self._input_limit, self._lead = input_limit, lead
        n, m, N = model.num_states, model.num_inputs, config.horizon
        self._state_input = self.DeclareVectorInputPort("state", n)
        self._reference_input = self.DeclareVectorInputPort("reference_window", 3 * (N + lead + 1))
        self._half_width_input = self.DeclareVectorInputPort("half_width", n)
        self._lower_input = self.DeclareVectorInputPort("input_lower", N * m)
        self._upper_input = self.DeclareVectorInputPort("input_upper", N * m)
        self._applied_input = self.DeclareVectorInputPort("applied_input", m)
        self._plan = self.DeclareAbstractState(AbstractValue.Make(idle_plan(self._problem)))
        self.DeclareStateOutputPort("plan", self._plan)
        state = {self.abstract_state_ticket(self._plan)}
        self.DeclareVectorOutputPort("nominal_state", n, self._calc_nominal_state, state)
        self.DeclareVectorOutputPort("nominal_next", n, self._calc_nominal_next, state)
        self.DeclareVectorOutputPort("nominal_input", m, self._calc_nominal_input, state)
        self.DeclareVectorOutputPort("solve_status", 1, self._calc_solve_status, state)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update_plan)
        self.DeclarePerStepPublishEvent(self._prepare)

    @property
    def problem(self) -> TrackingProblem:
        """The optimal control problem."""
        return self._problem

    def use_solver(self, solver: NmpcSolver) -> None:
        """Replaces the solver by another one for the same ``problem``, before any update."""
        self._solver = solver

    def _get_plan(self, context: Context) -> Plan:
        return context.get_abstract_state(int(self._plan)).get_value()

    def _calc_nominal_state(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._get_plan(context).nominal_state)

    def _calc_nominal_next(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._get_plan(context).nominal_next)

    def _calc_nominal_input(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._get_plan(context).nominal_input)

    def _calc_solve_status(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([float(self._get_plan(context).status)])

    def _window(self, context: Context) -> np.ndarray:
        return self._reference_input.Eval(context).reshape(-1, POSE_SIZE)

    def _tracking_data(self, context: Context, previous: Plan) -> TrackingData:
        n, m = self._problem.model.num_states, self._problem.model.num_inputs
        limit = np.full(self._problem.horizon * m, self._input_limit)
        lower, upper = (
            np.clip(_eval_or(port, context, default), -limit, limit).reshape(-1, m)
            for port, default in ((self._lower_input, -limit), (self._upper_input, limit))
        )
        return TrackingData(
            state=self._state_input.Eval(context),
            reference=self._window(context)[self._lead :],
            half_width=_eval_or(self._half_width_input, context, np.zeros(n)),
            input_lower=lower,
            input_upper=upper,
            previous_input=previous.nominal_input,
        )

    def _prepare(self, context: Context) -> None:
        """Prepares the next solve, once the command of this sample is on its way.

        The solver keeps what it prepared only to save time: a solve from another decision vector,
        as of another Context, does it again.
        """
        plan = self._get_plan(context)
        self._solver.prepare(warm_start(self._problem, plan, plan.nominal_next))

    def _update_plan(self, context: Context, next_state: State) -> None:
        previous = self._get_plan(context)
        data = self._tracking_data(context, previous)
        applied = _eval_or(self._applied_input, context, previous.nominal_input)
        guess = warm_start(self._problem, previous, data.state)
        solution = self._solver.solve(data, guess)
        plan = next_plan(self._problem, previous, data, solution, applied)
        plan = dc.replace(plan, reference=self._window(context)[0])
        next_state.get_mutable_abstract_state(int(self._plan)).set_value(plan)


def _eval_or(port: InputPort, context: Context, default: np.ndarray) -> np.ndarray:
    return port.Eval(context) if port.HasValue(context) else default


def AddNominalNmpc(
    builder: DiagramBuilder,
    config: NominalNmpcConfig,
    model: PredictionModel,
    *,
    period: float,
    input_limit: float = 100.0,
    lead: int = 0,
    name: str = "nominal_nmpc",
) -> NominalNmpc:
    """Adds a NominalNmpc to ``builder``; the caller connects its ports."""
    system = NominalNmpc(config, model, period=period, input_limit=input_limit, lead=lead)
    return builder.AddNamedSystem(name, system)
