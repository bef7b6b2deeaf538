"""The command line ``mirte-drake``: parses, calls, prints; no logic.

Commands import what they need when they run, so that ``--help`` answers at once.
"""

import sys
from collections.abc import Sequence

import click

from mirte_drake.cli import (  # noqa: F401 They add their commands.
    benchmark,
    campaign,
    collection,
    comparison,
    doctor,
    faults,
    figures,
    identification,
    replay,
    report,
    robot_export,
    robot_fit,
    simulation,
    watch,
    wire,
)
from mirte_drake.cli.options import commands
from mirte_drake.errors import UserError


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the command line; exit code 0 done, 1 failed, 2 wrong use."""
    try:
        commands.main(args=arguments, prog_name="mirte-drake", standalone_mode=False)
    except click.exceptions.Abort:
        _end("interrupted", 1)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        sys.exit(2)
    except click.ClickException as error:
        _end(error.format_message(), 2)
    except UserError as error:
        _end(str(error), 2)


def _end(message: str, code: int) -> None:
    click.echo(f"Error: {' '.join(message.split())}", err=True)
    sys.exit(code)
