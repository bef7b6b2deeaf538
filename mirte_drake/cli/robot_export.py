"""The command that gives the multibody robot to other programs."""

from pathlib import Path

import click

from mirte_drake.cli.options import commands, file_option


@commands.command("export-robot")
@file_option("File to write.", "runs/mirte_master.sdf")
def export_robot(output: Path | None) -> None:
    """Writes the robot that the multibody simulation drives as SDF: base, wheels, rollers."""
    from mirte_drake.robots.robot_description import write_robot_sdf

    output = output or Path("runs") / "mirte_master.sdf"
    write_robot_sdf(output)
    click.echo(f"Written to {output}")
