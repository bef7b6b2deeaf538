"""The solvers that are compared, by name."""

import importlib.util
from collections.abc import Iterable

from mirte_drake.benchmark.casadi_peer import CASADI_HINT, METHODS, CasadiNmpc
from mirte_drake.control.nmpc_solver import SOLVERS, NmpcSolver, make_nmpc_solver
from mirte_drake.control.tracking_problem import TrackingProblem
from mirte_drake.errors import UserError

SOLVER_NAMES = (*SOLVERS, *METHODS)
BASELINE = "casadi_ipopt"  # What the others' speed is stated against.

# Of those that find the optimum, the fastest first: they plan the ideal runs.
_DRIVERS = ("converged", "casadi_sqp_hpipm", *SOLVERS)

# A tolerance that is reached on these problems, and far below every solver's own gap.
TIGHT_TOLERANCE = 1e-12


def has_casadi() -> bool:
    """Whether CasADi is installed; it is optional."""
    return importlib.util.find_spec("casadi") is not None


def available_solvers() -> tuple[str, ...]:
    """Returns the solvers that this installation has."""
    return SOLVER_NAMES if has_casadi() else SOLVERS


def check_solvers(names: Iterable[str]) -> tuple[str, ...]:
    """Returns names of solvers, each once.

    Raises:
        UserError: for a name that is not known, or a package that is missing.
    """
    names = tuple(dict.fromkeys(names))
    for name in names:
        if name not in SOLVER_NAMES:
            known = ", ".join(SOLVER_NAMES)
            raise UserError(f"solver {name!r} is not known: use some of {known}")
        if name not in available_solvers():
            raise UserError(f"solver {name!r} {CASADI_HINT}")
    return names


def make_solver(problem: TrackingProblem, name: str) -> NmpcSolver:
    """Returns a solver with its own default tolerance.

    Args:
        problem: What it solves.
        name: One of ``SOLVER_NAMES``.

    Raises:
        UserError: when its package is missing.
        ValueError: for an unknown name.
    """
    if name in METHODS:
        return CasadiNmpc(problem, name)
    return make_nmpc_solver(problem, name)


def make_driver(problem: TrackingProblem) -> NmpcSolver:
    """Returns the fastest solver there is that finds the optimum."""
    name = next(name for name in _DRIVERS if name in available_solvers())
    return make_solver(problem, name)


def make_reference_solver(problem: TrackingProblem) -> NmpcSolver | None:
    """Returns a solver that finds the optimum to ``TIGHT_TOLERANCE``; None without CasADi."""
    if not has_casadi():
        return None
    return CasadiNmpc(problem, "casadi_ipopt", tolerance=TIGHT_TOLERANCE)
