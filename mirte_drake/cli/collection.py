"""The command that drives a robot to record data for identification."""

import sys
from pathlib import Path

import click

from mirte_drake.cli.options import (
    commands,
    fail,
    file_option,
    robot_option,
    set_option,
    transport_option,
    wire_option,
)
from mirte_drake.errors import UserError


@commands.command()
@click.argument("name")
@click.option(
    "--duration",
    type=float,
    default=120.0,
    show_default=True,
    help="Of the excitation [s]: half random templates, half patterns.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    help="Of excitation and jitter.  [default: the scenario's]",
)
@robot_option
@transport_option
@wire_option
@set_option
@file_option("Recording to write.", "runs/NAME.csv")
def collect(
    name: str,
    duration: float,
    seed: int | None,
    robot: tuple[str, ...],
    transport: tuple[str, ...],
    wire: tuple[str, ...],
    overrides: tuple[str, ...],
    output: Path | None,
) -> None:
    """Drives the robot of the scenario NAME by the excitation of algorithm 1 and records it.

    Writes a CSV file in the format of the robot's recordings, which `identify` reads.
    """
    from mirte_drake.collect import collect_scenario, num_samples
    from mirte_drake.control.excitation import ExcitationConfig
    from mirte_drake.identification.csv_file import save_csv
    from mirte_drake.identification.recorded_run import RecordedRun, repaired
    from mirte_drake.scenario import WiredRobotConfig
    from mirte_drake.scenario_file import load_scenario, scenario_stem

    excitation = ExcitationConfig(duration=duration, random_duration=duration / 2)
    try:
        excitation.validate()
    except ValueError as error:
        raise UserError(f"--{error}") from None
    scenario = load_scenario(name, (*robot, *transport, *overrides, *wire))
    stem = scenario_stem(name)
    output = output or Path("runs") / f"{stem}.csv"
    rows = num_samples(excitation)
    with click.progressbar(length=rows, label=stem, file=sys.stderr) as bar:

        def on_sample() -> None:
            bar.update(1)

        if isinstance(scenario.robot, WiredRobotConfig):
            from mirte_drake.drive import collect_over_wire
            from mirte_drake.wire_session import wire_to

            with wire_to(scenario) as (link, session):
                data = collect_over_wire(
                    scenario, excitation, link, session, seed=seed, on_sample=on_sample
                )
        else:
            data = collect_scenario(scenario, excitation, seed=seed, on_sample=on_sample)
    if not len(data.time):
        fail(data.ended)
    run = RecordedRun(data.time, data.pose, data.body_velocity, data.wheel_command)
    run = repaired(run, lambda row: f"sample {row}", name)
    save_csv(run, output)
    click.echo(f"{len(run.time)} samples, {run.time[-1]:.1f} s")
    click.echo(f"Written to {output}")
    if data.ended:
        fail(f"ended early: {data.ended}")
