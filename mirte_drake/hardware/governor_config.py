"""Limits that the safety governor holds a drive to."""

import dataclasses as dc

import numpy as np

from mirte_drake.checks import check_array, check_number
from mirte_drake.hardware.odometry_check import OdometryLimits


@dc.dataclass
class GovernorConfig:
    """Config of Governor; the ages leave 20 ms to be on the wire within 0.25 s."""

    max_odometry_age: float = 0.23  # [s]
    heartbeat_timeout: float = 0.23  # [s] Longest silence of the controller.
    max_stall: float = 0.1  # [s] Longest time between two outputs of the governor.
    max_solve_failures: int = 3  # In a row: at this one the robot stops.
    # (4,) [m] x_min, y_min, x_max, y_max in the path's frame.
    allowed_area: np.ndarray = dc.field(default_factory=lambda: np.array([-3.0, -3.0, 3.0, 3.0]))
    # (2,) [m, rad] From the reference of the sample.
    max_tracking_error: np.ndarray = dc.field(default_factory=lambda: np.array([0.5, 0.8]))
    command_limit: float = 100.0  # [pwm]
    slew_limit: float = 1000.0  # [pwm/s]
    slew_time: float = 0.1  # [s] Longest time between two commands that counts for the slew.
    # [pwm] of four wheels alike, which must move the robot. Two wheels broke away at 40 to 48 pwm,
    # which pushes as four do at 28 to 34; four at 50 drive at 0.45 m/s.
    breakaway: float = 40.0
    max_frozen_time: float = 0.5  # [s] Longest time of the same odometry beyond the breakaway.
    odometry: OdometryLimits = dc.field(default_factory=OdometryLimits)

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        for name in ("max_odometry_age", "heartbeat_timeout", "max_stall", "max_frozen_time"):
            check_number(name, getattr(self, name), above=0, maximum=1)
        for name in ("slew_limit", "slew_time", "breakaway"):
            check_number(name, getattr(self, name), above=0)
        check_number("max_solve_failures", self.max_solve_failures, minimum=1)
        check_number("command_limit", self.command_limit, minimum=0, maximum=100)
        check_array("max_tracking_error", self.max_tracking_error, (2,), minimum=0)
        check_array("allowed_area", self.allowed_area, (4,))
        x_min, y_min, x_max, y_max = self.allowed_area
        if not (x_min < x_max and y_min < y_max):
            raise ValueError(
                "allowed_area: must be x_min, y_min, x_max, y_max with min < max, "
                f"got {np.asarray(self.allowed_area).tolist()}"
            )
        try:
            self.odometry.validate()
        except ValueError as error:
            raise ValueError(f"odometry.{error}") from None
        # A track that began anew would make the odometry young again.
        if self.odometry.restart_after <= self.max_odometry_age:
            raise ValueError(
                f"odometry.restart_after: must be > max_odometry_age, {self.max_odometry_age} s, "
                f"got {self.odometry.restart_after}"
            )
