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

from mirte_drake.checks import check_array, check_number
from mirte_drake.control.conformal import (
    AdaptiveConformal,
    Calibration,
    adapt,
    box_scores,
    first_calibration,
    missed,
)
from mirte_drake.sampling import sample_number
from mirte_drake.vectors import POSE_SIZE


@dc.dataclass
class CoverageMonitorConfig:
    """Config of CoverageMonitor; see ``control.conformal`` for the calibrated set."""

    # (3,) [m/s, m/s, rad/s] or null: the set in use, body frame; the calibrated one has its shape.
    # null: that of the tube.
    disturbance_bound: np.ndarray | None = None
    target: float = 0.9  # Share of errors that a set shall hold.
    gain: float = 0.05  # gamma.
    window: int = 100  # [samples] of the quantile and of the running coverage.
    cap: float = 10.0  # Largest calibrated set, as a multiple of the set in use.
    band: float = 0.05  # By how much the running coverage may differ from the target.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        if self.disturbance_bound is not None:
            check_array("disturbance_bound", self.disturbance_bound, (POSE_SIZE,), minimum=1e-9)
        self.calibration().validate()
        check_number("band", self.band, minimum=0, maximum=1)

    def calibration(self) -> AdaptiveConformal:
        """Returns the settings of the calibrated set."""
        return AdaptiveConformal(self.target, self.gain, self.window, self.cap)


class CoverageMonitor(LeafSystem):
    """Judges each one-step error by the set in use and by one that it calibrates.

    .. pydrake_system::

        name: CoverageMonitor
        input_ports:
        - error
        output_ports:
        - prediction_error
        - calibrated_bound
        - coverage
        - coverage_warning

    ==================  ===========  ==================  =========================================
    port                type         unit                meaning
    ==================  ===========  ==================  =========================================
    error (in)          vector (3,)  [m/s, m/s, rad/s]   of the pose predicted a sample before,
                                                         over T_s, body frame; not finite: none
    prediction_error    vector (3,)  [m/s, m/s, rad/s]   that of the last sample; NaN: none
    calibrated_bound    vector (3,)  [m/s, m/s, rad/s]   half-widths of the calibrated set, for the
                                                         error after the one that is there
    coverage            vector (2,)  -                   running share of errors held by the set
                                                         in use, by the calibrated set; NaN: none
    coverage_warning    vector (2,)  -                   1 where the window is full and: the set in
                                                         use holds less than the band allows; the
                                                         calibrated set less or more
    ==================  ===========  ==================  =========================================

    ``calibrated_bound`` has feedthrough from ``error``, so that a tube can reckon with it in the
    sample in which the error came. The other outputs are states or follow from them alone, and
    reckon with an error after its sample. A sample without an error counts for nothing.

    Raises:
        ValueError: when ``config`` is out of range (at construction).
    """

    def __init__(self, config: CoverageMonitorConfig, bound: np.ndarray, *, period: float) -> None:
        """Declares ports and state.

        Args:
            config: The config.
            bound: (3,) [m/s, m/s, rad/s] the set in use.
            period: [s] sample time T_s.
        """
        super().__init__()
        config.validate()
        check_array("disturbance_bound", bound, (POSE_SIZE,), minimum=1e-9)
        self._config, self._period, self._settings = config, period, config.calibration()
        self._bound = np.array(bound)
        first = first_calibration(self._settings)
        self._error_input = self.DeclareVectorInputPort("error", POSE_SIZE)
        self._error = self.DeclareDiscreteState(np.full(POSE_SIZE, np.nan))
        self._calibration = self.DeclareDiscreteState([first.miss_rate, first.scale])
        # Of the last errors, oldest first, NaN where there are fewer: scores, and whether the
        # calibrated set held each.
        self._scores = self.DeclareDiscreteState(np.full(config.window, np.nan))
        self._held = self.DeclareDiscreteState(np.full(config.window, np.nan))
        self._newest = self.DeclareDiscreteState([-1.0])  # Number of the last sample.
        self.DeclareStateOutputPort("prediction_error", self._error)
        states = {self.xd_ticket()}
        self.DeclareVectorOutputPort(
            "calibrated_bound",
            POSE_SIZE,
            self._calc_bound,
            {self.time_ticket(), *states, self._error_input.ticket()},
        )
        self.DeclareVectorOutputPort("coverage", 2, self._calc_coverage, states)
        self.DeclareVectorOutputPort("coverage_warning", 2, self._calc_warning, states)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, next_state: DiscreteValues) -> None:
        error, number = self._error_input.Eval(context), self._number(context)
        next_state.set_value(self._newest, [float(number)])
        next_state.set_value(self._error, error)
        if not np.all(np.isfinite(error)):
            return
        before, score = self._calibration_before(context), self._score(error)
        after = adapt(self._settings, before, score)
        held = context.get_discrete_state(self._held).value()
        unused = np.full(self._config.window - len(after.scores), np.nan)
        next_state.set_value(self._calibration, [after.miss_rate, after.scale])
        next_state.set_value(self._scores, np.concatenate([unused, after.scores]))
        next_state.set_value(self._held, np.append(held[1:], not missed(before, score)))

    def _number(self, context: Context) -> int:
        return int(sample_number(context.get_time(), self._period))

    def _score(self, error: np.ndarray) -> float:
        return float(box_scores(error, self._bound))

    def _calibration_before(self, context: Context) -> Calibration:
        """Returns the state that judges an error which is due, or that the last one has led to."""
        rate, scale = context.get_discrete_state(self._calibration).value()
        scores = context.get_discrete_state(self._scores).value()
        return Calibration(rate, scale, scores[np.isfinite(scores)])

    def _calc_bound(self, context: Context, output: BasicVector) -> None:
        calibration, error = self._calibration_before(context), self._error_input.Eval(context)
        due = self._number(context) > context.get_discrete_state(self._newest).value()[0]
        if due and np.all(np.isfinite(error)):
            calibration = adapt(self._settings, calibration, self._score(error))
        output.SetFromVector(calibration.scale * self._bound)

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
    bound: np.ndarray,
    *,
    period: float,
    name: str = "coverage_monitor",
) -> CoverageMonitor:
    """Adds a CoverageMonitor to ``builder``; the caller connects its ports."""
    return builder.AddNamedSystem(name, CoverageMonitor(config, bound, period=period))
