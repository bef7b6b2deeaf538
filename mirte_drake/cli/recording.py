"""The recording that a command works on."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from mirte_drake.identification.recorded_run import RecordedRun

data_option = click.option(
    "--data",
    type=click.Path(path_type=Path),
    help="Recording: CSV file or ROS 2 bag. Without it, a synthetic recording.",
)


def load_recording(data: Path | None, *, needs_excitation: bool = True) -> RecordedRun:
    """Reads the recording, or makes a synthetic one, and says what was found in it."""
    from mirte_drake.identification.recorded_run import check_excitation, load_recorded_run
    from mirte_drake.identification.synthetic_recording import synthetic_recording

    run = load_recorded_run(data) if data else synthetic_recording()
    if needs_excitation:
        check_excitation(run)
    span = run.time[-1] - run.time[0]
    click.echo(f"{run.source}: {len(run.time)} samples, {span:.1f} s", err=True)
    for repair in run.repairs:
        click.echo(f"  {repair}", err=True)
    return run
