"""The report of one run, as a page that stands for itself."""

import dataclasses as dc
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from mirte_drake.visualization.figures import error_figure, input_figure, path_figure
from mirte_drake.visualization.page import Page
from mirte_drake.visualization.report_figures import (
    coverage_figure,
    solve_time_figure,
    tube_figure,
)

NBSP = "\u00a0"  # Between a number and its unit.
# [m, m, rad] of a summary's RMSE, and how reports print them.
POSE_KEYS, POSE_UNITS = ("x_m", "y_m", "yaw_rad"), ("mm", "mm", "mrad")

_WIRE = {  # What numbers of a wire mean.
    "ended": "why, where it was before its time",
    "command_latency": "from odometry to its command: median, 99 %, longest",
    "odometry_age": "when a command was computed from it: median, 99 %, longest",
    "missed_odometry": "samples to which none came in time",
}


@dc.dataclass(frozen=True)
class ReportedRun:
    """What a report knows of a run."""

    name: str
    description: str
    robot: str  # Its short name.
    controller: str  # In two words.
    # Of samples against what was predicted for them: errors, bounds, and which are beyond, all
    # (K - 1, n); n is 3, or 6 in the robot's frame with velocities. None: there is no tube.
    tube: tuple[np.ndarray, np.ndarray, np.ndarray] | None
    why_outside: str  # Why a sample may leave the tube.
    disturbance_bound: np.ndarray | None  # (3,) [m/s, m/s, rad/s] that coverage is judged by.
    period: float  # [s]
    input_limit: float  # [pwm]
    scenario: str  # YAML, as run.
    summary: Mapping[str, Any]  # As in summary.json.
    log: Mapping[str, np.ndarray]  # As in log.npz.
    saturation: float  # Share of the samples at which a wheel is at the limit.
    oscillation: float  # [1/s] Sign changes of a wheel command's increments, mean over wheels.

    @property
    def plans(self) -> bool:
        """Whether the controller plans, and so has a solver, a nominal path and bounds."""
        return "solver" in self.summary

    @property
    def successors(self) -> int:
        """Number of samples that have one before them, at least 1 to divide by."""
        return max(self.summary["steps"] - 1, 1)

    @property
    def odometry(self) -> bool:
        """Whether the pose was measured by something that errs."""
        true = self.summary["true_rmse"]
        return true is not None and true != self.summary["rmse"]


def run_report(run: ReportedRun, *, diagram: str, no_diagram: str = "", replay: str = "") -> str:
    """Returns the page.

    Args:
        run: The run.
        diagram: SVG of its Diagram; empty where there is none.
        no_diagram: Why there is none.
        replay: The page of its replay in three dimensions; empty where there is none.
    """
    page = Page()
    steps, time = run.summary["steps"], run.summary["simulated_time_s"]
    picture = page.picture(diagram, f"Diagram of {run.name}") if diagram else ""
    controller = f"{run.controller[0].upper()}{run.controller[1:]}"
    solver = f", solver {run.summary['solver']}" if run.plans else ""
    return page.render(
        "run.html",
        kicker="mirte_drake: report of a run",
        title=run.name,
        description=run.description.rstrip("."),
        setting=f"{controller} on the {run.robot} robot{solver}; "
        f"{steps} samples in {time:.1f} s, seed {run.summary['seed']}.",
        ended=run.summary.get("wire", {}).get("ended", ""),
        command="drive" if "wire" in run.summary else "simulate",
        headline=_headline(run),
        figures=_figures(page, run),
        diagram=picture,
        no_diagram=no_diagram,
        numbers=_numbers(run),
        replay=replay,
        scenario=run.scenario,
        versions=run.summary["versions"],
    )


def rmse_texts(rmse: Mapping[str, float]) -> list[str]:
    """Returns the entries of an RMSE [m, m, rad] in mm and mrad, without their units."""
    return [f"{1e3 * rmse[key]:.1f}" for key in POSE_KEYS]


def _headline(run: ReportedRun) -> list[dict[str, str]]:
    true = rmse_texts(run.summary["true_rmse"]) if run.odometry else None
    items = []
    measured = zip(("x", "y", "yaw"), rmse_texts(run.summary["rmse"]), POSE_UNITS, strict=True)
    for entry, (label, value, unit) in enumerate(measured):
        note = "against the reference" if run.summary["true_rmse"] else "measured by odometry"
        note = f"measured; truly {true[entry]}{NBSP}{unit}" if true else note
        items.append(_item(f"RMSE {label}", f"{value}{NBSP}{unit}", note))
    return items + (_plan_headline(run) if run.plans else [])


def _plan_headline(run: ReportedRun) -> list[dict[str, str]]:
    """Returns what a controller that plans adds to the headline."""
    summary, samples, items = run.summary, run.successors, []
    if run.tube:
        outside = summary["successor_violations"]
        share = f"{100 * (1 - outside / samples):.1f} %"
        items.append(_item("Next sample in the tube", share, f"outside at {outside} of {samples}"))
    else:
        items.append(_item("Next sample in the tube", "no tube", run.controller))
    solve = summary["solve_time_ms"]
    note = f"longest {_ms(solve['max'])} of {1e3 * run.period:g}{NBSP}ms"
    items.append(_item("Solve time, median", _ms(solve["p50"]), note))
    failures = summary["solve_failures"]
    mood = "bad" if failures else "good"
    items.append(_item("Failed solves", str(failures), f"of {summary['steps']}", mood))
    return items


