"""Figures 4-2, 4-3 and 5-2 to 5-5: the controller in closed loop."""

import functools
from typing import Any

import numpy as np

from mirte_drake.angles import pose_error
from mirte_drake.run import Run, simulate
from mirte_drake.run_summary import summarise
from mirte_drake.scenario_file import load_scenario
from mirte_drake.thesis.published import CLAIM, RUN_TIME, YAW_ERROR
from mirte_drake.visualization.comparison_figures import (
    commands_figure,
    errors_figure,
    paths_figure,
)
from mirte_drake.visualization.figures import error_figure, input_figure, path_figure
from mirte_drake.visualization.thesis_page import Table, ThesisFigure

# For fmincon of chapter 4 a general solver of nonlinear programs that is a sequential quadratic
# one too, for acados of chapter 5 one made for the sample time.
SOLVERS = {"4": "snopt", "5": "realtime"}
STUDIES = {"4-2": "rectangle", "4-3": "circle", "5-2": "rectangle", "5-3": "circle"}
# No recording of the experiments is known. Nearest is the robot of rigid bodies, with the motors
# that were chosen to drift as the thesis's robot did.
EXPERIMENTS = {"5-4": "robot_rectangle", "5-5": "robot_circle"}
_ROBOT = "robot=!MultibodyRobotConfig {motors: drifting}"
_PATHS = {"rectangle": "rectangular", "circle": "circular"}


def simulated_figure(number: str) -> ThesisFigure:
    """Returns one of the figures of ``STUDIES`` or ``EXPERIMENTS``."""
    return _study(number) if number in STUDIES else _experiment(number)


@functools.cache
def _run(scenario: str, *overrides: str) -> Run:
    """Runs a scenario with its seed of 0; figures share runs."""
    return simulate(load_scenario(scenario, overrides), scenario)


def _study(number: str) -> ThesisFigure:
    name, solver = STUDIES[number], SOLVERS[number[0]]
    run = _run(name, f"nominal_nmpc.solver={solver}")
    log, limit = run.log, run.scenario.input_limit
    summary: dict[str, Any] = summarise(run)
    yaw = np.abs(pose_error(log["pose"], log["reference"])[:, 2]).max()
    most = np.abs(log["applied_input"]).max()
    ours = (
        f"scenario {name}, solver {solver}, seed {run.scenario.seed}: RMSE {_rmse(summary)}; yaw "
        f"within {yaw:.3f} rad; wheel commands up to {most:.0f} % PWM; the next pose outside "
        f"the tube at {summary['successor_violations']} of {summary['steps'] - 1} samples. All "
        f"solves take {log['solve_time_s'].sum():.2f} s together on this machine."
    )
    time = f"a run time of {RUN_TIME[number]} s on another."
    if number in YAW_ERROR:
        said = f"yaw within about {YAW_ERROR[number]} rad and, by fmincon, {time}"
    else:
        other = _run(name, f"nominal_nmpc.solver={SOLVERS['4']}")
        x, y, _ = np.abs(pose_error(log["pose"], other.log["pose"])).max(axis=0)
        ours += (
            f" Both of our solvers find the same optimum: the path differs from that of 4-"
            f"{number[-1]} by at most {1e3 * max(x, y):.2f} mm."
        )
        said = f"by acados, {time} It says: {CLAIM[number]}"
    return ThesisFigure(
        number,
        f"Tube-based NMPC for a {_PATHS[name]} path with constant heading",
        {
            "a": ("Path and tube.", lambda: path_figure(log)),
            "b": ("Tracking errors.", lambda: error_figure(log)),
            "c": ("Wheel commands and bounds.", lambda: input_figure(log, limit)),
        },
        ours=ours,
        published="model, weights, bounds, path and disturbance bound, not the disturbance itself; "
        + said,
    )


def _experiment(number: str) -> ThesisFigure:
    name = EXPERIMENTS[number]
    runs = {"tube-based NMPC": _run(name, _ROBOT), "NMPC": _run(f"baseline_{name}", _ROBOT)}
    logs = {label: [run.log] for label, run in runs.items()}
    rows = []
    for label, run in runs.items():
        summary: dict[str, Any] = summarise(run)
        rows.append([label, *_values(summary["rmse"]), *_values(summary["true_rmse"])])
    return ThesisFigure(
        number,
        f"Tube-based NMPC and NMPC for a {_PATHS[name.removeprefix('robot_')]} path with constant "
        "heading",
        {
            "a": ("Measured paths.", lambda: paths_figure(logs)),
            "b": ("Tracking errors of the measured pose.", lambda: errors_figure(logs)),
            "c": ("Applied wheel commands.", lambda: commands_figure(logs)),
        },
        ours=f"a simulation, not the experiment, of which no recording is known: scenarios {name} "
        f"and baseline_{name} on the multibody robot with motors chosen to drift as the thesis's "
        "robot did. The pose is measured by odometry, as in the experiment; true is where the "
        "robot really was.",
        published="settings and path; the experiment on the robot is not drawn here. It says: "
        + CLAIM[number],
        table=Table(
            ("RMSE", "x [mm]", "y [mm]", "θ [mrad]", "true x [mm]", "true y [mm]", "true θ [mrad]"),
            rows,
        ),
    )


def _values(rmse: dict[str, float]) -> list[str]:
    return [f"{1e3 * value:.0f}" for value in rmse.values()]


def _rmse(summary: dict[str, Any]) -> str:
    x, y, yaw = (f"{1e3 * value:.1f}" for value in summary["rmse"].values())
    return f"{x} mm, {y} mm, {yaw} mrad"
