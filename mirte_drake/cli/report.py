"""The command that makes reports of runs."""

from pathlib import Path

import click

from mirte_drake.cli.options import commands, file_option


@commands.command()
@click.argument(
    "folders",
    metavar="RUN_FOLDER...",
    nargs=-1,
    required=True,
    type=click.Path(exists=True, file_okay=False, path_type=Path),
)
@file_option("Page to write.", "report.html in RUN_FOLDER; of several, runs/comparison.html")
def report(folders: tuple[Path, ...], output: Path | None) -> None:
    """Makes a page of a run, or of several runs beside each other.

    One file that opens offline: numbers, figures, and of a single run its replay where there is
    one, its Diagram and its scenario. Runs that differ by their seed alone are taken together.
    """
    from mirte_drake.reporting import save_comparison, save_report

    if len(folders) == 1:
        written = save_report(folders[0], output)
    else:
        written = save_comparison(folders, output or Path("runs") / "comparison.html")
    click.echo(f"Written to {written}")
