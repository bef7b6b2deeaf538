"""SINDYc: from a recording to a sparse model (chapter 3)."""

import dataclasses as dc

import numpy as np

from mirte_drake.errors import UserError
from mirte_drake.identification.differentiation import TvrConfig, tvr_derivative
from mirte_drake.identification.model_structure import (
    BODY_VELOCITIES,
    INPUTS,
    ModelStructure,
    model_structure,
)
from mirte_drake.identification.recorded_run import RecordedRun
from mirte_drake.identification.sparse_regression import (
    StlsqConfig,
    ThresholdRow,
    best_threshold,
    stlsq,
    threshold_table,
)
from mirte_drake.model.candidate_library import HEADING, CandidateLibrary, parse_term
from mirte_drake.model.model_file import Identification, ModelFile
from mirte_drake.vectors import YAW

# What a search over thresholds tries.
THRESHOLD_GRID = np.geomspace(1e-6, 1e-3, 13)


@dc.dataclass(frozen=True)
class Regression:
    """The regression problems of one model on one recording, a state derivative each."""

    structure: ModelStructure
    terms: dict[str, np.ndarray]  # (N, L) candidate terms.
    derivatives: dict[str, np.ndarray]  # (N,) left-hand side.


def regression_problem(
    run: RecordedRun, kind: str, mode: str = "converged", tvr: TvrConfig | None = None
) -> Regression:
    """Returns candidate terms and derivatives of a recording.

    Args:
        run: The recording.
        kind: Kind of model, see ``model_structure``.
        mode: Of the differentiation, see ``tvr_derivative``.
        tvr: Settings of the differentiation.

    Raises:
        UserError: when a state does not move, or a candidate term does not occur.
        ValueError: for an unknown kind or mode.
    """
    structure = model_structure(kind)
    variables = (HEADING, *BODY_VELOCITIES, *INPUTS)
    yaw, velocity, command = run.pose[:, YAW], run.body_velocity, run.wheel_command
    derivative = run.pose
    for _ in range(structure.order):
        derivative = tvr_derivative(derivative, run.period, mode, tvr)
    if mode != "published":
        # Deviation: the input of row k is held until row k + 1, and the measured velocity is the
        # mean over the sample before its row. So means over a sample belong together, not values
        # at its start, where the input jumps.
        derivative, yaw = (0.5 * (column[1:] + column[:-1]) for column in (derivative, yaw))
        velocity, command = velocity[1:], command[:-1]
    values = np.column_stack([yaw, velocity, command])
    terms = {
        state: CandidateLibrary(variables, [parse_term(t, variables) for t in names]).evaluate(
            values
        )
        for state, names in structure.candidates.items()
    }
    columns = dict(zip(structure.candidates, derivative.T, strict=True))
    for state, names in structure.candidates.items():
        if not np.any(columns[state]):
            raise UserError(f"{run.source}: {state} does not move; record more motion")
        seen = np.any(terms[state], axis=0)
        unseen = [name for name, is_seen in zip(names, seen, strict=True) if not is_seen]
        if unseen:
            raise UserError(
                f"{run.source}: {', '.join(unseen)} is zero in all samples; record more motion"
            )
    return Regression(structure, terms, columns)


def identify(
    run: RecordedRun,
    kind: str,
    mode: str = "converged",
    *,
    thresholds: dict[str, float] | None = None,
    tvr: TvrConfig | None = None,
    regression: StlsqConfig | None = None,
    date: str = "",
) -> ModelFile:
    """Returns the model of a recording.

    Args:
        run: The recording.
        kind: Kind of model.
        mode: "converged" or "published".
        thresholds: lambda per identified state derivative; else the published ones.
        tvr: Settings of the differentiation.
        regression: Settings of STLSQ.
        date: ISO date for the file.

    Raises:
        UserError: when a candidate term does not occur in the recording, or no term is left.
        ValueError: for an unknown kind or mode.
    """
    problem = regression_problem(run, kind, mode, tvr)
    structure = problem.structure
    thresholds = thresholds or structure.thresholds
    derivatives, scores = dict(structure.known), {}
    for state, names in structure.candidates.items():
        Theta, y = problem.terms[state], problem.derivatives[state]
        xi = stlsq(Theta, y, thresholds[state], regression)
        table = {name: float(c) for name, c in zip(names, xi, strict=True) if c != 0.0}
        if not table:
            raise UserError(
                f"{run.source}: {state}: the threshold {thresholds[state]:g} leaves no term; "
                "lower it"
            )
        derivatives[state] = table
        scores[f"{state}_derivative_rmse"] = float(np.sqrt(np.mean((y - Theta @ xi) ** 2)))
    return ModelFile(
        name=kind,
        states=structure.states,
        inputs=dict.fromkeys(INPUTS, "pwm_percent"),
        auxiliaries=structure.auxiliaries,
        derivatives=derivatives,
        identification=Identification(
            source=f"identified from {run.source}, {len(run.time)} samples",
            data_sha256=run.sha256,
            date=date,
            settings={
                "differentiation": f"total variation regularised, {mode}, "
                + _settings(tvr or TvrConfig()),
                "regression": "STLSQ, " + _settings(regression or StlsqConfig()),
                "thresholds": ", ".join(f"{s} {thresholds[s]:g}" for s in structure.candidates),
            },
        ),
        training_scores=scores,
    )


def search_thresholds(
    run: RecordedRun,
    kind: str,
    mode: str = "converged",
    criterion: str = "held_out",
    grid: np.ndarray = THRESHOLD_GRID,
) -> tuple[dict[str, float], dict[str, list[ThresholdRow]]]:
    """Returns the thresholds of least error, and the error tables (section 3-3).

    Deviation: the thesis takes the least error on the samples fitted, which favours many terms;
    ``criterion="training"`` does so, the default looks at samples that were not fitted.

    Args:
        run: The recording.
        kind: Kind of model.
        mode: Of the differentiation.
        criterion: See ``best_threshold``.
        grid: Thresholds to try.
    """
    problem = regression_problem(run, kind, mode)
    try:
        tables = {
            state: threshold_table(problem.terms[state], problem.derivatives[state], grid)
            for state in problem.structure.candidates
        }
    except ValueError as error:  # A term that occurs in the held-out part alone.
        raise UserError(f"{run.source}: {error} fitted; record more motion") from None
    best = {state: best_threshold(rows, criterion).threshold for state, rows in tables.items()}
    return best, tables


def _settings(config: object) -> str:
    assert dc.is_dataclass(config)
    return ", ".join(f"{f.name} {getattr(config, f.name):g}" for f in dc.fields(config))