def _item(label: str, value: str, note: str, mood: str = "") -> dict[str, str]:
    return {"label": label, "value": value, "note": note, "mood": mood}


def _figures(page: Page, run: ReportedRun) -> list[dict[str, str]]:
    log = run.log
    paths = "Reference, nominal and actual path" if run.plans else "Reference and actual path"
    drawn: list[tuple[str, Callable[[], Figure]]] = [
        (paths + (", and the tube." if run.tube else "."), lambda: path_figure(log)),
        ("Tracking error: pose minus reference.", lambda: error_figure(log)),
    ]
    if run.plans:
        drawn.append((
            "Solve time of every sample, against the period that it must fit in.",
            lambda: solve_time_figure(log, run.period),
        ))  # fmt: skip
    if tube := run.tube:
        what = "Estimated pose and velocity" if "state" in log else "Pose"
        frame = ", in the robot's frame" if "error_bound" in log else ""
        drawn += [
            (
                f"{what} minus the prediction of one sample before{frame}, and the tube that "
                "should hold that.",
                lambda: tube_figure(log["time"], *tube),
            ),
            (
                "Wheel commands: the nominal ones stay within the tightened bounds; the ancillary "
                "law adds to them what is applied.",
                lambda: input_figure(log, run.input_limit),
            ),
        ]
    else:
        drawn.append(("Wheel commands.", lambda: input_figure(log, run.input_limit)))
    coverage, in_use = run.summary.get("coverage"), run.disturbance_bound
    if coverage is not None and in_use is not None:
        drawn.append((
            "Share of the last one-step errors that the disturbance set in use held, and the set "
            "that is calibrated while driving; below, how large that is.",
            lambda: coverage_figure(log, coverage["target"], in_use),
        ))  # fmt: skip
    return [{"caption": caption, "svg": page.plot(draw, caption)} for caption, draw in drawn]


def _numbers(run: ReportedRun) -> list[dict[str, str]]:
    summary = run.summary
    rows = [
        ("RMSE, measured pose", _pose(summary["rmse"]), "x, y, yaw against the reference"),
        ("RMSE, true pose", _pose(summary["true_rmse"]), "where the robot really was"),
        *(_plan_numbers(run) if run.plans else []),
        *_coverage_numbers(summary.get("coverage")),
    ]
    for key, value in summary.get("wire", {}).items():
        label = key.removesuffix("_ms")
        text = _times(value) if isinstance(value, Mapping) else value
        rows.append((label.replace("_", " "), text or "-", _WIRE.get(label, "on the wire")))
    rows.append(("wall time", f"{summary['wall_time_s']:.1f} s", "of the run, without its figures"))
    return [
        {"label": label, "value": str(value), "meaning": meaning} for label, value, meaning in rows
    ]


def _plan_numbers(run: ReportedRun) -> list[tuple[str, Any, str]]:
    """Returns what a controller that plans adds to the numbers."""
    summary, samples, limit = run.summary, "samples", f"{run.input_limit:g} %"
    solve, feedback = summary["solve_time_ms"], summary["feedback_time_ms"]
    rows = [
        ("solve time", _times(solve), "median, 99 %, longest"),
        ("from pose to plan", _times(feedback), "what of it comes after the measurement"),
        ("failed solves", summary["solve_failures"], "the previous plan, moved on, served instead"),
        ("ended early", summary["early_solves"], "solves that reached their time limit"),
        ("rate bound relaxed", summary["rate_relaxations"], "where tightened bounds contradict it"),
        ("rate bound violated", summary["rate_violations"], f"{samples}, beyond rounding"),
        ("input set violated", summary["input_violations"], f"{samples} that asked beyond {limit}"),
    ]
    if run.tube:
        rows += [
            (
                "pose outside the tube",
                summary["tube_violations"],
                f"{samples}; none by construction, since the solver places the nominal pose so",
            ),
            (
                "next sample outside the tube",
                summary["successor_violations"],
                f"{samples}; {run.why_outside}",
            ),
        ]
    return rows


def _coverage_numbers(coverage: Mapping[str, Any] | None) -> list[tuple[str, Any, str]]:
    """Returns what a coverage monitor adds to the numbers."""
    if coverage is None:
        return []
    warnings = coverage["warnings"]
    sets = (
        ("in_use", "set in use", "of the one-step errors"),
        ("calibrated", "calibrated set", f"on average over time; target {coverage['target']:.0%}"),
    )
    rows: list[tuple[str, Any, str]] = []
    for key, label, meaning in sets:
        share = coverage[key]
        rows.append((f"held by the {label}", "-" if share is None else f"{share:.1%}", meaning))
        note = "samples at which its running coverage was out of its band"
        rows.append((f"warnings, {label}", warnings[key], note))
    return rows


def _pose(rmse: Mapping[str, float] | None) -> str:
    if rmse is None:
        return "unknown"
    values = zip(rmse_texts(rmse), POSE_UNITS, strict=True)
    return ", ".join(f"{value} {unit}" for value, unit in values)


def _times(times: Mapping[str, float]) -> str:
    return ", ".join(f"{times[key]:.2f}" for key in ("p50", "p99", "max")) + " ms"


def _ms(value: float) -> str:
    return f"{value:.2f}{NBSP}ms" if value < 10 else f"{value:.0f}{NBSP}ms"
