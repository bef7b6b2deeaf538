"""The command that shows a scenario live."""

import click

from mirte_drake.cli.options import commands, robot_option, set_option


@commands.command()
@click.argument("name")
@click.option(
    "--seed", type=click.IntRange(min=0), help="Of the disturbance and of the odometry's jitter."
)
@robot_option
@set_option
@click.option(
    "--port",
    type=click.IntRange(min=1024, max=65535),
    help="Of the page.  [default: the first free one from 7000 on]",
)
@click.option("--dark", is_flag=True, help="Gives the page a dark background.")
def watch(
    name: str,
    seed: int | None,
    robot: tuple[str, ...],
    overrides: tuple[str, ...],
    port: int | None,
    dark: bool,
) -> None:
    """Shows the scenario NAME live in a browser, in 3-D and with controls.

    Serves a page on this machine alone, and runs while it is open. Its controls pause, change
    speed and disturbance, push the robot, begin anew and stop; Ctrl-C stops, too.
    """
    from mirte_drake.live import watch as watch_scenario
    from mirte_drake.pacing import WireStopped, interruption
    from mirte_drake.scenario_file import load_scenario
    from mirte_drake.visualization.meshcat_server import local_meshcat

    if seed is not None:
        overrides = (*overrides, f"seed={seed}")
    scenario = load_scenario(name, (*robot, *overrides))
    meshcat = local_meshcat(port, show_rate=True)
    click.echo(f"Open {meshcat.web_url()} in a browser; Ctrl-C stops.")
    try:
        # A KeyboardInterrupt that comes while code is loaded can get lost.
        with interruption() as check:
            pace = watch_scenario(
                scenario,
                meshcat,
                background="dark" if dark else "light",
                ready=lambda: meshcat.GetNumActiveConnections() > 0,
                check=check,
            )
    except WireStopped:
        click.echo("Stopped.")
        return
    click.echo(f"Stopped after {pace.simulated:.1f} s at {pace.rate:.2f} of the wanted speed.")
