"""Guard and controller of a trial, each a process of its own that is forked ready to run.

They come from a fork server, which has imported everything and opened nothing: at the fork it has
one thread, no DDS participant, no LCM.
"""

import multiprocessing
import os
import signal
import sys
from contextlib import suppress
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext
from pathlib import Path

from pydrake.systems.framework import Diagram

from mirte_drake import drive as driving
from mirte_drake.control.nmpc_solver import make_nmpc_solver
from mirte_drake.faults.deaf_link import DeafLink
from mirte_drake.faults.sabotage import Orders, Sabotage, Saboteur
from mirte_drake.hardware.guard import run_guard
from mirte_drake.hardware.guard_process import GuardSetup, serve
from mirte_drake.hardware.link import Role
from mirte_drake.hardware.wire_config import open_link
from mirte_drake.scenario import Scenario, wired_robot
from mirte_drake.systems.nominal_nmpc import NominalNmpc
from mirte_drake.wire_session import wire_to

PRELOADED = ["mirte_drake.faults.preload"]
PRIORITY = 20  # In real time; above that of guards, who need some time to start in other trials.
LIFETIME = 30  # [s] Nobody is left behind should the trial die.


def fork_server() -> ForkServerContext:
    """Returns where processes come from."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    return context


def guard_process(scenario: Scenario, deafens: bool, orders: Orders) -> None:
    """Runs a guard, as `mirte-drake guard` does; one that ``deafens`` as soon as it is ordered."""
    _begin()
    robot = wired_robot(scenario)
    if not deafens:
        serve(GuardSetup(robot.wire, robot.governor, scenario.first_pose))
        return
    be_punctual(True)
    with open_link(robot.wire, Role.GUARD) as link:
        run_guard(DeafLink(link, orders), robot.governor, scenario.first_pose)


def controller_process(
    scenario: Scenario,
    own_guard: bool,
    sabotage: Sabotage | None,
    orders: Orders,
    told: Connection,
) -> None:
    """Drives a scenario, as `mirte-drake drive` does, and tells how it ended."""
    _begin()

    def prepare(diagram: Diagram) -> None:
        be_punctual(True)
        if sabotage is not None:
            nmpc = diagram.GetSubsystemByName("controller").GetSubsystemByName("nominal_nmpc")
            assert isinstance(nmpc, NominalNmpc)
            solver = make_nmpc_solver(nmpc.problem, scenario.nominal_nmpc.solver)
            nmpc.use_solver(Saboteur(solver, sabotage, orders))

    try:
        with wire_to(scenario, own_guard=own_guard) as (link, session):
            run = driving.drive(scenario, "faults", link, session, on_diagram=prepare)
        told.send(run.ended or "the path is at its end")
    except Exception as error:
        told.send(f"{type(error).__name__}: {error}")


def child_of(pid: int) -> int:
    """Returns the number of the only child of a process.

    Raises:
        RuntimeError: when it has none, or several.
    """
    children = [
        int(folder.name)
        for folder in Path("/proc").glob("[0-9]*")
        if _stat(folder)[1:2] == [f"{pid}"]
    ]
    if len(children) != 1:
        raise RuntimeError(f"process {pid} has {len(children)} children, not one")
    return children[0]


def is_alive(pid: int) -> bool:
    """Whether a process is there and has not ended."""
    return _stat(Path(f"/proc/{pid}"))[:1] not in ([], ["Z"])


def _stat(folder: Path) -> list[str]:
    """Returns state and parent of a process; nothing where there is none."""
    try:
        return (folder / "stat").read_text().rpartition(")")[2].split()[:2]
    except OSError:
        return []


def waiting_time(pid: int) -> float:
    """Returns how long [s] a process has been ready to run and got no processor so far."""
    try:
        return 1e-9 * int(Path(f"/proc/{pid}/schedstat").read_text().split()[1])
    except OSError:
        return 0.0


def be_quiet() -> None:
    """Lets this process, and those that it starts, say nothing: of a fault there is much to say."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())


def be_punctual(punctual: bool) -> None:
    """Keeps others from holding up the threads of this process, where it may, or lets them again.

    What else this machine does, other trials first of all, is no part of a trial.
    """
    policy, priority = (os.SCHED_RR, PRIORITY) if punctual else (os.SCHED_OTHER, 0)
    for thread in Path("/proc/self/task").iterdir():
        with suppress(OSError):
            os.sched_setscheduler(int(thread.name), policy, os.sched_param(priority))


def _begin() -> None:
    """Checks where this process comes from, and limits its life.

    Raises:
        RuntimeError: when the fork server has threads, which do not survive a fork.
    """
    signal.alarm(LIFETIME)
    status = Path(f"/proc/{os.getppid()}/status").read_text()
    threads = int(status.partition("Threads:")[2].split()[0])
    if threads != 1:
        raise RuntimeError(f"the fork server has {threads} threads; set OMP_NUM_THREADS=1")
