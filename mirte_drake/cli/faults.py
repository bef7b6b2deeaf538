"""The command that puts faults to a drive."""

import os
import sys
from pathlib import Path

import click

from mirte_drake.cli.options import commands, output_option
from mirte_drake.robots.names import TRANSPORTS


@commands.command()
@click.option(
    "--runs", type=click.IntRange(min=1), default=20, show_default=True, help="Trials of each kind."
)
@click.option(
    "--transport",
    type=click.Choice(TRANSPORTS),
    default="ros2",
    show_default=True,
    help="The wire.",
)
@click.option(
    "--jobs", type=click.IntRange(min=1), default=2, show_default=True, help="Trials at once."
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option(
    "--kind",
    "kinds",
    multiple=True,
    metavar="NAME",
    help="Kind of fault; may be given many times.  [default: all]",
)
@click.option("--list", "listing", is_flag=True, help="Shows the kinds and what must come of them.")
@output_option
def faults(
    runs: int,
    transport: str,
    jobs: int,
    seed: int,
    kinds: tuple[str, ...],
    listing: bool,
    output: Path | None,
) -> None:
    """Puts faults to a drive, on a wire of this machine alone, and checks what comes of them.

    In each trial a robot, a guard and a controller run in processes of their own; a fault meets
    odometry, controller, guard or wire. Prints for every kind how many trials went as they must,
    and how long it took from what makes a stop due to wheel commands of zero on the wire. Writes
    faults.json, every trial as trials.csv, and what happened where one failed as failures.txt.
    Ends with 1 when a trial failed.
    """
    from mirte_drake.faults.campaign import (
        kinds_text,
        report,
        report_text,
        run_campaign,
        save_failures,
        save_trials,
        trials,
    )
    from mirte_drake.faults.kinds import KINDS, find_kind
    from mirte_drake.files import replacing_results, write_json

    if listing:
        click.echo(kinds_text())
        return
    names = [find_kind(name).name for name in dict.fromkeys(kinds or KINDS)]
    todo = trials(names, transport, runs, seed, first=os.getpid())
    folder = output or Path("runs") / f"faults_{transport}"
    with replacing_results(folder, ("faults.json", "trials.csv", "failures.txt")) as results:
        with click.progressbar(length=len(todo), label="faults", file=sys.stderr) as bar:
            outcomes = run_campaign(todo, jobs=jobs, on_trial=lambda: bar.update(1))
        summary = report(outcomes)
        write_json(summary, results / "faults.json")
        save_trials(outcomes, results / "trials.csv")
        save_failures(outcomes, results / "failures.txt")
    click.echo(report_text(summary))
    click.echo(f"Written to {folder}")
    if not all(outcome.verdict.passed for outcome in outcomes):
        sys.exit(1)
