"""Propagates the tube of a robot whose velocity lags, and tightens the nominal inputs."""

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
from mirte_drake.control.lagged_tube import (
    EllipsoidTube,
    LaggedLoop,
    ModeTube,
    box_of_state,
    input_room,
)
from mirte_drake.control.plan import Plan
from mirte_drake.model.lagged_model import LaggedModel
from mirte_drake.vectors import POSE_SIZE, YAW


@dc.dataclass
class LaggedTubeConfig:
    """Config of LaggedTubeUpdater."""

    # (3,) [m, m, rad] Bound on the innovations, forward, sideways, turning.
    innovation_bound: np.ndarray = dc.field(default_factory=lambda: np.array([0.002, 0.002, 0.006]))
    # Whether the tube follows the bound that the coverage monitor calibrates; it then begins with
    # the one above. Coverage is on average over time, so that this tube is not invariant.
    calibrated: bool = False
    shape: str = "modes"  # "modes" or "ellipsoid", see ``control.lagged_tube``.
    gamma: float = 1.0  # [-] Of the ellipsoid, in terms of innovations as large as their bound.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_array("innovation_bound", self.innovation_bound, (POSE_SIZE,), minimum=0)
        check_choice("shape", self.shape, ("modes", "ellipsoid"))
        check_number("gamma", self.gamma, above=0)


