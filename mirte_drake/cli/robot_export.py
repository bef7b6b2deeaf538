"""The command that gives the multibody robot to other programs."""

from pathlib import Path

import click

from mirte_drake.cli.options import commands


@commands.command("export-robot")
@click.option(
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    default=Path("runs") / "mirte_master.sdf",
    show_default=True,
    help="File to write.",
)
def export_robot(output: Path) -> None:
    """Writes the robot that the multibody simulation drives as SDF: base, wheels, rollers."""
    from mirte_drake.robots.robot_description import write_robot_sdf

    write_robot_sdf(output)
    click.echo(f"Written to {output}")
