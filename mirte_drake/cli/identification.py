"""Commands that go from a recording to a model and a disturbance set."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mirte_drake.cli.options import commands, file_option, output_option
from mirte_drake.cli.recording import data_option, load_recording
from mirte_drake.errors import UserError
from mirte_drake.identification.model_structure import KINDS

if TYPE_CHECKING:
    from mirte_drake.identification.recorded_run import RecordedRun

LAGGED = "lagged"


@commands.command()
@data_option
@click.option("--model", "kind", type=click.Choice((*KINDS, LAGGED)), default="extended_kinematic")
@click.option(
    "--mode",
    type=click.Choice(("converged", "published")),
    default="converged",
    show_default=True,
    help="Differentiation: to the minimum, or as far as the published programs went.",
)
@click.option(
    "--thresholds",
    metavar="X,Y,THETA",
    help="Smallest coefficients that are kept; else the published ones.",
)
@click.option(
    "--search",
    type=click.Choice(("held_out", "training")),
    help="Searches the thresholds of least error, on samples not fitted or fitted, and prints the "
    "error table.",
)
@click.option("--latex", is_flag=True, help="Prints the equations as LaTeX.")
@click.option(
    "--figures",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder to write figures of the recording and its derivative to.",
)
@file_option("Model file to write.", "runs/MODEL.yaml")
def identify(
    data: Path | None,
    kind: str,
    mode: str,
    thresholds: str | None,
    search: str | None,
    latex: bool,
    figures: Path | None,
    output: Path | None,
) -> None:
    """Identifies a model from a recording, prints its equations and writes it as YAML.

    By SINDYc; "lagged" by the error of open-loop simulation, and prints how it was chosen.
    """
    from mirte_drake.identification.fit_sindyc import identify as fit
    from mirte_drake.identification.fit_sindyc import search_thresholds
    from mirte_drake.identification.reports import threshold_text
    from mirte_drake.model.equations import equations_latex, equations_text
    from mirte_drake.model.model_file import save_model_file

    output = output or Path("runs") / f"{kind}.yaml"
    if kind == LAGGED:
        given = {"--thresholds": thresholds, "--search": search, "--latex": latex}
        if wrong := [option for option, value in given.items() if value]:
            raise UserError(f"{wrong[0]}: is for models of terms; leave it out for {LAGGED}")
        _identify_lagged(data, figures, output)
        return
    run = load_recording(data)
    chosen = _parse_thresholds(thresholds, kind) if thresholds else None
    if search:
        if thresholds:
            raise UserError("--search: finds the thresholds itself; leave --thresholds out")
        chosen, tables = search_thresholds(run, kind, mode, search)
        click.echo(threshold_text(chosen, tables))
    model = fit(run, kind, mode, thresholds=chosen, date=date.today().isoformat())
    save_model_file(model, output)
    if figures:
        _save_training_figures(run, mode, figures)
    click.echo(equations_latex(model) if latex else equations_text(model))
    for name, score in model.training_scores.items():
        click.echo(f"{name.replace('_', ' ')}: {score:.4f}", err=True)
    click.echo(f"Written to {output}", err=True)  # The equations alone go to standard output.


def _identify_lagged(data: Path | None, figures: Path | None, output: Path) -> None:
    from mirte_drake.identification.fit_lagged import (
        fit_lagged,
        fit_steps,
        lagged_model_file,
    )
    from mirte_drake.identification.held_out import held_out_text
    from mirte_drake.model.equations import equations_text
    from mirte_drake.model.model_file import save_model_file

    run = load_recording(data)
    with click.progressbar(length=fit_steps(), label="fit", file=sys.stderr) as bar:
        fit = fit_lagged(run, on_step=lambda: bar.update(1))
    model = lagged_model_file(fit, run, date=date.today().isoformat())
    save_model_file(model, output)
    if figures:
        _save_training_figures(run, "converged", figures)
    click.echo(held_out_text(fit.structure, fit.held_out_errors), err=True)
    click.echo(equations_text(model))
    for name, score in model.training_scores.items():
        click.echo(f"{name.replace('_', ' ')}: {score:.4f}", err=True)
    click.echo(f"Written to {output}", err=True)


@commands.command()
@data_option
@click.option(
    "--model",
    "models",
    multiple=True,
    metavar="NAME_OR_YAML",
    help="Model to validate; may be given many times.  [default: the three published ones]",
)
@click.option(
    "--integrator",
    type=click.Choice(("zoh", "ode45")),
    default="zoh",
    show_default=True,
    help="Exact integration of the held inputs, or what MATLAB's ode45 makes of them.",
)
@click.option("--no-plots", is_flag=True, help="Leaves the figures out.")
@output_option
def validate(
    data: Path | None,
    models: tuple[str, ...],
    integrator: str,
    no_plots: bool,
    output: Path | None,
) -> None:
    """Simulates models open loop over a recording and compares pose and body velocity.

    Writes summary.json and figures.
    """
    from mirte_drake.files import replacing_results, write_json
    from mirte_drake.identification.reports import validation_text
    from mirte_drake.identification.validation import validate_model
    from mirte_drake.model.model_file import load_model
    from mirte_drake.visualization.identification_figures import (
        MAX_MODELS,
        VALIDATION_FILES,
        save_validation_figures,
    )

    names = models or ("kinematic", "extended_kinematic", "dynamic")
    if not no_plots and len(names) > MAX_MODELS:
        raise UserError(
            f"--model: figures tell at most {MAX_MODELS} models apart, got {len(names)}; "
            "name fewer, or give --no-plots"
        )
    run = load_recording(data, needs_excitation=False)
    folder = output or Path("runs") / "validation" / (data.stem if data else "synthetic")
    results = {
        label: validate_model(load_model(name), run, integrator=integrator)
        for label, name in _labels(names).items()
    }
    rmse = {
        name: {"pose_rmse": r.pose_rmse.tolist(), "velocity_rmse": r.velocity_rmse.tolist()}
        for name, r in results.items()
    }
    with replacing_results(folder, ("summary.json", *VALIDATION_FILES)) as files:
        write_json(rmse, files / "summary.json")
        if not no_plots:
            save_validation_figures(
                files,
                time=run.time,
                pose=run.pose,
                body_velocity=run.body_velocity,
                predicted_poses={name: r.pose for name, r in results.items()},
                predicted_velocities={name: r.body_velocity for name, r in results.items()},
            )
    click.echo(validation_text(results))
    click.echo(f"Written to {folder}")


@commands.command()
@data_option
@click.option("--model", default="extended_kinematic", metavar="NAME_OR_YAML", show_default=True)
@click.option(
    "--level",
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    default=0.95,
    show_default=True,
    help="Coverage that quantile and conformal bounds aim at.",
)
@output_option
def disturbance(data: Path | None, model: str, level: float, output: Path | None) -> None:
    """Estimates the disturbance set of a model from a recording.

    Prints the published estimate and bounds with their coverage; writes summary.json.
    """
    from mirte_drake.files import write_json
    from mirte_drake.identification.disturbance_bound import (
        disturbance_summary,
        disturbance_text,
        estimate_disturbance,
    )
    from mirte_drake.model.model_file import load_model

    run = load_recording(data, needs_excitation=False)
    folder = output or Path("runs") / "disturbance" / (data.stem if data else "synthetic")
    estimate = estimate_disturbance(load_model(model), run, level=level)
    write_json(disturbance_summary(estimate), folder / "summary.json")
    click.echo(disturbance_text(estimate))
    click.echo(f"Written to {folder}")


def _labels(names: Sequence[str]) -> dict[str, str]:
    """Returns the models by short labels: the file's stem, or the whole name where stems agree."""
    if len(set(names)) < len(names):
        raise UserError("--model: the same model is given twice")
    stems = [Path(name).stem for name in names]
    return {
        stem if stems.count(stem) == 1 else name: name
        for stem, name in zip(stems, names, strict=True)
    }


def _parse_thresholds(text: str, kind: str) -> dict[str, float]:
    """Returns the thresholds by the names of the states that a kind of model identifies."""
    from mirte_drake.identification.model_structure import model_structure

    states = model_structure(kind).candidates
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != len(states) or not all(value >= 0 for value in values):
        raise UserError(
            f"--thresholds {text}: must be three numbers >= 0, for example 1e-4,1e-4,1e-5"
        )
    return dict(zip(states, values, strict=True))


def _save_training_figures(run: RecordedRun, mode: str, folder: Path) -> None:
    from mirte_drake.identification.differentiation import tvr_derivative
    from mirte_drake.visualization.identification_figures import save_training_figures

    save_training_figures(
        folder,
        time=run.time,
        pose=run.pose,
        body_velocity=run.body_velocity,
        wheel_command=run.wheel_command,
        estimated_derivative=tvr_derivative(run.pose, run.period, mode),
    )
