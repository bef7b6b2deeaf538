"""Everything that defines one run, as dataclasses."""

import dataclasses as dc
from typing import get_args

import numpy as np

from mirte_drake.checks import check_array, check_number, check_parts
from mirte_drake.control.reference_paths import RectanglePath
from mirte_drake.errors import UserError
from mirte_drake.model.lagged_model import LaggedModel
from mirte_drake.model.model_file import load_model
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.robots.dynamic_robot import DynamicRobotConfig
from mirte_drake.robots.lcm_robot import LcmRobotConfig
from mirte_drake.robots.measured_robot import RobotConfig
from mirte_drake.robots.odometry_sensor import OdometrySensorConfig
from mirte_drake.robots.ros2_robot import Ros2RobotConfig
from mirte_drake.robots.sindyc_robot import SindycRobotConfig
from mirte_drake.systems.ancillary_dlqr import AncillaryDlqrConfig
from mirte_drake.systems.ancillary_inversion import AncillaryInversionConfig
from mirte_drake.systems.ancillary_lagged import AncillaryLaggedConfig
from mirte_drake.systems.coverage_monitor import CoverageMonitorConfig
from mirte_drake.systems.disturbance_source import (
    DisturbanceConfig,
    UniformDisturbance,
)
from mirte_drake.systems.inversion_tube_updater import InversionTubeUpdaterConfig
from mirte_drake.systems.lagged_tube_updater import LaggedTubeConfig
from mirte_drake.systems.nominal_nmpc import NominalNmpcConfig
from mirte_drake.systems.pose_lqr import PoseLqrConfig
from mirte_drake.systems.pose_pid import PosePidConfig
from mirte_drake.systems.reference_source import ReferencePathConfig
from mirte_drake.systems.state_estimator import StateEstimatorConfig
from mirte_drake.systems.tube_updater import TubeUpdaterConfig
from mirte_drake.systems.velocity_setpoint import VelocitySetpointConfig
from mirte_drake.systems.wheel_command_limiter import WheelCommandLimiterConfig
from mirte_drake.vectors import POSE_SIZE, WHEELS

WiredRobotConfig = Ros2RobotConfig | LcmRobotConfig
PoseControllerConfig = PosePidConfig | PoseLqrConfig

KINDS = (
    *get_args(ReferencePathConfig),
    VelocitySetpointConfig,
    *get_args(DisturbanceConfig),
    *get_args(RobotConfig),
    *get_args(WiredRobotConfig),
    *get_args(PoseControllerConfig),
)
# Tubes, and the ancillary laws that they are for.
_TUBES = {
    "tube_updater": "ancillary_dlqr",
    "inversion_tube_updater": "ancillary_inversion",
    "lagged_tube": "ancillary_lagged",
}
JITTER = 0.012  # [s] Of odometry: the middle of what the robot's recordings look like.


