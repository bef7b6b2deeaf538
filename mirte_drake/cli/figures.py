"""The command that draws the thesis's figures again."""

import sys
from pathlib import Path

import click

from mirte_drake.cli.options import commands, output_option

# Numbers of the figures, and how many parts each has.
PARTS = {
    "3-2": 4, "3-3": 2, "3-4": 2, "4-2": 3, "4-3": 3, "5-2": 3, "5-3": 3, "5-4": 3, "5-5": 3
}  # fmt: skip


@commands.command()
@click.argument("numbers", nargs=-1, metavar="[NUMBER]...", type=click.Choice(tuple(PARTS)))
@click.option(
    "--data",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Folder of the robot's recordings, which figures 3-2 to 3-4 need.",
)
@output_option
def figures(numbers: tuple[str, ...], data: Path | None, output: Path | None) -> None:
    """Draws figures of the thesis again: all, or those of the NUMBERs, as 4-2.

    3-2 to 3-4 from the robot's recordings, 4-2, 4-3 and 5-2 to 5-5 from our runs. Writes every
    part as PDF, SVG and PNG, and index.html with captions that say what is ours and what is
    published.
    """
    from mirte_drake.errors import UserError
    from mirte_drake.files import replacing_results
    from mirte_drake.run_summary import versions
    from mirte_drake.thesis.recorded import FILES, recorded_figure
    from mirte_drake.thesis.simulated import simulated_figure
    from mirte_drake.visualization.thesis_page import (
        INDEX_FILE,
        figure_files,
        save_thesis_figure,
        save_thesis_page,
    )

    chosen = [number for number in PARTS if number in (numbers or PARTS)]
    missing = [number for number in chosen if number in FILES and data is None]
    if missing and numbers:
        raise UserError(
            f"figure {missing[0]} needs the robot's recordings: name their folder by --data"
        )
    drawn = []
    folder = output or Path("runs") / "thesis_figures"
    with replacing_results(folder, (INDEX_FILE, *figure_files(PARTS))) as results:
        todo = [number for number in chosen if number not in missing]
        with click.progressbar(todo, label="figures", file=sys.stderr) as bar:
            for number in bar:
                figure = (
                    recorded_figure(number, data)
                    if data and number in FILES
                    else simulated_figure(number)
                )
                save_thesis_figure(figure, results)
                drawn.append(figure)
        save_thesis_page(drawn, missing, versions(), results)
    if missing:
        click.echo(
            f"Without {', '.join(missing)}: they need the robot's recordings, --data FOLDER",
            err=True,
        )
    click.echo(f"Written to {folder / INDEX_FILE}")
