"""Whether a trial went as it must: checks of the wheel commands on the wire, and of the reason."""

import dataclasses as dc
from collections.abc import Sequence

import numpy as np

from mirte_drake.faults.oracle import Expectation
from mirte_drake.faults.record import Record
from mirte_drake.hardware.messages import WheelCommand
from mirte_drake.vectors import WHEELS

LIMIT = 100  # [pwm]
SLEW_LIMIT = 1000.0  # [pwm/s]
SLEW_TIME = 0.1  # [s] Longest time between two commands that counts for the slew.
JITTER = 0.01  # [s] Of arrivals: two commands may come closer together than they were sent.
BURST = 0.005  # [s] The wheels have topics of their own: one command comes in parts.
STILL_DRIVING = 0.25  # [s] Who drives has sent a command within this time.
DROVE_ON = "drove on"
FOREIGN_TIME = 0.1  # [s] A stranger's command is on the wire so soon after it was sent.


@dc.dataclass(frozen=True)
class Verdict:
    """What came of a trial."""

    due: bool  # Whether a stop was due.
    stop_time: float  # [s] From the instant that made it due to zeros on the wire; NaN: none.
    reason: str  # Why it stopped, in its own words; "drove on": it did not.
    problems: tuple[str, ...]  # What went wrong; empty: nothing.

    @property
    def passed(self) -> bool:
        """Whether all went as it must."""
        return not self.problems


def judge(
    record: Record, expected: Expectation, *, within: float, reasons: Sequence[str]
) -> Verdict:
    """Returns what came of a trial.

    Args:
        record: What it saw.
        expected: What must come of it.
        within: [s] Longest time to zeros on the wire, where a stop is due.
        reasons: Words of which the reason of a stop must have one.
    """
    problems = [*out_of_limits(record.commands), *too_fast(record)]
    zeros = zeros_from(record.commands)
    status = record.first_stop()
    reason = status.reason if status else (record.ended or "")
    stopped = np.isfinite(zeros) or status is not None or record.ended is not None
    if expected.due or (expected.allowed and stopped):
        problems += _stop_problems(record, zeros, reason, reasons)
        if zeros - expected.since > within:
            late = zeros - expected.since
            problems.append(f"zero on the wire {late:.3f} s after it was due (limit {within} s)")
    else:
        problems += _drive_problems(record, zeros, reason)
        reason = reason or DROVE_ON
    stop_time = zeros - expected.since if expected.due else np.nan
    return Verdict(expected.due, stop_time, reason, tuple(problems))


def zeros_from(commands: Sequence[WheelCommand]) -> float:
    """Returns since when [s] all commands have been zero; inf where the last one is not."""
    since = np.inf
    for command in reversed(commands):
        if np.any(command.command):
            break
        since = command.arrival
    return since


def out_of_limits(commands: Sequence[WheelCommand]) -> list[str]:
    """Returns what no command may be: beyond +-100, not finite, not a whole number."""
    values = np.array([command.command for command in commands]).reshape(-1, len(WHEELS))
    problems = []
    if not np.all(np.isfinite(values)):
        problems.append("a wheel command is not finite")
    elif np.any(values != np.rint(values)):
        problems.append("a wheel command is not a whole number")
    elif np.any(np.abs(values) > LIMIT):
        problems.append(f"a wheel command of {np.abs(values).max():.0f} pwm (limit {LIMIT} pwm)")
    return problems


def too_fast(record: Record) -> list[str]:
    """Returns changes of a wheel that are faster than the slew limit and not to zero."""
    last: WheelCommand | None = None
    commands = [c for c in record.commands if not _is_foreign(c, record.foreign)]
    for index, command in enumerate(commands):
        following = commands[index + 1].arrival if index + 1 < len(commands) else np.inf
        if following - command.arrival < BURST:
            continue  # Its other wheels are still to come.
        if last is not None:
            elapsed = min(command.arrival - last.arrival + JITTER, SLEW_TIME)
            change = np.abs(command.command - last.command)
            worst = np.max(np.where(command.command == 0, 0, change))
            if worst > SLEW_LIMIT * elapsed:
                return [f"a wheel changed by {worst:.0f} pwm in {elapsed:.3f} s"]
        last = command
    return []


def _is_foreign(command: WheelCommand, foreign: Sequence[WheelCommand]) -> bool:
    """Whether a command, or one wheel's part of it, is a stranger's."""
    return any(
        0 <= command.arrival - stranger.arrival < FOREIGN_TIME
        and bool(np.any(command.command == stranger.command))
        for stranger in foreign
    )


def _stop_problems(record: Record, zeros: float, reason: str, reasons: Sequence[str]) -> list[str]:
    """Returns what is wrong with a stop, but for its time."""
    problems = []
    if not np.isfinite(zeros):
        last = record.commands[-1].command.tolist() if record.commands else None
        problems.append(f"the wheels turn at the end: {last} pwm")
    if zeros < record.fault:
        problems.append("stopped before the fault")
    if not any(words in reason for words in reasons):
        problems.append(f"the reason is {reason!r}, not one with {' or '.join(reasons)}")
    return problems


def _drive_problems(record: Record, zeros: float, reason: str) -> list[str]:
    """Returns what keeps a drive from going on."""
    problems = []
    if not record.commands or record.end - record.commands[-1].arrival > STILL_DRIVING:
        problems.append("no wheel command at the end")
    if np.isfinite(zeros):
        problems.append("the wheels stand at the end")
    if reason:
        problems.append(f"stopped: {reason}")
    for who, alive in (("controller", record.controller_alive), ("guard", record.guard_alive)):
        if not alive:
            problems.append(f"the {who} has ended")
    return problems
