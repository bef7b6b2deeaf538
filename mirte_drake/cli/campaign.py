"""The command that runs many scenarios many times."""

import sys
from pathlib import Path

import click

from mirte_drake.cli.options import commands, fail, output_option, robot_option, set_option


@commands.command()
@click.argument("names", metavar="NAME...", nargs=-1, required=True)
@click.option(
    "--runs", type=click.IntRange(min=1), default=20, show_default=True, help="Seeds of each cell."
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="The first of them."
)
@click.option(
    "--vary",
    "varied",
    multiple=True,
    metavar="PATH.TO.FIELD=[V1, V2, ...]",
    help="Runs every scenario with each of these values, in YAML. May be given many times; all "
    "combinations are run.",
)
@click.option(
    "--controllers",
    is_flag=True,
    help="Drives the path of each NAME by every controller: pid_NAME, lqr_NAME, baseline_NAME, "
    "NAME and so on, as far as there are such scenarios.",
)
@robot_option
@set_option
@click.option(
    "--backend",
    type=click.Choice(["loky", "serial", "dask", "ray"]),
    default="loky",
    show_default=True,
    help="Where runs run: processes of this machine, this process alone, a Dask or a Ray cluster.",
)
@click.option(
    "--jobs", type=click.IntRange(min=1), default=1, show_default=True, help="Runs at once."
)
@click.option(
    "--address",
    metavar="ADDRESS",
    help="Of a running Dask scheduler or Ray cluster.  [default: one of this machine is started]",
)
@output_option
def campaign(
    names: tuple[str, ...],
    runs: int,
    seed: int,
    varied: tuple[str, ...],
    controllers: bool,
    robot: tuple[str, ...],
    overrides: tuple[str, ...],
    backend: str,
    jobs: int,
    address: str | None,
    output: Path | None,
) -> None:
    """Runs scenarios with many seeds and values, in parallel, and tables what they show.

    NAME is a scenario, or a YAML file of one. The seeds are the same for all cells, a cell being
    a scenario with one value of each varied field. Interrupted or killed, the same command goes on
    where it was; with more runs or values it runs what is new.

    Prints medians of each cell with their 95 % confidence intervals: RMSE of the true pose, how
    often a command's increments change their sign (turns), the share of samples in which a wheel
    is at its limit; then, over the samples of all runs, the share in which the true pose was in
    the tube and in which the measured one was in the tube around its prediction (next); with a
    coverage monitor, the shares of the one-step errors that the set in use and the calibrated one
    held. Lost is a run that was ever more than 1 m or a quarter turn from its reference; a failed
    one could not be run, and its row says why.

    Writes runs.csv and, with pyarrow, runs.parquet, a row each run; summary.json; and the folder
    results, with what is needed to go on.
    """
    from mirte_drake.campaign.grid import cells, parse_variation, trials, with_controllers
    from mirte_drake.campaign.outcome import Failure
    from mirte_drake.campaign.statistics import summarise_cells
    from mirte_drake.campaign.study import run_trials
    from mirte_drake.campaign.table import TABLE_FILES, rows, save_tables, summary_text
    from mirte_drake.files import replacing_results

    if address is not None and backend not in ("dask", "ray"):
        raise click.UsageError(f"--address {address}: is for --backend dask and ray")
    variations = [parse_variation(text) for text in varied]
    grid = cells(
        with_controllers(names) if controllers else names, variations, (*robot, *overrides)
    )
    todo = trials(grid, range(seed, seed + runs))
    folder = output or Path("runs") / "campaign"
    with replacing_results(folder, TABLE_FILES) as tables:
        with click.progressbar(length=len(todo), label="campaign", file=sys.stderr) as bar:
            results = run_trials(
                todo,
                store=folder / "results",
                backend=backend,
                jobs=jobs,
                address=address,
                on_run=lambda: bar.update(1),
            )
        summaries = summarise_cells(todo, results)
        save_tables(rows(variations, todo, results), variations, summaries, tables)
    click.echo(summary_text(variations, summaries))
    click.echo(f"Written to {folder}")
    errors = [result.error for result in results if isinstance(result, Failure)]
    if errors:
        message = f"{len(errors)} of {len(results)} runs failed, the first by {errors[0]}"
        if len(errors) == len(results):
            fail(message)
        click.echo(f"Warning: {message}", err=True)
