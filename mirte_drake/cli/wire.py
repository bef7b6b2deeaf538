"""Commands at the wire: a stand-in for the robot, drives, the guard, and the stop."""

import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from mirte_drake.cli.options import (
    commands,
    fail,
    output_option,
    robot_option,
    set_option,
    transport_option,
    wire_option,
)
from mirte_drake.errors import UserError

if TYPE_CHECKING:
    from mirte_drake.hardware.link import Link
    from mirte_drake.scenario import Scenario

BAG = "drive.mcap"

running_guard_option = click.option(
    "--running-guard",
    is_flag=True,
    help="Drives by a guard that runs already, as on the robot, instead of one of its own.",
)
no_bag_option = click.option("--no-bag", is_flag=True, help="Records no bag.")
live_option = click.option("--live", is_flag=True, help="Lets Foxglove look on, at port 8765.")


def warn_of_exposure(link: "Link") -> None:
    """Says who beyond this machine can speak on the wire."""
    if link.exposure:
        click.echo(f"note: {link.exposure}", err=True)


@commands.command()
@click.argument("name", default="rectangle")
@transport_option
@wire_option
@robot_option
@set_option
@click.option("--duration", type=float, help="Ends after so long [s].  [default: never]")
def robot(
    name: str,
    transport: tuple[str, ...],
    wire: tuple[str, ...],
    robot: tuple[str, ...],
    overrides: tuple[str, ...],
    duration: float | None,
) -> None:
    """Puts the robot of the scenario NAME on a wire, where it behaves like a MIRTE Master.

    Odometry at 10 Hz, and the last wheel command persists. It stands still until the first
    command that is not zero. Ends with Ctrl-C, and prints what it has seen.
    """
    import time

    from mirte_drake.drive import few_pauses
    from mirte_drake.hardware.link import Role
    from mirte_drake.hardware.wire_config import open_link
    from mirte_drake.pacing import WireStopped, interruption
    from mirte_drake.scenario import wired_robot
    from mirte_drake.scenario_file import load_scenario
    from mirte_drake.stand_in import StandIn

    wired = wired_robot(load_scenario(name, (*transport, *wire)))
    scenario = load_scenario(name, (*robot, *overrides))
    with open_link(wired.wire, Role.ROBOT) as link, interruption() as watch:
        stand_in = StandIn(scenario, link)
        warn_of_exposure(link)
        click.echo(f"{type(scenario.robot).__name__} is on the wire; Ctrl-C ends it", err=True)
        end = time.monotonic() + (np.inf if duration is None else duration)
        with suppress(WireStopped), few_pauses():
            while time.monotonic() < end:
                stand_in.step()
                watch()
    log = stand_in.log
    click.echo(f"{log.odometry_sent} odometry messages sent, {log.commands} commands received")
    if log.latencies:
        p50, p99, most = np.percentile(1e3 * np.array(log.latencies), [50, 99, 100])
        click.echo(
            f"from odometry to command: {p50:.2f} ms median, {p99:.2f} ms p99, {most:.2f} ms max"
        )
    x, y, yaw = stand_in.pose
    click.echo(f"ended at {x:.3f} m, {y:.3f} m, {yaw:.3f} rad")


@commands.command()
@click.argument("name")
@transport_option
@wire_option
@running_guard_option
@live_option
@no_bag_option
@click.option("--no-plots", is_flag=True, help="Leaves the figures out.")
@set_option
@output_option
def drive(
    name: str,
    transport: tuple[str, ...],
    wire: tuple[str, ...],
    running_guard: bool,
    live: bool,
    no_bag: bool,
    no_plots: bool,
    overrides: tuple[str, ...],
    output: Path | None,
) -> None:
    """Drives the robot at the other end of a wire through the scenario NAME.

    A guard watches over it, see the README. Writes what `simulate` writes, and a bag that
    Foxglove, PlotJuggler and `identify` read.
    """
    from mirte_drake.scenario_file import load_scenario, scenario_stem

    scenario = load_scenario(name, (*transport, *overrides, *wire))
    stem = scenario_stem(name)
    _drive(scenario, stem, output or Path("runs") / stem, running_guard, live, no_bag, no_plots)


