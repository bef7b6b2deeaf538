"""The command line ``mirte-drake``: parses, calls, prints."""

import sys
from collections.abc import Sequence
from pathlib import Path

import click

import mirte_drake
from mirte_drake.errors import UserError

output_option = click.option(
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder to write to.",
)
set_option = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="PATH.TO.FIELD=VALUE",
    help="Changes one value of the scenario; the value is YAML. May be given many times.",
)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(mirte_drake.__version__)
def commands() -> None:
    """From a recording of a MIRTE Master to a controller that drives it robustly."""


@commands.command()
def scenarios() -> None:
    """Lists the scenarios that come with the package."""
    from mirte_drake.scenario import load_scenario, scenario_names

    for name in scenario_names():
        click.echo(f"{name:28}{load_scenario(name).description}")


@commands.command()
@click.argument("name")
@click.option("--seed", type=click.IntRange(min=0), help="Seed of the disturbance.")
@set_option
@click.option("--no-plots", is_flag=True, help="Leaves the figures out.")
@output_option
def simulate(
    name: str, seed: int | None, overrides: tuple[str, ...], no_plots: bool, output: Path | None
) -> None:
    """Runs the scenario NAME, or the one in a YAML file, and writes what came out.

    Writes summary.json, log.npz, the scenario as it was run, and figures as PDF, SVG and PNG.
    """
    from mirte_drake.run import save_run
    from mirte_drake.run import simulate as run_scenario
    from mirte_drake.scenario import load_scenario, scenario_stem

    if seed is not None:
        overrides = (*overrides, f"seed={seed}")
    scenario = load_scenario(name, overrides)
    stem = scenario_stem(name)
    folder = output or Path("runs") / stem
    _check_writable(folder)
    with click.progressbar(length=scenario.steps, label=stem, file=sys.stderr) as bar:
        run = run_scenario(scenario, stem, on_sample=lambda: bar.update(1))
    summary = save_run(run, folder)
    if not no_plots:
        from mirte_drake.visualization.figures import save_figures

        save_figures(run.log, folder, input_limit=scenario.input_limit)
    click.echo(_table(summary))
    click.echo(f"Written to {folder}")


@commands.command()
@click.argument("name")
@click.option(
    "--depth",
    type=click.IntRange(min=1),
    default=2,
    show_default=True,
    help="1 draws the controller as one block, 2 looks into it.",
)
@set_option
@output_option
def diagram(name: str, depth: int, overrides: tuple[str, ...], output: Path | None) -> None:
    """Draws the Diagram of the scenario NAME: NAME.svg, NAME.png and NAME.dot."""
    from mirte_drake.assembly import MakeDiagram
    from mirte_drake.scenario import load_scenario, scenario_stem
    from mirte_drake.visualization.diagram_picture import save_diagram_picture

    scenario = load_scenario(name, overrides)
    stem = (output or Path("diagrams")) / scenario_stem(name)
    for path in save_diagram_picture(MakeDiagram(scenario), stem, depth):
        click.echo(path)


def _check_writable(folder: Path) -> None:
    """Fails before the work, not after it."""
    from mirte_drake.typed_yaml import replacing

    with replacing(folder / ".writable") as temporary:
        temporary.touch()
    (folder / ".writable").unlink()


def _table(summary: dict) -> str:
    """Returns the summary for a person to read."""
    rmse, solve = summary["rmse"], summary["solve_time_ms"]
    rows = [
        ("scenario", f"{summary['scenario']}, seed {summary['seed']}"),
        ("samples", f"{summary['steps']} ({summary['simulated_time_s']:.1f} s)"),
        ("RMSE x", f"{rmse['x_m']:.4f} m"),
        ("RMSE y", f"{rmse['y_m']:.4f} m"),
        ("RMSE yaw", f"{rmse['yaw_rad']:.4f} rad"),
        ("solver", f"{summary['solver']}, {summary['solve_failures']} failures"),
        (
            "solve time",
            f"{solve['p50']:.1f} ms median, {solve['p99']:.1f} ms p99, {solve['max']:.1f} ms max",
        ),
        ("outside the tube", f"{summary['tube_violations']} samples"),
        ("successor outside", f"{summary['successor_violations']} samples"),
        ("input set violated", f"{summary['input_violations']} samples"),
        ("rate bound violated", f"{summary['rate_violations']} samples"),
        ("wall time", f"{summary['wall_time_s']:.1f} s"),
    ]
    return "\n".join(f"{label:22}{value}" for label, value in rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the command line; exit code 0 done, 1 failed, 2 wrong use."""
    try:
        commands.main(args=arguments, prog_name="mirte-drake", standalone_mode=False)
    except click.exceptions.Abort:
        _end("interrupted", 1)
    except click.ClickException as error:
        _end(error.format_message(), 2)
    except UserError as error:
        _end(str(error), 2)


def _end(message: str, code: int) -> None:
    click.echo(f"Error: {' '.join(message.split())}", err=True)
    sys.exit(code)
