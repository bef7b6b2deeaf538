"""The command that compares controllers on every robot."""

import sys
from pathlib import Path

import click

from mirte_drake.cli.options import commands, output_option, set_option
from mirte_drake.robots.names import ROBOTS


@commands.command()
@click.option(
    "--runs", type=click.IntRange(min=1), default=20, show_default=True, help="Seeds, from 0 on."
)
@click.option(
    "--scenario",
    "scenarios",
    multiple=True,
    metavar="NAME",
    help="Scenario, or YAML file of one; may be given many times.  [default: all]",
)
@click.option(
    "--robot",
    "robots",
    multiple=True,
    type=click.Choice(ROBOTS),
    help="Robot; may be given many times.  [default: all]",
)
@click.option(
    "--jobs", type=click.IntRange(min=1), default=1, show_default=True, help="Processes at once."
)
@set_option
@output_option
def compare(
    runs: int,
    scenarios: tuple[str, ...],
    robots: tuple[str, ...],
    jobs: int,
    overrides: tuple[str, ...],
    output: Path | None,
) -> None:
    """Runs scenarios, with the tube and without, on every robot and compares how they drive.

    Prints medians over the seeds: RMSE of the measured and of the true pose; the share of samples
    at which the true pose is in the tube, at which the measured one is where the sample before
    predicted it, and at which a wheel is at its limit; how often a command's increments change
    their sign. Below stands how many solves failed in all runs. Writes comparison.json, and every
    run as runs.csv.
    """
    from mirte_drake.comparison import (
        SCENARIOS,
        comparison,
        comparison_text,
        run_trials,
        save_runs,
        trials,
    )
    from mirte_drake.files import replacing_results, write_json

    names, robots = (tuple(dict.fromkeys(given)) for given in (scenarios or SCENARIOS, robots))
    todo = trials(names, robots or ROBOTS, runs, overrides)
    folder = output or Path("runs") / "comparison"
    with replacing_results(folder, ("comparison.json", "runs.csv")) as results:
        with click.progressbar(length=len(todo), label="compare", file=sys.stderr) as bar:
            outcomes = run_trials(todo, jobs=jobs, on_run=lambda: bar.update(1))
        summary = comparison(todo, outcomes)
        write_json(summary, results / "comparison.json")
        save_runs(todo, outcomes, results / "runs.csv")
    click.echo(comparison_text(summary))
    failures = sum(row["solve_failures"] for row in summary["medians"])
    click.echo(f"Failed solves: {failures} in {len(todo)} runs")
    click.echo(f"Written to {folder}")
