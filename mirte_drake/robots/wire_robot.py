"""The robot at the other end of a wire, as its controller sees it."""

import dataclasses as dc
from functools import partial
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    Context,
    InputPort,
    LeafSystem,
    State,
    ValueProducer,
)

from mirte_drake.control.plan import Plan, SolveStatus
from mirte_drake.frames import path_frame, to_odometry_frame, to_path_frame
from mirte_drake.hardware.messages import NOTHING, DriveCommand, GuardStatus, Odometry, PlanView
from mirte_drake.hardware.odometry_check import OdometryLimits, OdometryTrack, check
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.model.roll_forward import roll_forward
from mirte_drake.vectors import POSE, POSE_SIZE, WHEELS

HISTORY = 6  # Samples of commands kept; the guard stops long before odometry is so old.


@dc.dataclass(frozen=True)
class WireState:
    """What the adapter remembers from sample to sample."""

    track: OdometryTrack | None = None  # None before the first odometry.
    frame: np.ndarray | None = None  # (3,) of the path in that of the odometry.
    # When commands began and what they were, as the guard sent them; oldest first.
    sent: tuple[tuple[float, np.ndarray], ...] = ()
    since: float = -np.inf  # [s] clock at the last sample, when its command went out.
    arrival: float = -np.inf  # [s] of the last odometry looked at.

    def __deepcopy__(self, memo: dict) -> "WireState":
        """Returns itself: Drake copies the state at every update, and this never changes."""
        return self


