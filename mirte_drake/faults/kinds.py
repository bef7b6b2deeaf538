"""The table of kinds: what goes wrong, and what must come of it, stated beforehand."""

import signal

import numpy as np

from mirte_drake.errors import UserError
from mirte_drake.faults import odometry_faults as odometry
from mirte_drake.faults import sabotage
from mirte_drake.faults.bench import HUGE_COMMAND
from mirte_drake.faults.kind import (
    WITHIN_SIGNAL,
    Kind,
    Step,
    depends,
    drives_on,
    stops,
    yaw_crosses,
)
from mirte_drake.faults.oracle import (
    act_number,
    at_fault,
    frozen_odometry,
    last_good_odometry,
    last_heartbeat,
    off_reference,
    outside,
    swapped_odometry,
)
from mirte_drake.faults.sabotage import Sabotage
from mirte_drake.hardware.link import Role
from mirte_drake.hardware.messages import DriveCommand, Odometry, WheelCommand
from mirte_drake.scenario_file import load_scenario

SCENARIO = "rectangle"
_PATH = load_scenario(SCENARIO)
_POSES = _PATH.reference.poses(_PATH.period)  # type: ignore[union-attr]
X_MAX = _POSES[0, 0] + 0.1  # [m] Where the area ends that the robot leaves.
BABBLE = np.arange(0.0, 1.0, 0.037)  # [s] When messages without sense come.
STOPPED = 2.0  # [s] How long a process is stopped.

GOOD, OLD = "the last good odometry", "odometry is old"
ANSWERS_OLD = "command answers old odometry"  # Where the older of two came last.
SILENT = "controller is silent"
GUARD_GONE = "the guard has said nothing"


def _send(name: str, number: signal.Signals, after: float = 0.0) -> Step:
    return Step(lambda bench: bench.signal(name, number), after)


def _babble(kind: type) -> dict:
    steps = tuple(Step(lambda bench: bench.babble(), after) for after in BABBLE)
    return {"steps": steps, "strangers": (kind,)}


def _command(command: np.ndarray) -> dict:
    step = Step(lambda bench: bench.speak_for_controller(command))
    return {"steps": (step,), "strangers": (Role.CONTROLLER,)}


def _old_odometry(name: str, fault: odometry.OdometryFault, **more: object) -> Kind:
    return stops(name, GOOD, OLD, last_good_odometry, odometry=fault, **more)


def _late_odometry(name: str, fault: odometry.OdometryFault) -> Kind:
    when = f"{GOOD} where the next one is older than 0.25 s"
    return depends(name, when, (OLD, ANSWERS_OLD), swapped_odometry, odometry=fault, observe=2.0)


def _silent_controller(name: str, act: sabotage.Act) -> Kind:
    """Returns a kind in which two commands are more than 0.25 s apart."""
    return stops(name, "its last command", SILENT, last_heartbeat, sabotage=Sabotage(act))


