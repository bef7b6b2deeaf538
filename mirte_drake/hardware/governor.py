"""The safety governor: what may go to the wheels, as events and times in and a command out.

It has no clock, no I/O and no thread, and trusts neither the controller nor the odometry.
"""

import dataclasses as dc
import enum
import math

import numpy as np

from mirte_drake.angles import pose_error
from mirte_drake.checks import check_array, check_number
from mirte_drake.frames import path_frame, to_path_frame
from mirte_drake.hardware.governor_config import GovernorConfig
from mirte_drake.hardware.messages import (
    DriveCommand,
    GuardStatus,
    Odometry,
    OperatorRequest,
    Request,
    WheelCommand,
)
from mirte_drake.hardware.odometry_check import MAX_STAMP, OdometryTrack, check
from mirte_drake.hardware.wheel_limits import STILL, limit_command, push
from mirte_drake.vectors import POSE_SIZE, WHEELS, YAW


class Phase(enum.Enum):
    """What the governor is doing; the wheels stand still in all phases but one."""

    WAITING = "waiting"  # For good odometry and a controller.
    DRIVING = "driving"
    FINISHED = "finished"  # As WAITING; the controller said that it was done.
    STOPPED = "stopped"  # Latched until reset.


@dc.dataclass
class _Drive:
    """What the governor knows of the session that it follows."""

    session: int = 0  # None yet.
    frame: np.ndarray = dc.field(default_factory=lambda: np.zeros(POSE_SIZE))  # Of the path.
    sequence: int = -1  # Of the last command.
    heartbeat: float = 0.0  # [s] when it came.
    failures: int = 0  # Failed solves in a row.
    wanted: DriveCommand | None = None  # A command yet to be passed on.
    passed: int = 0  # Sequence of the last command passed on.
    passed_at: float = -math.inf  # [s] when that was.
    output_at: float = 0.0  # [s] last output.
    pushed_since: float = math.inf  # [s] since when the commands must move the robot.


