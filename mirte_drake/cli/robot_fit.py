"""The command that fits the dynamic robot to a recording."""

import sys
from datetime import date
from pathlib import Path

import click

from mirte_drake.cli.options import commands, file_option
from mirte_drake.cli.recording import data_option, load_recording
from mirte_drake.errors import UserError


@commands.command("fit-robot")
@data_option
@click.option(
    "--validate",
    "others",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Recording to try the result on, with no part in the fit; may be given many times.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option(
    "--fleet",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder to write variations of the fitted robot to: gains, friction, payload.",
)
@file_option("Robot file to write.", "runs/fitted.yaml")
def fit_robot(
    data: Path | None, others: tuple[Path, ...], seed: int, fleet: Path | None, output: Path | None
) -> None:
    """Fits drivetrain and dynamic robot to a recording, and writes them as YAML.

    Prints the error of held-out blocks for each structure tried, and the RMSE of open-loop
    simulation over all recordings given, velocities as means over a sample.
    """
    from mirte_drake.identification.fit_robot import STRUCTURES, fit_steps, robot_file
    from mirte_drake.identification.fit_robot import fit_robot as fit_to
    from mirte_drake.identification.held_out import held_out_text
    from mirte_drake.identification.reports import validation_text
    from mirte_drake.identification.robot_validation import validate_robot
    from mirte_drake.model.fleet import fleet_files
    from mirte_drake.model.robot_file import save_robot_file

    output = output or Path("runs") / "fitted.yaml"
    run = load_recording(data)
    runs = {path.stem: load_recording(path, needs_excitation=False) for path in others}
    label = data.stem if data else "synthetic"
    if len(runs) < len(others) or label in runs:
        raise UserError("--validate: recordings must have names of their own")
    with click.progressbar(length=fit_steps(STRUCTURES), label="fit", file=sys.stderr) as bar:
        fit = fit_to(run, STRUCTURES, seed=seed, on_step=lambda: bar.update(1))
    scores = {
        name: validate_robot(name, fit.parameters, recording)
        for name, recording in {label: run, **runs}.items()
    }
    content = robot_file(fit, run, scores, seed=seed, date=date.today().isoformat())
    save_robot_file(content, output)
    if fleet:
        for variation in fleet_files(content):
            save_robot_file(variation, fleet / f"{variation.name}.yaml")
    click.echo(held_out_text(fit.structure, fit.held_out_errors))
    click.echo(validation_text(scores))
    click.echo(f"Written to {output}" + (f" and {fleet}" if fleet else ""))