_KINDS = (
    _old_odometry("odometry_stops", odometry.silent),
    stops(
        "odometry_freezes",
        "0.5 s of the same odometry and wheels that push",
        "odometry is frozen",
        frozen_odometry,
        odometry=odometry.frozen,
        observe=3.0,
    ),
    _old_odometry("odometry_repeats", odometry.repeated),
    drives_on("odometry_jumps_once", odometry=odometry.once(odometry.jumping)),
    _old_odometry("odometry_jumps", odometry.jumping),
    drives_on("odometry_nan_once", odometry=odometry.once(odometry.not_a_number)),
    _old_odometry("odometry_nan", odometry.not_a_number),
    _old_odometry("odometry_infinite", odometry.infinite),
    _old_odometry("odometry_huge", odometry.huge),
    _late_odometry("odometry_swapped", odometry.swapped),
    _old_odometry("odometry_old_stamps", odometry.old_stamps),
    drives_on("odometry_late_50ms", odometry=odometry.late_by(0.05, 0.05)),
    drives_on("odometry_late_0_100ms", odometry=odometry.late_by(0.0, 0.1), observe=2.0),
    _old_odometry("odometry_late_300ms", odometry.late_by(0.3, 0.3)),
    _late_odometry("odometry_late_0_500ms", odometry.late_by(0.0, 0.5)),
    drives_on("odometry_doubled", odometry=odometry.doubled),
    drives_on("odometry_one_lost", odometry=odometry.once(odometry.silent)),
    _late_odometry("odometry_half_lost", odometry.lost(0.5)),
    drives_on("yaw_at_pi", odometry=odometry.turned, from_start=True, evidence=yaw_crosses),
    drives_on("clock_1h_forward", odometry=odometry.clock_steps_by(3600.0)),
    _old_odometry("clock_1h_back", odometry.clock_steps_by(-3600.0)),
    drives_on("clock_50ms", odometry=odometry.clock_steps_by(0.05, either_way=True)),
    _old_odometry(
        "robot_restarts",
        odometry.silent,
        steps=(Step(lambda bench: bench.restart_robot(), 1.0),),
        observe=2.5,
    ),
    stops(
        "robot_leaves_area",
        "the first odometry outside",
        "outside the allowed area",
        outside(X_MAX),
        begin=(0.0, 0.0),
        overrides=(f"robot.governor.allowed_area=[-1, -1, {X_MAX}, 1]",),
        observe=2.5,
    ),
    stops(
        "robot_pushed_away",
        "the first odometry 0.5 m off the reference",
        "off the reference",
        off_reference(_POSES, _PATH.period),
        odometry=odometry.pushed,
        observe=3.0,
    ),
    stops(
        "controller_sigkill",
        "the signal",
        SILENT,
        at_fault,
        within=WITHIN_SIGNAL,
        steps=(_send("controller", signal.SIGKILL),),
    ),
    stops(
        "controller_sigstop",
        "the signal",
        SILENT,
        at_fault,
        within=WITHIN_SIGNAL,
        steps=(
            _send("controller", signal.SIGSTOP),
            _send("controller", signal.SIGCONT, STOPPED),
        ),
        observe=STOPPED + 1.0,
    ),
    stops(
        "controller_sigterm",
        "the signal",
        "interrupted",
        at_fault,
        steps=(_send("controller", signal.SIGTERM),),
    ),
    stops(
        "controller_raises",
        "the exception",
        "RuntimeError: sabotaged",
        act_number(1),
        sabotage=Sabotage(sabotage.throw),
    ),
    _silent_controller("controller_hangs", sabotage.hang),
    drives_on("solver_fails_twice", sabotage=Sabotage(sabotage.fail, times=2)),
    stops(
        "solver_fails",
        "the third failed solve in a row",
        "failed solves in a row",
        act_number(3),
        sabotage=Sabotage(sabotage.fail),
    ),
    drives_on("solves_take_80ms", sabotage=Sabotage(sabotage.take(0.08)), observe=2.0),
    _silent_controller("solves_take_150ms", sabotage.take(0.15)),
    _silent_controller("solves_take_400ms", sabotage.take(0.4)),
    stops(
        "solver_gives_nan",
        "the solve",
        "failed solves in a row",  # The limiter makes zeros of it, and no solve begins from it.
        act_number(1),
        sabotage=Sabotage(sabotage.give_nan),
    ),
    stops(
        "command_nan",
        "the command",
        "not a command",
        at_fault,
        **_command(np.full(4, np.nan)),
    ),
    drives_on("command_huge", **_command(HUGE_COMMAND)),
    stops(
        "guard_sigkill",
        "the signal",
        GUARD_GONE,
        at_fault,
        within=WITHIN_SIGNAL,
        steps=(_send("guard", signal.SIGKILL),),
        observe=2.0,  # The controller repeats its zeros before it ends.
    ),
    stops(
        "guard_sigstop",
        "the signal",
        (GUARD_GONE, "guard stalled"),
        at_fault,
        within=WITHIN_SIGNAL,
        steps=(_send("guard", signal.SIGSTOP), _send("guard", signal.SIGCONT, STOPPED)),
        observe=STOPPED + 1.0,
    ),
    stops(
        "guard_then_controller_killed",
        "the guard's SIGKILL",
        "",
        at_fault,
        within=WITHIN_SIGNAL,
        steps=(_send("guard", signal.SIGKILL), _send("controller", signal.SIGKILL, 0.4)),
    ),
    stops(
        "second_controller",
        "its command",
        "second controller",
        at_fault,
        steps=(Step(lambda bench: bench.speak_as_second_controller()),),
        strangers=(Role.CONTROLLER,),
    ),
    stops(
        "foreign_wheel_command",
        "its command",
        "another sender on the wheel topics",
        at_fault,
        steps=(Step(lambda bench: bench.command_wheels()),),
        strangers=(Role.GUARD,),
    ),
    drives_on("malformed_odometry", **_babble(Odometry)),
    drives_on("malformed_drive_command", **_babble(DriveCommand)),
    drives_on("malformed_wheel_command", **_babble(WheelCommand)),
    stops(
        "controller_lost",
        "its last command",
        SILENT,
        last_heartbeat,
        steps=(Step(lambda bench: bench.orders.deafen()),),
        deafens=True,
    ),
    stops(
        "operator_stops",
        "the request",
        "the operator asked for it",
        at_fault,
        steps=(Step(lambda bench: bench.ask_to_stop()),),
    ),
)
KINDS = {kind.name: kind for kind in _KINDS}


def find_kind(name: str) -> Kind:
    """Returns a kind by its name.

    Raises:
        UserError: when there is none.
    """
    if name not in KINDS:
        raise UserError(f"kind: there is no {name!r}; `mirte-drake faults --list` shows all")
    return KINDS[name]
