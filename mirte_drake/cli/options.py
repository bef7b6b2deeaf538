"""The command group, and what its commands share."""

from pathlib import Path

import click

import mirte_drake

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