@dc.dataclass
class Scenario:
    """Everything that defines one run; the defaults are the study's rectangle."""

    extends: str = ""  # Name of a scenario whose values are the defaults of this one.
    description: str = ""
    seed: int = 0  # Of the disturbance and of the odometry's jitter.
    duration: float | None = None  # [s]; null: the reference path's own.
    period: float = 0.1  # [s] T_s.
    input_limit: float = 100.0  # [pwm] every wheel, LB = -UB.
    # Name or YAML file. Of a lagged one the state is estimated; of others it must be the pose.
    prediction_model: str = "extended_kinematic"
    reference: ReferencePathConfig | VelocitySetpointConfig = dc.field(
        default_factory=RectanglePath
    )
    # null: the NMPC of the fields that follow. Another one plans nothing, and has only the
    # reference's horizon from them.
    controller: PosePidConfig | PoseLqrConfig | None = None
    nominal_nmpc: NominalNmpcConfig = dc.field(default_factory=NominalNmpcConfig)
    ancillary_dlqr: AncillaryDlqrConfig | None = dc.field(default_factory=AncillaryDlqrConfig)
    # null: the baseline NMPC, which starts from the measured state with full input bounds.
    tube_updater: TubeUpdaterConfig | None = dc.field(default_factory=TubeUpdaterConfig)
    # Instead of these two: an ancillary law that inverts the input map, and its tube.
    ancillary_inversion: AncillaryInversionConfig | None = None
    inversion_tube_updater: InversionTubeUpdaterConfig | None = None
    # null: nobody watches how often the disturbance set holds the one-step error.
    coverage_monitor: CoverageMonitorConfig | None = None
    # With a lagged prediction model, and only then, in place of ancillary law and tube.
    state_estimator: StateEstimatorConfig | None = None
    ancillary_lagged: AncillaryLaggedConfig | None = None
    lagged_tube: LaggedTubeConfig | None = None  # null: the plan begins at the estimated state.
    wheel_command_limiter: WheelCommandLimiterConfig = dc.field(
        default_factory=WheelCommandLimiterConfig
    )
    # A multibody robot has no input for it: what disturbs that one is its floor.
    disturbance: DisturbanceConfig = dc.field(default_factory=UniformDisturbance)
    robot: RobotConfig | WiredRobotConfig = dc.field(default_factory=SindycRobotConfig)
    # null: the robot's own, see ``measuring_odometry``. In a file it is another one from its
    # defaults on; ``--set odometry.latency=0.05`` changes the one that the robot would have.
    odometry: OdometrySensorConfig | None = None
    # Of the simulated robot; null: its own, 0.01 of a dynamic robot, 1e-6 of the others.
    integration_accuracy: float | None = None

    def validate(self) -> None:
        """Checks every value.

        Raises:
            ValueError: naming the field, its value and what it must be.
        """
        model = load_prediction_model(self)
        check_number("seed", self.seed, minimum=0, maximum=2**53)
        check_number("period", self.period, above=0)
        check_number("input_limit", self.input_limit, above=0)
        if self.integration_accuracy is not None:
            check_number("integration_accuracy", self.integration_accuracy, above=0)
        if self.duration is not None:
            check_number("duration", self.duration, minimum=self.period)
        elif isinstance(self.reference, VelocitySetpointConfig):
            raise ValueError("duration: must be given [s], a velocity setpoint has no end")
        check_parts(self)
        lagged = isinstance(model, LaggedModel)
        self._check_kind_of_controller(lagged)
        self._check_parts_of_the_model(lagged)
        self._check_monitor()
        for tube, law in _TUBES.items():
            if getattr(self, tube) is not None and getattr(self, law) is None:
                raise ValueError(f"{tube}: needs {law}; set it, or both to null")
        if self.ancillary_dlqr is not None and self.ancillary_inversion is not None:
            raise ValueError(
                "ancillary_inversion: stands in for ancillary_dlqr; set ancillary_dlqr and "
                "tube_updater to null"
            )

    def _check_kind_of_controller(self, lagged: bool) -> None:
        """Checks that a controller that does not plan has no parts of one that does."""
        if self.controller is None:
            return
        kind = type(self.controller).__name__
        if lagged:
            raise ValueError(
                f"prediction_model: {self.prediction_model!r} is a lagged one, which controller "
                f"{kind} cannot have; use extended_kinematic"
            )
        for field in (*_TUBES.values(), *_TUBES, "state_estimator", "coverage_monitor"):
            if getattr(self, field) is not None:
                raise ValueError(f"{field}: must be null with controller {kind}")

    def _check_parts_of_the_model(self, lagged: bool) -> None:
        """Checks that the controller consists of what its prediction model needs."""
        for field in ("state_estimator", "ancillary_lagged"):
            if (getattr(self, field) is not None) != lagged:
                wrong = "must be given" if lagged else "must be null"
                kind = "a lagged" if lagged else "no lagged"
                raise ValueError(
                    f"{field}: {wrong}, {self.prediction_model!r} is {kind} prediction model; "
                    "lagged_rectangle is a scenario with all parts of one"
                )
        if self.lagged_tube is not None and not lagged:
            raise ValueError("lagged_tube: must be null without a lagged prediction model")
        deadband = self.wheel_command_limiter.deadband
        if self.lagged_tube is not None and deadband > 0:
            raise ValueError(
                "wheel_command_limiter.deadband: must be 0 with lagged_tube, whose law passes the "
                f"robot's own, got {deadband:g}"
            )
        for field in ("ancillary_dlqr", "ancillary_inversion"):
            if lagged and getattr(self, field) is not None:
                raise ValueError(f"{field}: must be null with a lagged prediction model")

    def _check_monitor(self) -> None:
        """Checks that a coverage monitor has a set to watch, and a calibrated tube a monitor."""
        if self.coverage_monitor is not None:
            watched = self._watched_set()
            if watched is None:
                raise ValueError("coverage_monitor.disturbance_bound: must be given without a tube")
            check_array(*watched, (POSE_SIZE,), minimum=1e-9)
        elif self.lagged_tube is not None and self.lagged_tube.calibrated:
            raise ValueError("lagged_tube.calibrated: needs a coverage_monitor")

    def _watched_set(self) -> tuple[str, np.ndarray] | None:
        """Returns the field of the set that a coverage monitor watches, and its half-widths (3,).

        Of a lag-aware tube they are [m, m, rad], of innovations; else [m/s, m/s, rad/s].
        """
        monitor = self.coverage_monitor
        if monitor is not None and monitor.disturbance_bound is not None:
            return "coverage_monitor.disturbance_bound", monitor.disturbance_bound
        if self.lagged_tube is not None:
            return "lagged_tube.innovation_bound", self.lagged_tube.innovation_bound
        for field, tube in (
            ("tube_updater", self.tube_updater),
            ("inversion_tube_updater", self.inversion_tube_updater),
        ):
            if tube is not None:
                return f"{field}.disturbance_bound", tube.disturbance_bound
        return None

    @property
    def disturbance_bound(self) -> np.ndarray | None:
        """Half-widths (3,) [m/s, m/s, rad/s] of the set that a coverage monitor watches.

        Where it names none, that of the tube; of a lag-aware one the bound on innovations, over
        the period. None: there is neither.
        """
        watched = self._watched_set()
        if watched is None:
            return None
        field, bound = watched
        return bound / self.period if field == "lagged_tube.innovation_bound" else bound

    @property
    def has_tube(self) -> bool:
        """Whether the controller keeps the robot in a tube."""
        return any(getattr(self, tube) is not None for tube in _TUBES)

    @property
    def delay(self) -> int:
        """Samples from command to motion that the controller plans with."""
        if self.state_estimator is None:
            return 0
        delay = self.state_estimator.delay
        return load_prediction_model(self).delay if delay is None else delay

    @property
    def first_pose(self) -> np.ndarray:
        """First pose (3,) of the reference [m, m, rad]."""
        if isinstance(self.reference, VelocitySetpointConfig):
            return self.reference.start
        return self.reference.poses(self.period)[0]

    @property
    def measuring_odometry(self) -> OdometrySensorConfig | None:
        """The odometry that measures the pose; None: the true pose is measured.

        A robot has its own unless the scenario gives one: a SINDYc robot, which has no wheels and
        serves the studies, none; the others that of the recordings. Where a SINDYc robot is given
        one, wheels roll under it without slip.
        """
        if self.odometry is None and not isinstance(self.robot, SindycRobotConfig):
            return OdometrySensorConfig(jitter=JITTER)
        return self.odometry

    @property
    def accuracy(self) -> float:
        """Accuracy that the robot is integrated with."""
        if self.integration_accuracy is not None:
            return self.integration_accuracy
        return 1e-2 if isinstance(self.robot, DynamicRobotConfig) else 1e-6

    @property
    def steps(self) -> int:
        """Number of samples of the run, the first at time 0."""
        if self.duration is not None:
            return round(self.duration / self.period) + 1
        assert not isinstance(self.reference, VelocitySetpointConfig)
        return len(self.reference.poses(self.period))


