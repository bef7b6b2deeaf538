"""What one trial of the campaign saw on the wire."""

import dataclasses as dc

import numpy as np

from mirte_drake.hardware.messages import GuardStatus, Odometry, WheelCommand


@dc.dataclass(frozen=True)
class SentOdometry:
    """One message of the robot, as it went out."""

    message: Odometry  # As sent.
    measured: float  # [s] time.monotonic() when the robot was where it measured itself.
    sent: float  # [s] time.monotonic() when it went out.
    good: bool  # Whether it is one to be believed.
    altered: bool  # Whether the fault had to do with it.


@dc.dataclass
class Record:
    """What one trial saw; all times are of ``time.monotonic()``, which all processes share."""

    odometry: list[SentOdometry] = dc.field(default_factory=list)
    commands: list[WheelCommand] = dc.field(default_factory=list)  # As the robot received them.
    statuses: list[GuardStatus] = dc.field(default_factory=list)  # As an operator received them.
    # Wheel commands of the trial itself, a stranger's, with the times when they were sent.
    foreign: list[WheelCommand] = dc.field(default_factory=list)
    start: float = np.inf  # [s] when the first command that is not zero came.
    fault: float = np.inf  # [s] when the fault began.
    acted: list[float] = dc.field(default_factory=list)  # [s] when the controller was sabotaged.
    end: float = np.inf  # [s] when the observation ended.
    ended: str | None = None  # What the drive ended with; None: it goes on, or it died.
    controller_alive: bool = True  # At the end of the observation; stopped processes are.
    guard_alive: bool = True
    # [s] Longest that each process was ready to run and got no processor, within one look.
    starved: dict[str, float] = dc.field(default_factory=dict)

    def first_stop(self) -> GuardStatus | None:
        """Returns the first status that says that the guard has stopped the robot."""
        return next((status for status in self.statuses if status.stopped), None)

    def timeline(self) -> list[str]:
        """Returns what happened, one line each, times [s] after the fault or the start."""
        zero = self.fault if np.isfinite(self.fault) else self.start
        events = [(sent.sent, _odometry_text(sent)) for sent in self.odometry]
        events += [(c.arrival, f"wheel command {c.command.tolist()}") for c in self.commands]
        events += [(f.arrival, f"foreign command {f.command.tolist()}") for f in self.foreign]
        events += [(when, "sabotage") for when in self.acted]
        events += [(s.arrival, f"guard status {s.sequence} {s.reason}") for s in self.statuses]
        events += [(self.start, "the drive begins"), (self.fault, "the fault begins")]
        events += [(self.end, f"end; the drive ended: {self.ended}; starved: {self.starved}")]
        return [f"{when - zero:8.3f}  {text}" for when, text in sorted(events)]


def _odometry_text(sent: SentOdometry) -> str:
    age, pose = sent.sent - sent.measured, sent.message.pose.round(3).tolist()
    return f"odometry {pose}, {age:.3f} s old{'' if sent.good else ', bad'}"
