"""The command that measures the solvers of the controller's optimal control problem."""

import os
import sys
from pathlib import Path

import click

from mirte_drake.cli.options import commands, output_option, set_option


@commands.command()
@click.argument("name", default="rectangle")
@click.option(
    "--problems",
    type=click.IntRange(min=1),
    help="Logged problems to solve; 100, or 10 with --quick.",
)
@click.option(
    "--repeats", type=click.IntRange(min=1), help="Rounds over the problems; 10, or 2 with --quick."
)
@click.option(
    "--solver",
    "solvers",
    multiple=True,
    metavar="SOLVER",
    help="A solver to measure instead of all that are installed. May be given many times.",
)
@click.option("--quick", is_flag=True, help="Measures little, in seconds: to see that it works.")
@set_option
@click.option("--no-plots", is_flag=True, help="Leaves the figure out.")
@output_option
def benchmark(
    name: str,
    problems: int | None,
    repeats: int | None,
    solvers: tuple[str, ...],
    quick: bool,
    overrides: tuple[str, ...],
    no_plots: bool,
    output: Path | None,
) -> None:
    """Times every solver on the problems of the scenario NAME, by default the study's rectangle.

    The controller's own solvers and, when installed, CasADi's (pip install
    mirte-drake[benchmark]): on the same logged problems, back to back and after pauses, in the
    same closed loop, over the horizon and the number of states, and from a fresh process. Writes
    benchmark.json and a figure as PDF, SVG and PNG.
    """
    import dataclasses as dc

    from mirte_drake.benchmark.report import REPORT_FILE, report
    from mirte_drake.benchmark.solvers import available_solvers, check_solvers, has_casadi
    from mirte_drake.benchmark.study import (
        QUICK,
        BenchmarkSettings,
        progress_length,
        run_benchmark,
    )
    from mirte_drake.benchmark.table import table
    from mirte_drake.files import replacing_results, write_json
    from mirte_drake.scenario import load_planning_model
    from mirte_drake.scenario_file import load_scenario, scenario_stem
    from mirte_drake.visualization.benchmark_figure import BENCHMARK_FILES, save_benchmark_figure

    scenario = load_scenario(name, overrides)
    model = load_planning_model(scenario)
    names = check_solvers(solvers, model) if solvers else available_solvers(model)
    settings = QUICK if quick else BenchmarkSettings()
    settings = dc.replace(
        settings,
        problems=problems or settings.problems,
        repeats=repeats or settings.repeats,
    )
    stem = scenario_stem(name)
    folder = output or Path("runs") / f"benchmark_{stem}"
    with replacing_results(folder, (REPORT_FILE, *BENCHMARK_FILES)) as results:
        length = progress_length(settings, scenario, len(names))
        with click.progressbar(length=length, label=stem, file=sys.stderr) as bar:
            measured = run_benchmark(scenario, stem, names, settings, bar.update)
        summary = report(measured)
        write_json(summary, results / REPORT_FILE)
        if not no_plots:
            save_benchmark_figure(
                {solver: row.solve_time for solver, row in measured.solves.items()},
                {solver: row.after_pause for solver, row in measured.solves.items()},
                measured.period,
                measured.horizons.sizes,
                measured.horizons.solve_time,
                results,
            )
    click.echo(table(summary))
    if os.environ.get("OMP_NUM_THREADS") != "1":
        click.echo("OMP_NUM_THREADS is not 1: set it, that every solver has one thread.")
    if not has_casadi():
        click.echo("Without CasADi; to compare with it: pip install mirte-drake[benchmark]")
    click.echo(f"Written to {folder}")