class WireRobot(LeafSystem):
    """Turns odometry into the pose that the controller needs, and its command into a message.

    .. pydrake_system::

        name: WireRobot
        input_ports:
        - wheel_command
        - reference
        - solve_status
        - plan
        - odometry
        - guard_status
        - clock
        output_ports:
        - pose
        - body_velocity
        - odometry_age
        - drive_command
        - plan_view

    ==================  ============  ==================  =======================================
    port                type          unit                meaning
    ==================  ============  ==================  =======================================
    wheel_command (in)  vector (4,)   [pwm]               u_k
    reference (in)      vector (3,)   [m, m, rad]         r_k; open: the pose itself
    solve_status (in)   vector (1,)   -                   SolveStatus; open: solved
    plan (in)           Plan          -                   for onlookers; open: no plan_view
    odometry (in)       Odometry      -                   last message, or NOTHING
    guard_status (in)   GuardStatus   -                   last message, or NOTHING
    clock (in)          vector (1,)   [s]                 time.monotonic(); open: Drake's time
    pose                vector (3,)   [m, m, rad]         now, frame of the path, yaw unwrapped
    body_velocity       vector (3,)   [m/s, m/s, rad/s]   measured
    odometry_age        vector (1,)   [s]                 of the measurement that ``pose`` is from
    drive_command       DriveCommand  -                   to the guard; NOTHING before odometry
    plan_view           PlanView      -                   to onlookers, or NOTHING
    ==================  ============  ==================  =======================================

    Odometry is checked as the guard does. Where the first message says the robot is, is where the
    path begins, so that the odometry need not be reset before a drive. The pose is rolled forward
    over the age of the measurement, with the prediction model and the commands that the guard
    says it sent. A message that is rejected leaves the last good one in force, which then ages.
    Whether that is too old, the guard decides.

    State, every ``period`` s: ``WireState``. The pose has feedthrough from ``odometry``: a message
    counts in the sample in which it comes.
    """

    def __init__(
        self,
        model: PredictionModel,
        *,
        start: np.ndarray,
        period: float,
        session: int,
        limits: OdometryLimits,
        roll_forward: bool = True,
    ) -> None:
        """Declares ports and state.

        Args:
            model: Prediction model; its state is the pose, or pose and body velocity.
            start: (3,) [m, m, rad] where the path begins.
            period: [s] sample time T_s.
            session: Number of this controller for the guard.
            limits: What odometry must keep to.
            roll_forward: Whether to predict the pose over the age of the measurement.
        """
        super().__init__()
        self._model, self._start, self._period = model, np.array(start), period
        self._session, self._limits, self._rolls = session, limits, roll_forward
        # Compiled code is loaded, or made, on its first call: seconds, which no odometry may age.
        model.step(np.zeros(model.num_states), np.zeros(len(WHEELS)), period)
        nothing = AbstractValue.Make(NOTHING)
        self._command = self.DeclareVectorInputPort("wheel_command", len(WHEELS))
        self._reference = self.DeclareVectorInputPort("reference", POSE_SIZE)
        self._status = self.DeclareVectorInputPort("solve_status", 1)
        self._plan = self.DeclareAbstractInputPort("plan", nothing)
        self._odometry = self.DeclareAbstractInputPort("odometry", nothing)
        self._guard = self.DeclareAbstractInputPort("guard_status", nothing)
        self._clock = self.DeclareVectorInputPort("clock", 1)
        self._state = self.DeclareAbstractState(AbstractValue.Make(WireState()))
        sources = {
            self.abstract_state_ticket(self._state),
            self._odometry.ticket(),
            self._guard.ticket(),
            self._clock.ticket(),
        }
        allocate = partial(AbstractValue.Make, WireState())
        self._now = self.DeclareCacheEntry(
            "state of now", ValueProducer(allocate, self._calc_now), {*sources, self.time_ticket()}
        )
        now = {self._now.ticket()}
        self.DeclareVectorOutputPort("pose", POSE_SIZE, self._calc_pose, now)
        self.DeclareVectorOutputPort("body_velocity", POSE_SIZE, self._calc_body_velocity, now)
        self.DeclareVectorOutputPort("odometry_age", 1, self._calc_odometry_age, now)
        self.DeclareAbstractOutputPort(
            "drive_command",
            lambda: nothing.Clone(),
            self._calc_drive_command,
            {
                *now,
                self._command.ticket(),
                self._reference.ticket(),
                self._status.ticket(),
            },
        )
        self.DeclareAbstractOutputPort(
            "plan_view",
            lambda: nothing.Clone(),
            self._calc_plan_view,
            {*now, self._plan.ticket()},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _calc_now(self, context: Context, value: AbstractValue) -> None:
        value.set_value(self._advance(context))

    def _advance(self, context: Context) -> WireState:
        """Returns the state with what has come since the last sample."""
        state: WireState = context.get_abstract_state(int(self._state)).get_value()
        clock = float(_eval_or(self._clock, context, np.array([context.get_time()]))[0])
        if clock <= state.since:
            return state  # Updated at this instant.
        sent = state.sent
        if np.isfinite(state.since):
            status: GuardStatus | tuple = _eval_or(self._guard, context, NOTHING)
            still = np.zeros(len(WHEELS))
            command = status.command if isinstance(status, GuardStatus) else still
            sent = (*sent, (state.since, command))[-HISTORY:]
        state = dc.replace(state, sent=sent, since=clock)
        odometry: Odometry | tuple = _eval_or(self._odometry, context, NOTHING)
        if not isinstance(odometry, Odometry) or odometry.arrival == state.arrival:
            return state
        track, _ = check(state.track, odometry, self._limits)
        frame = state.frame
        if frame is None and track is not None:
            frame = path_frame(track.last.pose, self._start)
        return dc.replace(state, track=track, frame=frame, arrival=odometry.arrival)

    def _update(self, context: Context, next_state: State) -> None:
        next_state.get_mutable_abstract_state(int(self._state)).set_value(self._advance(context))

    def _get_now(self, context: Context) -> WireState:
        return self.get_cache_entry(self._now.cache_index()).Eval(context)

    def _measured(self, state: WireState) -> np.ndarray:
        """Returns the measured pose (3,) in the path's frame, its start before any odometry."""
        if state.track is None or state.frame is None:
            return self._start
        return to_path_frame(state.track.last.pose, state.frame)

    def _measured_velocity(self, state: WireState) -> np.ndarray:
        return np.zeros(POSE_SIZE) if state.track is None else state.track.last.body_velocity

    def _age(self, state: WireState) -> float:
        return 0.0 if state.track is None else state.track.age(state.since)

    def _calc_pose(self, context: Context, output: BasicVector) -> None:
        now = self._get_now(context)
        state = self._measured(now)
        if self._rolls:
            if self._model.num_states > POSE_SIZE:
                state = np.concatenate([state, self._measured_velocity(now)])
            measured = now.since - self._age(now)
            late = self._model.delay * self._period
            sent = [(time + late, command) for time, command in now.sent]
            state = roll_forward(self._model, state, sent, measured, now.since)
        output.SetFromVector(state[POSE])

    def _calc_body_velocity(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._measured_velocity(self._get_now(context)))

    def _calc_odometry_age(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([self._age(self._get_now(context))])

    def _calc_drive_command(self, context: Context, output: AbstractValue) -> None:
        state = self._get_now(context)
        if state.track is None or state.frame is None:
            output.set_value(NOTHING)
            return
        reference = _eval_or(self._reference, context, self._measured(state))
        status = SolveStatus(int(_eval_or(self._status, context, [SolveStatus.SOLVED])[0]))
        command = DriveCommand(
            session=self._session,
            sequence=round(context.get_time() / self._period),
            command=self._command.Eval(context),
            reference=to_odometry_frame(reference, state.frame),
            odometry_stamp=state.track.last.stamp,
            solve_failed=status.failed,
        )
        output.set_value(command)

    def _calc_plan_view(self, context: Context, output: AbstractValue) -> None:
        frame = self._get_now(context).frame
        plan: Plan | tuple = _eval_or(self._plan, context, NOTHING)
        if frame is None or not isinstance(plan, Plan):
            output.set_value(NOTHING)
            return
        view = PlanView(
            reference=to_odometry_frame(plan.data.reference, frame),
            nominal=to_odometry_frame(plan.states[:, POSE], frame),
            half_width=plan.data.half_width[POSE],
        )
        output.set_value(view)


def _eval_or(port: InputPort, context: Context, default: Any) -> Any:  # noqa: ANN401
    return port.Eval(context) if port.HasValue(context) else default
