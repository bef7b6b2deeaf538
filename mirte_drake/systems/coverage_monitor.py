"""Watches how often the disturbance set holds the one-step error, and calibrates one that does."""

import dataclasses as dc

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
)

from mirte_drake.angles import pose_error, rotation
from mirte_drake.checks import check_array, check_number
from mirte_drake.control.conformal import (
    AdaptiveConformal,
    Calibration,
    adapt,
    box_scores,
    first_calibration,
    missed,
)
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.vectors import POSE, POSE_SIZE, YAW


@dc.dataclass
class CoverageMonitorConfig:
    """Config of CoverageMonitor; see ``control.conformal`` for the calibrated set."""

    # (3,) [m/s, m/s, rad/s] the set in use, body frame; the calibrated one has its shape.
    disturbance_bound: np.ndarray = dc.field(default_factory=lambda: np.array([0.04, 0.03, 0.09]))
    target: float = 0.9  # Share of errors that a set shall hold.
    gain: float = 0.05  # gamma.
    window: int = 100  # [samples] of the quantile and of the running coverage.
    cap: float = 10.0  # Largest calibrated set, as a multiple of the set in use.
    band: float = 0.05  # By how much the running coverage may differ from the target.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_array("disturbance_bound", self.disturbance_bound, (POSE_SIZE,), minimum=1e-9)
        self.calibration().validate()
        check_number("band", self.band, minimum=0, maximum=1)

    def calibration(self) -> AdaptiveConformal:
        """Returns the settings of the calibrated set."""
        return AdaptiveConformal(self.target, self.gain, self.window, self.cap)


class CoverageMonitor(LeafSystem):
    """Compares each pose with what the model predicted for it a sample before.

    .. pydrake_system::

        name: CoverageMonitor
        input_ports:
        - pose
        - state
        - wheel_command
        output_ports:
        - prediction_error
        - calibrated_bound
        - coverage
        - coverage_warning

    ==================  ===========  ==================  =========================================
    port                type         unit                meaning
    ==================  ===========  ==================  =========================================
    pose (in)           vector (3,)  [m, m, rad]         measured at t_k
    state (in)          vector (n,)  model's             x_k: what the next pose is predicted from;
                                                         of a kinematic model the pose
    wheel_command (in)  vector (m,)  [pwm]               u_k, as it is applied
    prediction_error    vector (3,)  [m/s, m/s, rad/s]   of the pose, over T_s, in the body frame
                                                         of the sample before; NaN: none yet
    calibrated_bound    vector (3,)  [m/s, m/s, rad/s]   half-widths of the calibrated set, for the
                                                         next error
    coverage            vector (2,)  -                   running share of errors held by the set
                                                         in use, by the calibrated set; NaN: none
    coverage_warning    vector (2,)  -                   1 where the window is full and: the set in
                                                         use holds less than the band allows; the
                                                         calibrated set less or more
    ==================  ===========  ==================  =========================================

    All outputs are states or follow from them alone. A sample without a finite pose, or after one
    without a finite state, counts for nothing.

    Raises:
        ValueError: when ``config`` is out of range (at construction).
    """

    def __init__(
        self, config: CoverageMonitorConfig, model: PredictionModel, *, period: float
    ) -> None:
        """Declares ports and state.

        Args:
            config: The config.
            model: What predicts; the first three states are the pose.
            period: [s] sample time T_s.
        """
        super().__init__()
        config.validate()
        self._config, self._model, self._period = config, model, period
        self._settings, nothing = config.calibration(), np.full(POSE_SIZE, np.nan)
        first = first_calibration(self._settings)
        self._pose_input = self.DeclareVectorInputPort("pose", POSE_SIZE)
        self._state_input = self.DeclareVectorInputPort("state", model.num_states)
        self._command_input = self.DeclareVectorInputPort("wheel_command", model.num_inputs)
        self._prediction = self.DeclareDiscreteState(nothing)
        self._yaw = self.DeclareDiscreteState([np.nan])  # [rad] When that was predicted.
        self._error = self.DeclareDiscreteState(nothing)
        self._calibration = self.DeclareDiscreteState([first.miss_rate, first.scale])
        # Of the last errors, oldest first, NaN where there are fewer: scores, and whether the
        # calibrated set held each.
        self._scores = self.DeclareDiscreteState(np.full(config.window, np.nan))
        self._held = self.DeclareDiscreteState(np.full(config.window, np.nan))
        self.DeclareStateOutputPort("prediction_error", self._error)
        states = {self.xd_ticket()}
        self.DeclareVectorOutputPort("calibrated_bound", POSE_SIZE, self._calc_bound, states)
        self.DeclareVectorOutputPort("coverage", 2, self._calc_coverage, states)
        self.DeclareVectorOutputPort("coverage_warning", 2, self._calc_warning, states)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, next_state: DiscreteValues) -> None:
        pose, state = self._pose_input.Eval(context), self._state_input.Eval(context)
        command = self._command_input.Eval(context)
        predicted = context.get_discrete_state(self._prediction).value()
        yaw = context.get_discrete_state(self._yaw).value()[0]
        with np.errstate(invalid="ignore"):
            error = rotation(yaw).T @ pose_error(pose, predicted) / self._period
            prediction = self._model.step(state, command, self._period)[POSE]
        next_state.set_value(self._prediction, prediction)
        next_state.set_value(self._yaw, [state[YAW]])
        if not np.all(np.isfinite(error)):
            return
        before = self._read_calibration(context)
        score = float(box_scores(error, self._config.disturbance_bound))
        after = adapt(self._settings, before, score)
        held = context.get_discrete_state(self._held).value()
        unused = np.full(self._config.window - len(after.scores), np.nan)
        next_state.set_value(self._error, error)
        next_state.set_value(self._calibration, [after.miss_rate, after.scale])
        next_state.set_value(self._scores, np.concatenate([unused, after.scores]))
        next_state.set_value(self._held, np.append(held[1:], not missed(before, score)))

    def _read_calibration(self, context: Context) -> Calibration:
        rate, scale = context.get_discrete_state(self._calibration).value()
        scores = context.get_discrete_state(self._scores).value()
        return Calibration(rate, scale, scores[np.isfinite(scores)])

    def _calc_bound(self, context: Context, output: BasicVector) -> None:
        scale = self._read_calibration(context).scale
        output.SetFromVector(scale * self._config.disturbance_bound)

    def _running_coverage(self, context: Context) -> tuple[np.ndarray, bool]:
        """Returns both shares (2,), and whether the window is full."""
        scores = context.get_discrete_state(self._scores).value()
        held = context.get_discrete_state(self._held).value()
        seen = np.isfinite(scores)
        if not np.any(seen):
            return np.full(2, np.nan), False
        return np.array([np.mean(scores[seen] <= 1.0), np.mean(held[seen])]), bool(np.all(seen))

    def _calc_coverage(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._running_coverage(context)[0])

    def _calc_warning(self, context: Context, output: BasicVector) -> None:
        coverage, full = self._running_coverage(context)
        excess = coverage - self._config.target
        out_of_band = [excess[0] < -self._config.band, abs(excess[1]) > self._config.band]
        output.SetFromVector(np.array(out_of_band, dtype=float) * full)


def AddCoverageMonitor(
    builder: DiagramBuilder,
    config: CoverageMonitorConfig,
    model: PredictionModel,
    *,
    period: float,
    name: str = "coverage_monitor",
) -> CoverageMonitor:
    """Adds a CoverageMonitor to ``builder``; the caller connects its ports."""
    return builder.AddNamedSystem(name, CoverageMonitor(config, model, period=period))