class LaggedTubeUpdater(LeafSystem):
    """Holds what bounds the error of the estimated state around the nominal one.

    .. pydrake_system::

        name: LaggedTubeUpdater
        input_ports:
        - plan
        - state
        - bias
        - calibrated_bound
        output_ports:
        - half_width
        - error_bound
        - input_lower
        - input_upper

    =====================  =============  =================  =====================================
    port                   type           unit               meaning
    =====================  =============  =================  =====================================
    plan (in)              Plan           -                  its inputs are effective commands
    state (in)             vector (6,)    model's            estimated
    bias (in)              vector (3,)    [m/s, m/s, rad/s]  that the ancillary law takes off
    calibrated_bound (in)  vector (3,)    [m/s, m/s, rad/s]  on the next innovation, over T_s;
                                                             open: the config's
    half_width             vector (6,)    model's            of a box within the tube around
                                                             ``state``
    error_bound            vector (6,)    robot's frame      of position (3) and velocity (3) in
                                                             the tube
    input_lower            vector (4 N,)  [pwm]              bounds per stage, by rows, that
                                                             leave room for ancillary law and bias
    input_upper            vector (4 N,)  [pwm]              the same
    =====================  =============  =================  =====================================

    State, every ``period`` s: the tube of the next sample, and the room for the ancillary law at
    each stage of a plan that begins there, both by this sample's plan. No output has feedthrough
    from ``plan`` or ``calibrated_bound``.

    Raises:
        ValueError: when ``config`` is out of range (at construction).
    """

    def __init__(
        self,
        config: LaggedTubeConfig,
        model: LaggedModel,
        loop: LaggedLoop,
        gains: np.ndarray,
        *,
        period: float,
        horizon: int,
        input_limit: float,
        command_error: float,
    ) -> None:
        """Declares ports and state.

        Args:
            config: The config.
            model: The model.
            loop: Its closed loop with ancillary law and observer.
            gains: (3, 2) of the ancillary law.
            period: [s] sample time T_s.
            horizon: N, stages that get bounds.
            input_limit: [pwm] bound of every effective command.
            command_error: [pwm] by which a command may miss what is asked for. Within the deadband
                it may miss by half of that more; there the tube does not hold.

        Raises:
            ValueError: when ``command_error`` is negative.
        """
        super().__init__()
        config.validate()
        check_number("command_error", command_error, minimum=0)
        self._gains, self._horizon, self._limit = gains, horizon, input_limit
        self._map = model.effective().steady_velocity_jacobian(np.zeros(model.num_inputs))
        self._bound, self._period = config.innovation_bound, period
        missed = np.abs(self._map) @ (command_error * np.max(model.wheel_shares, axis=0))
        self._tube: ModeTube | EllipsoidTube = (
            ModeTube(loop, missed)
            if config.shape == "modes"
            else EllipsoidTube(loop, missed, config.gamma)
        )
        self._inverse = np.linalg.pinv(self._map)
        n, m = model.num_states, model.num_inputs
        self._plan_input = self.DeclareAbstractInputPort("plan", AbstractValue.Make(object()))
        self._state_input = self.DeclareVectorInputPort("state", n)
        self._bias_input = self.DeclareVectorInputPort("bias", POSE_SIZE)
        self._bound_input = self.DeclareVectorInputPort("calibrated_bound", POSE_SIZE)
        self._size_held = self.DeclareDiscreteState(self._tube.start().ravel())
        self._room_held = self.DeclareDiscreteState(horizon * m)
        size, room = (self.discrete_state_ticket(i) for i in (self._size_held, self._room_held))
        self.DeclareVectorOutputPort(
            "half_width", n, self._calc_half_width, {size, self._state_input.ticket()}
        )
        self.DeclareVectorOutputPort("error_bound", n, self._calc_error_bound, {size})
        sources = {room, self._bias_input.ticket()}
        self.DeclareVectorOutputPort("input_lower", horizon * m, self._calc_lower, sources)
        self.DeclareVectorOutputPort("input_upper", horizon * m, self._calc_upper, sources)
        # A discrete update, since those come after the unrestricted ones that make the plan.
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _size(self, context: Context) -> np.ndarray:
        held = context.get_discrete_state(self._size_held).value()
        return held.reshape(self._tube.start().shape)

    def _calc_half_width(self, context: Context, output: BasicVector) -> None:
        yaw = self._state_input.Eval(context)[YAW]
        output.SetFromVector(box_of_state(self._tube.box(self._size(context)), yaw))

    def _calc_error_bound(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._tube.components(self._size(context)).T.ravel())

    def _bounds(self, context: Context, side: float) -> np.ndarray:
        room = context.get_discrete_state(self._room_held).value().reshape(self._horizon, -1)
        shift = self._inverse @ self._bias_input.Eval(context)
        # No bound passes the middle: there the nominal input gives no freedom, but one solution.
        return shift + side * np.maximum(self._limit - room, 0.0)

    def _calc_lower(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._bounds(context, -1.0).ravel())

    def _calc_upper(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._bounds(context, 1.0).ravel())

    def _update(self, context: Context, next_state: DiscreteValues) -> None:
        plan: Plan = self._plan_input.Eval(context)
        calibrated = self._bound_input.HasValue(context)
        bound = self._period * self._bound_input.Eval(context) if calibrated else self._bound
        turns = np.diff(plan.states[:, YAW])
        velocities = plan.inputs @ self._map.T
        following = size = self._tube.advance(self._size(context), turns[0], bound)
        rooms = []
        for i in range(1, self._horizon + 1):
            last = min(i, self._horizon - 1)
            rooms.append(
                input_room(self._tube, following, self._gains, velocities[last], self._inverse)
            )
            following = self._tube.advance(following, turns[last], bound)
        next_state.set_value(self._size_held, size.ravel())
        next_state.set_value(self._room_held, np.ravel(rooms))


def AddLaggedTubeUpdater(
    builder: DiagramBuilder,
    config: LaggedTubeConfig,
    model: LaggedModel,
    loop: LaggedLoop,
    gains: np.ndarray,
    *,
    period: float,
    horizon: int,
    input_limit: float,
    command_error: float,
    name: str = "lagged_tube_updater",
) -> LaggedTubeUpdater:
    """Adds a LaggedTubeUpdater to ``builder``; the caller connects its ports."""
    system = LaggedTubeUpdater(
        config,
        model,
        loop,
        gains,
        period=period,
        horizon=horizon,
        input_limit=input_limit,
        command_error=command_error,
    )
    return builder.AddNamedSystem(name, system)
