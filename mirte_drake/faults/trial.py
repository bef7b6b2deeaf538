"""One trial of the campaign: a drive, a fault, and what comes of it."""

import dataclasses as dc
import time
import zlib

import numpy as np

from mirte_drake.drive import few_pauses
from mirte_drake.errors import UserError
from mirte_drake.faults.bench import Bench
from mirte_drake.faults.evaluation import Verdict, judge
from mirte_drake.faults.free_wire import FREE_WIRES
from mirte_drake.faults.kind import Kind
from mirte_drake.faults.kinds import SCENARIO, find_kind
from mirte_drake.faults.record import Record
from mirte_drake.robots.names import robot_override
from mirte_drake.scenario import Scenario
from mirte_drake.scenario_file import load_scenario

PATIENCE = 10.0  # [s] For the drive to begin.


@dc.dataclass(frozen=True)
class Trial:
    """One trial: what, where and with which seed."""

    kind: str
    transport: str  # "ros2" or "lcm"
    seed: int
    run: int
    number: int  # Of the trial in its campaign: it gets a wire of its own.

    @property
    def own_guard(self) -> bool:
        """Whether the controller starts the guard; it does in every other run."""
        return self.run % 2 == 0


@dc.dataclass(frozen=True)
class Outcome:
    """What came of a trial."""

    trial: Trial
    verdict: Verdict
    fault: float = np.nan  # [s] after the drive began.
    starved: float = np.nan  # [s] Longest that one of the processes got no processor.
    pause: float = np.nan  # [s] Longest that who looks on, who is the robot too, was held up.
    timeline: tuple[str, ...] = ()  # Of a trial that failed.


def run_trial(trial: Trial, kind: Kind | None = None) -> Outcome:
    """Runs a trial in real time; a failure of the trial itself is one of its problems.

    Args:
        trial: The trial.
        kind: What is done and what must come of it; None: the kind that the trial names.
    """
    kind = kind or find_kind(trial.kind)
    try:
        record = _run(trial, kind)
    except Exception as error:  # Of whatever kind: the campaign goes on.
        return Outcome(trial, Verdict(False, np.nan, "", (f"the trial failed: {error!r}",)))
    verdict = judge(record, kind.oracle(record), within=kind.within, reasons=kind.reasons)
    problems = verdict.problems
    if not np.isfinite(record.fault):
        problems = (f"the drive did not begin ({record.ended})",)
    elif not kind.took_place(record):
        problems = (*problems, "the fault did not take place")
    verdict = dc.replace(verdict, problems=problems)
    starved = max(record.starved.values(), default=np.nan)
    timeline = () if verdict.passed else tuple(record.timeline())
    return Outcome(trial, verdict, record.fault - record.start, starved, record.pause, timeline)


def _run(trial: Trial, kind: Kind) -> Record:
    # A fault is the same in each trial of a kind and seed, whatever else runs.
    rng = np.random.default_rng([trial.seed, trial.run, zlib.crc32(kind.name.encode())])
    scenario, robot = scenarios(trial, kind)
    guard = {"own_guard": trial.own_guard and not kind.deafens, "deafens": kind.deafens}
    with (
        few_pauses(),
        Bench(scenario, robot, kind.sabotage, kind.strangers, rng, **guard) as bench,
    ):
        return observe(bench, kind, rng)


def scenarios(trial: Trial, kind: Kind) -> tuple[Scenario, Scenario]:
    """Returns what is driven, on a wire that nobody else is on, and whose robot is there."""
    if trial.transport not in FREE_WIRES:
        raise UserError(
            f"transport: must be one of {', '.join(FREE_WIRES)}, got {trial.transport!r}"
        )
    wire = FREE_WIRES[trial.transport](trial.number)
    seed = f"seed={trial.run}"
    driven = (robot_override(trial.transport), wire, seed, *kind.overrides)
    return load_scenario(SCENARIO, driven), load_scenario(SCENARIO, [seed])


def observe(bench: Bench, kind: Kind, rng: np.random.Generator) -> Record:
    """Drives, lets the fault in, and returns what was seen."""
    if kind.from_start:
        bench.robot.fault = kind.odometry
    if not bench.begin(PATIENCE):
        return bench.finish()
    bench.run(bench.record.start + rng.uniform(*kind.begin))
    bench.record.fault = fault = time.monotonic()
    bench.robot.fault = kind.odometry
    if kind.sabotage is not None:
        bench.orders.begin()
    for step in sorted(kind.steps, key=lambda step: step.after):
        bench.run(fault + step.after)
        step.act(bench)
    bench.run(fault + kind.observe)
    return bench.finish()
