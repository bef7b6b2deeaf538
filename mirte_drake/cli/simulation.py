"""Commands that run and draw scenarios."""

import sys
from pathlib import Path

import click

from mirte_drake.cli.options import (
    commands,
    output_option,
    robot_option,
    set_option,
    transport_option,
    wire_option,
)


@commands.command()
def scenarios() -> None:
    """Lists the scenarios that come with the package."""
    from mirte_drake.scenario_file import load_scenario, scenario_names

    for name in scenario_names():
        click.echo(f"{name:28}{load_scenario(name).description}")


@commands.command()
@click.argument("name")
@click.option(
    "--seed", type=click.IntRange(min=0), help="Of the disturbance and of the odometry's jitter."
)
@robot_option
@set_option
@click.option("--no-plots", is_flag=True, help="Leaves figures and report out.")
@click.option("--replay", is_flag=True, help="Makes a page that plays the run in 3-D, too.")
@output_option
def simulate(
    name: str,
    seed: int | None,
    robot: tuple[str, ...],
    overrides: tuple[str, ...],
    no_plots: bool,
    replay: bool,
    output: Path | None,
) -> None:
    """Runs the scenario NAME, or the one in a YAML file, and writes what came out.

    Writes summary.json, log.npz, the scenario as it was run, figures as PDF, SVG and PNG, and
    report.html, which has all of it in one page.
    """
    from mirte_drake.files import replacing_results
    from mirte_drake.reporting import REPORT_FILE, save_report
    from mirte_drake.run import simulate as run_scenario
    from mirte_drake.run_summary import REPLAY_FILE, RUN_FILES, save_run
    from mirte_drake.scenario_file import load_scenario, scenario_stem
    from mirte_drake.visualization.figures import FIGURE_FILES, save_figures

    if seed is not None:
        overrides = (*overrides, f"seed={seed}")
    scenario = load_scenario(name, (*robot, *overrides))
    stem = scenario_stem(name)
    folder = output or Path("runs") / stem
    owned = (*RUN_FILES, *FIGURE_FILES, REPLAY_FILE, REPORT_FILE)
    with replacing_results(folder, owned) as results:
        with click.progressbar(length=scenario.steps, label=stem, file=sys.stderr) as bar:
            run = run_scenario(scenario, stem, on_sample=lambda: bar.update(1))
        summary = save_run(run, results)
        if not no_plots:
            save_figures(run.log, results, input_limit=scenario.input_limit)
        if replay:
            from mirte_drake.replay import write_replay

            write_replay(results, results / REPLAY_FILE)
        if not no_plots:
            save_report(results)  # Has the replay in it.
    click.echo(summary_table(summary, tube=scenario.has_tube))
    click.echo(f"Written to {folder}")


@commands.command()
@click.argument("name", required=False)
@click.option("--all", "everything", is_flag=True, help="Draws every scenario of the package.")
@click.option(
    "--depth",
    type=click.IntRange(min=1),
    default=2,
    show_default=True,
    help="1 draws the controller as one block, 2 looks into it.",
)
@robot_option
@transport_option
@wire_option
@set_option
@output_option
def diagram(
    name: str | None,
    everything: bool,
    depth: int,
    robot: tuple[str, ...],
    transport: tuple[str, ...],
    wire: tuple[str, ...],
    overrides: tuple[str, ...],
    output: Path | None,
) -> None:
    """Draws the Diagram of the scenario NAME: NAME.svg, NAME.png and NAME.dot.

    The SVG adapts itself to a light or a dark screen.
    """
    from mirte_drake.assembly import MakeDiagram
    from mirte_drake.scenario_file import load_scenario, scenario_names, scenario_stem
    from mirte_drake.visualization.diagram_picture import save_diagram_picture

    if (name is None) != everything:
        raise click.UsageError("give the NAME of a scenario, or --all")
    for each in scenario_names() if name is None else [name]:
        scenario = load_scenario(each, (*robot, *transport, *overrides, *wire))
        stem = (output or Path("diagrams")) / scenario_stem(each)
        for path in save_diagram_picture(MakeDiagram(scenario), stem, depth):
            click.echo(path)


def summary_table(summary: dict, tube: bool) -> str:
    """Returns the summary for a person to read."""
    rmse, true = summary["rmse"], summary["true_rmse"]

    def error(key: str, unit: str) -> str:
        really = f", true {true[key]:.4f} {unit}" if true else ""
        return f"{rmse[key]:.4f} {unit}{really}"

    rows = [
        ("scenario", f"{summary['scenario']}, seed {summary['seed']}"),
        ("samples", f"{summary['steps']} ({summary['simulated_time_s']:.1f} s)"),
        ("RMSE x", error("x_m", "m")),
        ("RMSE y", error("y_m", "m")),
        ("RMSE yaw", error("yaw_rad", "rad")),
        *(_plan_rows(summary, tube) if "solver" in summary else []),
        *_coverage_rows(summary.get("coverage")),
        *_wire_rows(summary.get("wire")),
        ("wall time", f"{summary['wall_time_s']:.1f} s"),
    ]
    return "\n".join(f"{label:22}{value}" for label, value in rows)


def _plan_rows(summary: dict, tube: bool) -> list[tuple[str, str]]:
    """Returns what a controller that plans adds to the table."""
    solve, feedback = summary["solve_time_ms"], summary["feedback_time_ms"]
    return [
        ("solver", f"{summary['solver']}, {summary['solve_failures']} failures"),
        (
            "solve time",
            f"{solve['p50']:.2f} ms median, {solve['p99']:.2f} ms p99, {solve['max']:.2f} ms max",
        ),
        ("from pose to plan", f"{feedback['p50']:.2f} ms median, {feedback['p99']:.2f} ms p99"),
        ("outside the tube", f"{summary['tube_violations']} samples" if tube else "no tube"),
        ("successor outside", f"{summary['successor_violations']} samples" if tube else "no tube"),
        ("input set violated", f"{summary['input_violations']} samples"),
        (
            "rate bound violated",
            f"{summary['rate_violations']} samples, {summary['rate_relaxations']} to meet bounds",
        ),
        ("ended early", f"{summary['early_solves']} solves"),
    ]


def _coverage_rows(coverage: dict | None) -> list[tuple[str, str]]:
    """Returns what a coverage monitor adds to the table; a warning names its remedy."""
    if coverage is None or coverage["in_use"] is None:
        return []
    target = f"{coverage['target']:.0%}"
    held = f"{coverage['in_use']:.1%} of one-step errors, calibrated {coverage['calibrated']:.1%}"
    rows = [("held by the set", f"{held} (target {target})")]
    if warnings := coverage["warnings"]["in_use"]:
        text = f"set in use held less than {target} in the last window at {warnings} samples"
        rows.append(("warning", f"{text}: widen it, or use the calibrated one"))
    return rows


def _wire_rows(wire: dict | None) -> list[tuple[str, str]]:
    """Returns what a wire adds to the table."""
    if wire is None:
        return []
    latency, age = wire["command_latency_ms"], wire["odometry_age_ms"]
    return [
        ("odometry to command", f"{latency['p50']:.2f} ms median, {latency['p99']:.2f} ms p99"),
        ("age of odometry", f"{age['p50']:.2f} ms median, {age['p99']:.2f} ms p99"),
        ("missed odometry", f"{wire['missed_odometry']} samples"),
    ]
