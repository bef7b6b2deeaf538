"""The same closed loop with each solver in turn."""

import dataclasses as dc
from collections.abc import Callable, Mapping

import numpy as np

from mirte_drake.angles import pose_error
from mirte_drake.benchmark.measure import collection_off
from mirte_drake.benchmark.problems import Sample, drive
from mirte_drake.control.nmpc_solver import NmpcSolver
from mirte_drake.scenario import Scenario


@dc.dataclass(frozen=True)
class ClosedLoop:
    """A run with one solver; one entry or row for each sample."""

    error: np.ndarray  # (K, 3) [m, m, rad] pose minus reference.
    solve_time: np.ndarray  # (K,) [s] as the controller states it.
    iterations: np.ndarray  # (K,)
    success: np.ndarray  # (K,) bool

    @property
    def rmse(self) -> np.ndarray:
        """Root mean square (3,) of the error [m, m, rad]."""
        return np.sqrt(np.mean(self.error**2, axis=0))


def run_closed_loops(
    scenario: Scenario,
    solvers: Mapping[str, NmpcSolver],
    on_sample: Callable[[], object] = lambda: None,
) -> dict[str, ClosedLoop]:
    """Runs a scenario with each solver, all with the same disturbance, sample by sample in turn.

    Args:
        scenario: What to run.
        solvers: By name; none may be used elsewhere meanwhile.
        on_sample: Called after each sample, for a progress bar.
    """
    samples: dict[str, list[Sample]] = {name: [] for name in solvers}
    with collection_off():
        runs = [drive(scenario, solver) for solver in solvers.values()]
        for row in zip(*runs, strict=True):
            for name, sample in zip(solvers, row, strict=True):
                samples[name].append(sample)
            on_sample()
    return {name: _evaluate(rows) for name, rows in samples.items()}


def _evaluate(samples: list[Sample]) -> ClosedLoop:
    plans = [sample.plan for sample in samples]
    return ClosedLoop(
        pose_error(
            np.array([sample.pose for sample in samples]),
            np.array([plan.data.reference[0] for plan in plans]),
        ),
        np.array([plan.solve_time for plan in plans]),
        np.array([plan.iterations for plan in plans]),
        np.array([not plan.status.failed for plan in plans]),
    )