def load_prediction_model(scenario: Scenario) -> PredictionModel:
    """Returns the model that the controller predicts with.

    Raises:
        UserError: when it cannot be read, or has states beside the pose.
    """
    try:
        model = load_model(scenario.prediction_model)
    except UserError as error:
        raise UserError(f"prediction_model: {error}") from None
    if model.num_inputs != len(WHEELS):
        raise UserError(
            f"prediction_model: {scenario.prediction_model!r} must have {len(WHEELS)} inputs, "
            f"one per wheel, got {model.num_inputs}"
        )
    if model.num_states != POSE_SIZE and not isinstance(model, LaggedModel):
        raise UserError(
            f"prediction_model: {scenario.prediction_model!r} has states beside the pose "
            f"({', '.join(model.states[POSE_SIZE:])}), which the robot does not measure; "
            "use kinematic or extended_kinematic, or a lagged model"
        )
    return model


def check_simulated(scenario: Scenario) -> None:
    """Raises UserError when the robot of a scenario is beyond a wire."""
    if isinstance(scenario.robot, WiredRobotConfig):
        raise UserError("robot: is beyond a wire: `mirte-drake drive` runs it")


def load_planning_model(scenario: Scenario) -> PredictionModel:
    """Returns the model that plans are made with: of a lagged one, that in effective commands.

    Raises:
        UserError: as ``load_prediction_model``.
    """
    model = load_prediction_model(scenario)
    return model.effective() if isinstance(model, LaggedModel) else model


def wired_robot(scenario: Scenario) -> WiredRobotConfig:
    """Returns the robot of a scenario, which must be beyond a wire.

    Raises:
        UserError: when it is a simulated one.
    """
    if not isinstance(scenario.robot, WiredRobotConfig):
        raise UserError(
            f"robot: {type(scenario.robot).__name__} is simulated; name its wire by "
            "--transport ros2 or --transport lcm"
        )
    return scenario.robot
