"""The command that makes a run's page."""

from pathlib import Path

import click

from mirte_drake.cli.options import commands, file_option


@commands.command()
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@file_option("Page to write.", "FOLDER/replay.html")
def replay(folder: Path, output: Path | None) -> None:
    """Makes a page that plays the run in FOLDER in 3-D, from the files of simulate.

    The page is one file, below 5 MB, that any browser opens without a network.
    """
    from mirte_drake.replay import write_replay
    from mirte_drake.run_summary import REPLAY_FILE

    path = output or folder / REPLAY_FILE
    write_replay(folder, path)
    click.echo(f"Written to {path}")
