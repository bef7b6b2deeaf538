"""The problems that a controller meets: those of a simulated run, and of an ideal one."""

import dataclasses as dc
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from mirte_drake.assembly import MakeDiagram
from mirte_drake.control.nmpc_solver import NmpcSolver
from mirte_drake.control.plan import Plan, idle_plan, next_plan, warm_start
from mirte_drake.control.reference_paths import window
from mirte_drake.control.tracking_problem import TrackingData, TrackingProblem
from mirte_drake.run import samples
from mirte_drake.scenario import Scenario, load_planning_model
from mirte_drake.systems.nominal_nmpc import NominalNmpc, make_tracking_problem
from mirte_drake.vectors import POSE

BLOCK = 25  # Samples that a solver is timed on in one turn, at most.
LEAD = 5  # Samples before them: by then solve times have settled.


@dc.dataclass(frozen=True)
class Sample:
    """One sample of a closed loop: the problem as the controller had it, and its answer."""

    data: TrackingData
    guess: np.ndarray  # (size,) the plan of the sample before, moved on.
    plan: Plan
    pose: np.ndarray  # (3,) [m, m, rad] measured.


class Block(NamedTuple):
    """Consecutive samples of a run, to be solved in order."""

    lead: Sequence[Sample]  # Solved untimed: they fill caches, and multipliers that solvers keep.
    timed: Sequence[Sample]


def tracking_problem(scenario: Scenario) -> TrackingProblem:
    """Returns the problem that a scenario's controller solves."""
    model = load_planning_model(scenario)
    return make_tracking_problem(scenario.nominal_nmpc, model, scenario.period)


def drive(scenario: Scenario, solver: NmpcSolver | None = None) -> Iterator[Sample]:
    """Yields the samples of a scenario's closed loop.

    Args:
        scenario: What to run.
        solver: Solves the nominal controller's problem instead of the scenario's solver.
    """
    diagram = MakeDiagram(scenario)
    nmpc = diagram.GetSubsystemByName("controller").GetSubsystemByName("nominal_nmpc")
    assert isinstance(nmpc, NominalNmpc)
    if solver is not None:
        nmpc.use_solver(solver)
    previous = idle_plan(nmpc.problem)
    for context, _ in samples(diagram, scenario):
        plan, pose = (diagram.GetOutputPort(port).Eval(context) for port in ("plan", "pose"))
        guess = warm_start(nmpc.problem, previous, plan.data.state)
        yield Sample(plan.data, guess, plan, pose)
        previous = plan


def drive_ideally(
    problem: TrackingProblem,
    solver: NmpcSolver,
    typical: TrackingData,
    poses: np.ndarray,
    count: int,
    seed: int = 0,
) -> Iterator[Sample]:
    """Yields samples of a robot that moves as predicted, up to errors that fill the tube.

    This needs no ancillary law and no robot, so it serves any horizon and any model.

    Args:
        problem: Any model and any horizon.
        solver: Plans the motion.
        typical: Of a run: the tube's half widths and the bounds of its first stage are used for
            all samples and stages. States beside the pose are known exactly.
        poses: (K, 3) reference; past its end it stands still.
        count: Number of samples.
        seed: Of the errors.
    """
    rng = np.random.default_rng(seed)
    n, N = problem.model.num_states, problem.horizon
    half_width = np.zeros(n)
    half_width[POSE] = typical.half_width[POSE]
    lower, upper = (np.tile(b[0], (N, 1)) for b in (typical.input_lower, typical.input_upper))
    previous = idle_plan(problem)
    state = np.zeros(n)
    state[POSE] = poses[0]
    for k in range(count):
        last = previous.nominal_input
        data = TrackingData(
            state,
            window(poses, k, N + 1),
            half_width,
            lower,
            upper,
            last,
        )
        guess = warm_start(problem, previous, state)
        plan = next_plan(problem, previous, data, solver.solve(data, guess), last)
        yield Sample(data, guess, plan, state[POSE])
        state = plan.nominal_next + half_width * rng.uniform(-1.0, 1.0, n)
        previous = plan


def choose_blocks(samples: Sequence[Sample], count: int) -> list[Block]:
    """Returns up to ``count`` samples of a run in blocks spread evenly over it.

    Args:
        samples: The run; at least one. Those at its beginning are no more than a lead.
        count: Of samples to time, each once.
    """
    lead = min(LEAD, len(samples) - 1)
    count = min(count, len(samples) - lead)
    blocks = np.array_split(np.arange(lead, lead + count), math.ceil(count / BLOCK))
    gaps = np.linspace(0, len(samples) - lead - count, len(blocks)).astype(int)
    starts = [int(block[0] + gap) for block, gap in zip(blocks, gaps, strict=True)]
    return [
        Block(samples[start - lead : start], samples[start : start + len(block)])
        for start, block in zip(starts, blocks, strict=True)
    ]
