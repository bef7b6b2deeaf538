"""The solvers that are compared, by name."""

import importlib.util
from collections.abc import Iterable

from mirte_drake.benchmark.casadi_peer import CASADI_HINT, METHODS, CasadiNmpc
from mirte_drake.control.nmpc_solver import SOLVERS, NmpcSolver, make_nmpc_solver
from mirte_drake.control.tracking_problem import TrackingProblem
from mirte_drake.errors import UserError
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.model.sparse_model import SparseModel

SOLVER_NAMES = (*SOLVERS, *METHODS)
BASELINE = "casadi_ipopt"  # What the others' speed is stated against.

# Of those that find the optimum, the fastest first: they plan the ideal runs.
_DRIVERS = ("converged", "casadi_sqp_hpipm", *SOLVERS)

# A tolerance that is reached on these problems, and far below every solver's own gap.
TIGHT_TOLERANCE = 1e-12


def has_casadi() -> bool:
    """Whether CasADi is installed; it is optional."""
    return importlib.util.find_spec("casadi") is not None


def available_solvers(model: PredictionModel | None = None) -> tuple[str, ...]:
    """Returns the solvers that this installation has, and, where one is given, a model can use."""
    usable = has_casadi() and (model is None or isinstance(model, SparseModel))
    return SOLVER_NAMES if usable else SOLVERS


def check_solvers(names: Iterable[str], model: PredictionModel | None = None) -> tuple[str, ...]:
    """Returns names of solvers, each once.

    Raises:
        UserError: for a name that is not known, a package that is missing, or a model that the
            solver cannot have.
    """
    names = tuple(dict.fromkeys(names))
    for name in names:
        if name not in SOLVER_NAMES:
            known = ", ".join(SOLVER_NAMES)
            raise UserError(f"solver {name!r} is not known: use some of {known}")
        if name not in available_solvers():
            raise UserError(f"solver {name!r} {CASADI_HINT}")
        if name not in available_solvers(model):
            assert model is not None
            known = ", ".join(available_solvers(model))
            raise UserError(f"solver {name!r} cannot have the model {model.name!r}: use {known}")
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
    name = next(name for name in _DRIVERS if name in available_solvers(problem.model))
    return make_solver(problem, name)


def make_reference_solver(problem: TrackingProblem) -> NmpcSolver | None:
    """Returns a solver that finds the optimum to ``TIGHT_TOLERANCE``.

    None without CasADi, or with a model that it cannot have.
    """
    if BASELINE not in available_solvers(problem.model):
        return None
    return CasadiNmpc(problem, "casadi_ipopt", tolerance=TIGHT_TOLERANCE)