@commands.command(context_settings={"ignore_unknown_options": True})  # A number may be negative.
@click.argument("velocity", nargs=3, type=float, metavar="VX VY YAW_RATE")
@click.option("--duration", type=float, default=5.0, show_default=True, help="Of the drive [s].")
@click.option("--scenario", "name", default="rectangle", help="Whose controller it is.")
@transport_option
@wire_option
@running_guard_option
@live_option
@no_bag_option
@set_option
@output_option
def setpoint(
    velocity: tuple[float, float, float],
    duration: float,
    name: str,
    transport: tuple[str, ...],
    wire: tuple[str, ...],
    running_guard: bool,
    live: bool,
    no_bag: bool,
    overrides: tuple[str, ...],
    output: Path | None,
) -> None:
    """Drives at the body velocity VX VY [m/s] YAW_RATE [rad/s], tracked as a pose reference."""
    from mirte_drake.scenario_file import load_scenario

    reference = (
        f"reference=!VelocitySetpointConfig {{setpoint: {list(velocity)}}}",
        f"duration={duration}",
    )
    scenario = load_scenario(name, (*reference, *transport, *overrides, *wire))
    _drive(scenario, "setpoint", output or Path("runs/setpoint"), running_guard, live, no_bag, True)


def _drive(
    scenario: "Scenario",
    stem: str,
    folder: Path,
    running_guard: bool,
    live: bool,
    no_bag: bool,
    no_plots: bool,
) -> None:
    """Drives a scenario, writes what came of it, and ends with 1 where it ended early."""
    from mirte_drake import drive as driving
    from mirte_drake.cli.simulation import summary_table
    from mirte_drake.files import replacing_results
    from mirte_drake.reporting import REPORT_FILE, save_report
    from mirte_drake.run_summary import RUN_FILES, save_run
    from mirte_drake.scenario import wired_robot
    from mirte_drake.visualization.figures import FIGURE_FILES, save_figures
    from mirte_drake.wire_session import wire_to

    wired_robot(scenario)
    with replacing_results(folder, (BAG, *RUN_FILES, *FIGURE_FILES, REPORT_FILE)) as results:
        bag = None if no_bag else results / BAG
        with (
            driving.recording(scenario, bag=bag, live=live) as recorder,
            wire_to(scenario, own_guard=not running_guard) as (link, session),
            click.progressbar(length=scenario.steps, label=stem, file=sys.stderr) as bar,
        ):
            warn_of_exposure(link)
            run = driving.drive(
                scenario,
                stem,
                link,
                session,
                on_sample=lambda: bar.update(1),
                recorder=recorder,
            )
        if not run.log:
            fail(run.ended)
        summary = save_run(run, results)
        if not no_plots:
            save_figures(run.log, results, input_limit=scenario.input_limit)
            save_report(results)
    click.echo(summary_table(summary, tube=scenario.has_tube))
    click.echo(f"Written to {folder}")
    if run.ended:
        fail(f"ended early: {run.ended}")


@commands.command()
@click.argument("name", default="rectangle")
@transport_option
@wire_option
@set_option
def guard(
    name: str, transport: tuple[str, ...], wire: tuple[str, ...], overrides: tuple[str, ...]
) -> None:
    """Runs a guard by itself, best on the robot: drives then name it with --running-guard.

    It alone sends wheel commands, and stops the robot when the controller or the network is gone.
    Limits are those of the scenario NAME, `robot.governor`. Ends with Ctrl-C, wheels at rest.
    """
    from mirte_drake.hardware.guard_process import GuardSetup, serve
    from mirte_drake.scenario import wired_robot
    from mirte_drake.scenario_file import load_scenario

    scenario = load_scenario(name, (*transport, *overrides, *wire))
    wired = wired_robot(scenario)
    serve(
        GuardSetup(wired.wire, wired.governor, scenario.first_pose),
        on_ready=lambda: click.echo("the guard is on the wire; Ctrl-C ends it", err=True),
    )


@commands.command()
@transport_option
@wire_option
@click.option("--reset", is_flag=True, help="Lets a guard that has stopped the robot go on.")
def stop(transport: tuple[str, ...], wire: tuple[str, ...], reset: bool) -> None:
    """Stops all wheels at once, by the guard and by zeros of its own."""
    from mirte_drake.hardware.link import Role
    from mirte_drake.hardware.wire_config import open_link
    from mirte_drake.scenario import wired_robot
    from mirte_drake.scenario_file import load_scenario
    from mirte_drake.wire_session import reset_guard, stop_all

    if not transport:
        raise UserError("--transport: is needed: ros2 or lcm")
    wired = wired_robot(load_scenario("rectangle", (*transport, *wire)))
    with open_link(wired.wire, Role.OPERATOR) as link:
        click.echo(reset_guard(link) if reset else stop_all(link))
