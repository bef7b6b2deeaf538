"""What can go wrong inside the controller: a solver that fails on order."""

import dataclasses as dc
import time
from collections.abc import Callable
from functools import partial
from multiprocessing.context import BaseContext

import numpy as np

from mirte_drake.control.nmpc_solution import NmpcSolution
from mirte_drake.control.nmpc_solver import NmpcSolver
from mirte_drake.control.tracking_problem import TrackingData

MOST = 200  # Acts of sabotage that are noted.
FOREVER = 60.0  # [s] Longer than any trial.

Act = Callable[[NmpcSolver, TrackingData, np.ndarray], NmpcSolution]


@dc.dataclass(frozen=True)
class Sabotage:
    """What the solver does instead, and in how many solves."""

    act: Act
    times: int = MOST


class Orders:
    """Memory that the processes of a trial share: what is to go wrong, and when it did."""

    def __init__(self, context: BaseContext) -> None:
        """Begins with no order.

        Args:
            context: Of the processes.
        """
        self._begin = context.RawValue("d", np.inf)
        self._acted = context.RawArray("d", MOST)
        self._count = context.RawValue("i", 0)
        self._deaf = context.RawValue("b", 0)

    @property
    def deaf(self) -> bool:
        """Whether the guard is to hear no controller."""
        return bool(self._deaf.value)

    def deafen(self) -> None:
        """Orders that the guard hears no controller from now on."""
        self._deaf.value = 1

    def begin(self) -> None:
        """Orders the sabotage of the controller from the next solve on."""
        self._begin.value = time.monotonic()

    def due(self, times: int) -> bool:
        """Whether a solve is to be sabotaged, at most ``times`` in all."""
        return time.monotonic() >= self._begin.value and self._count.value < min(times, MOST)

    def note(self) -> None:
        """Notes that it happens now."""
        self._acted[self._count.value] = time.monotonic()
        self._count.value += 1

    def acted(self) -> list[float]:
        """Returns when it happened [s], ``time.monotonic()``."""
        return list(self._acted[: self._count.value])


class Saboteur:
    """A solver that works, until it is told not to."""

    def __init__(self, solver: NmpcSolver, sabotage: Sabotage, orders: Orders) -> None:
        """Wraps a solver."""
        self._solver, self._sabotage, self._orders = solver, sabotage, orders

    def solve(self, data: TrackingData, guess: np.ndarray) -> NmpcSolution:
        """Solves, or does as ordered."""
        if not self._orders.due(self._sabotage.times):
            return self._solver.solve(data, guess)
        self._orders.note()
        return self._sabotage.act(self._solver, data, guess)

    def prepare(self, guess: np.ndarray) -> None:
        """Prepares."""
        self._solver.prepare(guess)


def fail(solver: NmpcSolver, data: TrackingData, guess: np.ndarray) -> NmpcSolution:
    """Fails, and says so."""
    return dc.replace(solver.solve(data, guess), success=False, message="sabotaged")


def give_nan(solver: NmpcSolver, data: TrackingData, guess: np.ndarray) -> NmpcSolution:
    """Gives inputs that are no numbers, and takes them for a success."""
    solution = solver.solve(data, guess)
    return dc.replace(solution, inputs=np.full_like(solution.inputs, np.nan))


def throw(solver: NmpcSolver, data: TrackingData, guess: np.ndarray) -> NmpcSolution:
    """Raises an exception that nobody expects."""
    raise RuntimeError("sabotaged")


def hang(solver: NmpcSolver, data: TrackingData, guess: np.ndarray) -> NmpcSolution:
    """Never comes to an end."""
    time.sleep(FOREVER)
    return solver.solve(data, guess)


def take(duration: float) -> Act:
    """Returns an act: a solve takes ``duration`` [s] longer."""
    return partial(_slowly, duration)  # Unlike a closure, it can be sent to a process.


def _slowly(
    duration: float, solver: NmpcSolver, data: TrackingData, guess: np.ndarray
) -> NmpcSolution:
    time.sleep(duration)
    return solver.solve(data, guess)
