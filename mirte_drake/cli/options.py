"""The command group, and what its commands share."""

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

import click

import mirte_drake
from mirte_drake.robots.names import ROBOTS, TRANSPORTS, robot_override


def fail(message: str) -> NoReturn:
    """Ends the command as failed, with one line."""
    click.echo(f"Error: {message}", err=True)
    sys.exit(1)


output_option = click.option(
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder to write to.",
)


def file_option(what: str, default: str) -> Callable:
    """Returns the option ``--output`` of a command that writes one file.

    Args:
        what: Says what is written.
        default: Where to, by default; the command fills in what stands in capitals.
    """
    return click.option(
        "--output",
        type=click.Path(dir_okay=False, path_type=Path),
        help=f"{what}  [default: {default}]",
    )


set_option = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="PATH.TO.FIELD=VALUE",
    help="Changes one value of the scenario; the value is YAML. May be given many times.",
)


def _as_override(_: click.Context, __: click.Parameter, robot: str | None) -> tuple[str, ...]:
    return (robot_override(robot),) if robot else ()


# Its value is a tuple of overrides, to come before those of `--set`.
robot_option = click.option(
    "--robot",
    type=click.Choice(ROBOTS),
    callback=_as_override,
    help="Another robot than the scenario's: short for --set robot=!KindRobotConfig {}.",
)

transport_option = click.option(
    "--transport",
    type=click.Choice(TRANSPORTS),
    callback=_as_override,
    help="Wire of the robot, unless the scenario has it: --set robot=!KindRobotConfig {}.",
)


def _as_wire_overrides(_: click.Context, __: click.Parameter, wire: tuple[str, ...]) -> list[str]:
    # A URL is no plain YAML where it stands within braces.
    quoted = [re.sub(r'^url=([^"\'].*)$', r'url="\1"', change) for change in wire]
    return [f"robot.wire.{change}" for change in quoted]


wire_option = click.option(
    "--wire",
    multiple=True,
    metavar="FIELD=VALUE",
    callback=_as_wire_overrides,
    help="Changes one setting of the wire, as domain=7 or interface=eth0. May be given many times.",
)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(mirte_drake.__version__)
def commands() -> None:
    """From a recording of a MIRTE Master to a controller that drives it robustly."""
