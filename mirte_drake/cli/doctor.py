"""The command that looks this machine over."""

import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

import click

from mirte_drake.cli.options import commands, fail

if TYPE_CHECKING:
    from mirte_drake.doctor.finding import Finding


@commands.command()
def doctor() -> None:
    """Says what is there on this machine, what is missing, and what to do about it.

    Python and packages, solvers, where compiled code is kept, optional parts, the wires, and
    whether it keeps the sample time. Ends with 1 where something is BAD; - marks what not
    everybody needs.
    """
    from mirte_drake.doctor.finding import Grade, text

    bad = []
    for finding in _findings():
        click.echo(text(finding))
        if finding.grade is Grade.BAD:
            bad.append(finding.what)
    if bad:
        fail(f"{', '.join(bad)}: see the remedies above")


def _findings() -> Iterator["Finding"]:
    from mirte_drake.doctor.finding import Grade
    from mirte_drake.doctor.packages import check_packages

    packages = list(check_packages())
    yield from packages
    if any(finding.grade is Grade.BAD for finding in packages):
        return  # What follows needs them.
    from mirte_drake.doctor.parts import check_compiled, check_solvers, check_wires
    from mirte_drake.doctor.timing import (
        check_solves,
        check_threads,
        check_timer,
        timing_scenario,
    )

    yield from check_solvers()
    yield check_compiled()
    yield from check_wires()
    scenario = timing_scenario()
    yield check_threads()
    yield check_timer(scenario.period)
    with click.progressbar(length=scenario.steps, label="solves", file=sys.stderr) as bar:
        solves = check_solves(scenario, on_sample=lambda: bar.update(1))
    yield solves
