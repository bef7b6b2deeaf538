"""Many trials of every kind, several at a time, and the table of what came of them."""

import csv
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import numpy as np

from mirte_drake.faults.kinds import KINDS
from mirte_drake.faults.processes import be_quiet, fork_server
from mirte_drake.faults.trial import Outcome, Trial, run_trial
from mirte_drake.files import replacing
from mirte_drake.run_summary import versions

# Trials that a process serves: its robots' Diagrams are never freed.
BATCH = 25
COLUMNS = (
    *("kind", "transport", "seed", "run"),
    *("passed", "stop_due", "stop_time_s"),
    *("reason", "problems"),
    *("fault_s", "starved_s", "pause_s"),
)


def trials(
    kinds: Iterable[str], transport: str, runs: int, seed: int, first: int = 0
) -> list[Trial]:
    """Returns every kind ``runs`` times, kinds taking turns; they are numbered from ``first`` on.

    Campaigns that run at the same time must begin at different numbers, or their trials meet.
    """
    pairs = [(run, kind) for run in range(runs) for kind in kinds]
    return [Trial(kind, transport, seed, run, first + n) for n, (run, kind) in enumerate(pairs)]


def run_campaign(
    todo: Sequence[Trial], *, jobs: int = 2, on_trial: Callable[[], object] = lambda: None
) -> list[Outcome]:
    """Runs trials, ``jobs`` at a time, and returns what came of them, in their order.

    Args:
        todo: The trials.
        jobs: So many run at once, each on a wire of its own.
        on_trial: Called after each, for a progress bar.
    """
    outcomes = []
    for batch in (todo[i : i + jobs * BATCH] for i in range(0, len(todo), jobs * BATCH)):
        # New processes for every batch: the pool of Python 3.11 hangs when it replaces its own.
        with ProcessPoolExecutor(jobs, mp_context=fork_server(), initializer=be_quiet) as pool:
            for future in as_completed([pool.submit(run_trial, trial) for trial in batch]):
                outcomes.append(future.result())
                on_trial()
    return sorted(outcomes, key=lambda outcome: outcome.trial.number)


def report(outcomes: Sequence[Outcome]) -> dict[str, object]:
    """Returns what came of every kind, for a JSON file and ``report_text``."""
    kinds = dict.fromkeys(outcome.trial.kind for outcome in outcomes)
    rows = [_row(kind, [o for o in outcomes if o.trial.kind == kind]) for kind in kinds]
    return {"transport": outcomes[0].trial.transport, "kinds": rows, "versions": versions()}


def _row(kind: str, outcomes: Sequence[Outcome]) -> dict[str, object]:
    verdicts = [outcome.verdict for outcome in outcomes]
    times = [verdict.stop_time for verdict in verdicts if verdict.due]
    reasons = Counter(_short(verdict.reason) for verdict in verdicts)
    return {
        "kind": kind,
        "due": KINDS[kind].outcome,
        "runs": len(verdicts),
        "passed": sum(verdict.passed for verdict in verdicts),
        "stops_due": len(times),
        "stop_time_s": {
            "p50": float(np.median(times)) if times else None,
            "max": float(np.max(times)) if times else None,
            "limit": KINDS[kind].within,
        },
        "reasons": dict(reasons.most_common()),
        "problems": dict(Counter(p for verdict in verdicts for p in verdict.problems)),
    }


def _short(reason: str) -> str:
    """Returns a reason without its numbers, so that equal ones can be counted."""
    words = reason.partition(":")[0].partition(",")[0].split(" for ")[0]
    return words or "no reason"


def report_text(summary: dict) -> str:
    """Returns the table."""
    lines = [
        f"Faults over {summary['transport']}: time from what makes a stop due to zero on the wire",
        f"{'kind':30}{'runs':>5}{'passed':>7}{'due':>5}{'p50':>8}{'max':>8}{'limit':>7}  reasons",
        f"{'':30}{'':>5}{'':>7}{'':>5}{'ms':>8}{'ms':>8}{'ms':>7}",
    ]
    for row in summary["kinds"]:
        times = row["stop_time_s"]
        p50, most, limit = (
            "-" if times["p50"] is None else f"{1e3 * times[key]:.0f}"
            for key in ("p50", "max", "limit")
        )
        reasons = ", ".join(f"{reason} {count}" for reason, count in row["reasons"].items())
        lines.append(
            f"{row['kind']:30}{row['runs']:5}{row['passed']:7}{row['stops_due']:5}"
            f"{p50:>8}{most:>8}{limit:>7}  {reasons}"
        )
        lines += [f"{'':30}  {count} x {what}" for what, count in row["problems"].items()]
    runs, passed = (sum(row[key] for row in summary["kinds"]) for key in ("runs", "passed"))
    lines.append(f"{len(summary['kinds'])} kinds, {runs} trials, {passed} passed")
    return "\n".join(lines)


def kinds_text() -> str:
    """Returns the table of kinds with what is due beforehand."""
    return "\n".join(f"{name:30}{kind.outcome}" for name, kind in KINDS.items())


def save_trials(outcomes: Sequence[Outcome], path: Path) -> None:
    """Writes every trial as a line of a CSV file, complete or not at all.

    Raises:
        UserError: when the file cannot be written.
    """
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for outcome in outcomes:
            trial, verdict = outcome.trial, outcome.verdict
            row = (
                *(trial.kind, trial.transport, trial.seed, trial.run),
                *(verdict.passed, verdict.due, verdict.stop_time),
                *(verdict.reason, "; ".join(verdict.problems)),
                *(outcome.fault, outcome.starved, outcome.pause),
            )
            writer.writerow(row)


def save_failures(outcomes: Sequence[Outcome], path: Path) -> None:
    """Writes what happened in the trials that failed, complete or not at all.

    Raises:
        UserError: when the file cannot be written.
    """
    lines = []
    for outcome in outcomes:
        if not outcome.verdict.passed:
            trial = outcome.trial
            lines += [f"{trial.kind}, run {trial.run}: {'; '.join(outcome.verdict.problems)}"]
            lines += [*outcome.timeline, ""]
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines), encoding="utf-8")