class Governor:
    """Passes on the commands of one controller while all is well; else the wheels stand still.

    - Waits for good odometry and a controller, and follows that one until it is done.
    - Passes on each command once, in order, rounded, within the command and the slew limit.
    - Stops when a value goes beyond its limit: age of the odometry, of the controller's last
      command, of the odometry that a command answers; time since the last output; failed solves;
      position; tracking error; odometry that stays the same while the wheels push.
    - Stops at a command that is not finite, a second controller, another sender on the wheel
      topics, and when the operator asks for it.
    - A stop holds until the operator resets it with good odometry; then a new session may begin.

    Every limit is looked at before an event is heard, so none comes just in time after all. Times
    are those of ``time.monotonic()`` in one process.

    Raises:
        ValueError: when ``config`` or ``start`` is out of range (at construction).
    """

    def __init__(self, config: GovernorConfig, start: np.ndarray) -> None:
        """Begins to wait.

        Args:
            config: The config.
            start: (3,) [m, m, rad] pose of the path where a session begins.
        """
        config.validate()
        check_array("start", start, (POSE_SIZE,))
        self._config, self._start = config, np.array(start, dtype=float)
        if not self._allows(self._start):
            raise ValueError(f"start: must be within allowed_area, got {self._start.tolist()}")
        self._phase, self._reason = Phase.WAITING, ""
        self._track: OdometryTrack | None = None
        self._rejected, self._rejection = 0, ""
        self._drive = _Drive()
        self._sessions = {0}  # That cannot begin any more.
        self._sent = STILL

    @property
    def phase(self) -> Phase:
        """What it is doing."""
        return self._phase

    def on_odometry(self, odometry: Odometry, now: float) -> None:
        """Hears the robot."""
        self._check_times(now)
        # The arrival that the link says is not trusted, it decides how old odometry counts.
        odometry = dc.replace(odometry, arrival=now)
        track, rejection = check(self._track, odometry, self._config.odometry)
        if track is None or rejection is not None:
            self._rejected, self._rejection = self._rejected + 1, f", rejected: {rejection}"
            return
        self._track, self._rejection = track, ""
        same_since = max(track.unchanged_since, self._drive.pushed_since)
        self._require("odometry is frozen", now - same_since, self._config.max_frozen_time, "s")
        place = to_path_frame(track.last.pose, self._drive.frame)
        if self._phase is Phase.DRIVING and not self._allows(place):
            x_min, y_min, x_max, y_max = self._config.allowed_area
            self.stop(
                f"outside the allowed area: x {place[0]:.2f} m, y {place[1]:.2f} m "
                f"(limits {x_min:g} to {x_max:g} m, {y_min:g} to {y_max:g} m)"
            )

    def on_drive_command(self, command: DriveCommand, now: float) -> None:
        """Hears a controller."""
        self._check_times(now)
        may_begin = self._phase in (Phase.WAITING, Phase.FINISHED)
        if may_begin and command.session not in self._sessions and self._odometry_is_good(now):
            self._begin(command, now)
        if self._phase is not Phase.DRIVING:
            return
        drive = self._drive
        if command.session != drive.session:
            self.stop(f"second controller: session {command.session} beside {drive.session}")
        elif command.sequence > drive.sequence:
            drive.sequence, drive.heartbeat = command.sequence, now
            if command.done:
                self._phase = Phase.FINISHED
            else:
                drive.wanted = command
                self._check_command(command, now)

    def on_foreign_command(self, command: WheelCommand, now: float) -> None:
        """Hears another sender on the wheel topics: fine are only zeros while nobody drives."""
        self._check_times(now)
        if self._phase is Phase.DRIVING or np.any(np.asarray(command.command) != 0):
            wheels = np.asarray(command.command).tolist()
            self.stop(f"another sender on the wheel topics: {wheels} pwm")

    def on_request(self, request: OperatorRequest, now: float) -> None:
        """Hears the operator."""
        self._check_times(now)
        if request.request is not Request.RESET:
            self.stop("the operator asked for it")
        elif self._phase is Phase.STOPPED and self._odometry_is_good(now):
            self._phase, self._reason, self._drive = Phase.WAITING, "", _Drive()

    def stop(self, reason: str) -> None:
        """Stops, unless it has already."""
        if self._phase is not Phase.STOPPED:
            self._phase, self._reason = Phase.STOPPED, reason

    def output(self, now: float) -> tuple[np.ndarray | None, GuardStatus]:
        """Returns what to send, and the status after it.

        Returns:
            (4,) [pwm] whole numbers, or None while the robot holds what it has; and the status.
            Zeros come again at every call, for a robot that was not there before.
        """
        self._check_times(now)
        self._drive.output_at = now
        command = self._next_command(now)
        if command is not None:
            self._sent = command
        return command, self._status(now)

    def _next_command(self, now: float) -> np.ndarray | None:
        drive, config = self._drive, self._config
        if self._phase is not Phase.DRIVING:
            return STILL
        if drive.wanted is None:
            return None
        step = config.slew_limit * min(now - drive.passed_at, config.slew_time)
        command = limit_command(drive.wanted.command, self._sent, step, config.command_limit)
        drive.passed, drive.passed_at, drive.wanted = drive.wanted.sequence, now, None
        pushes = push(command) >= config.breakaway
        drive.pushed_since = min(drive.pushed_since, now) if pushes else math.inf
        return command

    def _status(self, now: float) -> GuardStatus:
        return GuardStatus(
            session=self._drive.session,
            sequence=self._drive.passed,
            command=self._sent,
            stopped=self._phase is Phase.STOPPED,
            reason=self._reason,
            odometry_age=self._odometry_age(now),
            rejected=self._rejected,
        )

    def _begin(self, command: DriveCommand, now: float) -> None:
        assert self._track is not None
        self._phase = Phase.DRIVING
        self._sessions.add(command.session)
        self._drive = _Drive(
            session=command.session,
            frame=path_frame(self._track.last.pose, self._start),
            sequence=command.sequence - 1,
            output_at=now,
        )

    def _check_command(self, command: DriveCommand, now: float) -> None:
        """Stops at a command that cannot be followed, or that leads astray."""
        config, drive = self._config, self._drive
        try:
            check_array("command", command.command, (len(WHEELS),))
            check_array("reference", command.reference, (POSE_SIZE,))
            check_number("odometry_stamp", command.odometry_stamp, minimum=0, maximum=MAX_STAMP)
        except ValueError as problem:
            self.stop(f"not a command: {problem}")
            return
        drive.failures = drive.failures + 1 if command.solve_failed else 0
        if drive.failures >= config.max_solve_failures:
            self.stop(
                f"failed solves in a row: {drive.failures} ({config.max_solve_failures} stop)"
            )
        assert self._track is not None
        answers = abs(self._track.age(now, command.odometry_stamp))
        error = pose_error(self._track.last.pose, np.asarray(command.reference, dtype=float))
        distance, yaw = math.hypot(error[0], error[1]), abs(error[YAW])
        self._require("command answers old odometry", answers, config.max_odometry_age, "s")
        self._require("off the reference", distance, config.max_tracking_error[0], "m")
        self._require("yaw off the reference", yaw, config.max_tracking_error[1], "rad")

    def _check_times(self, now: float) -> None:
        """Stops a drive in which someone has been silent for too long."""
        config, drive = self._config, self._drive
        # A clock that steps back would make all that is old young.
        stall, silence = abs(now - drive.output_at), now - drive.heartbeat
        age = self._odometry_age(now)
        self._require("guard stalled", stall, config.max_stall, "s")
        self._require(f"odometry is old{self._rejection}", age, config.max_odometry_age, "s")
        self._require("controller is silent", silence, config.heartbeat_timeout, "s")

    def _require(self, what: str, value: float, limit: float, unit: str) -> None:
        """Stops a drive in which a value is not within its limit; one that is no number is not."""
        if self._phase is Phase.DRIVING and not value <= limit:
            self.stop(f"{what}: {value:.4g} {unit} (limit {limit:g} {unit})")

    def _odometry_age(self, now: float) -> float:
        return math.inf if self._track is None else self._track.age(now)

    def _odometry_is_good(self, now: float) -> bool:
        return self._odometry_age(now) <= self._config.max_odometry_age

    def _allows(self, place: np.ndarray) -> bool:
        x_min, y_min, x_max, y_max = self._config.allowed_area
        return bool(x_min <= place[0] <= x_max and y_min <= place[1] <= y_max)
