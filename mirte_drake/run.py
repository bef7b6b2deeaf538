"""One run: build, simulate, log, summarise, save."""

import dataclasses as dc
import importlib.metadata
import platform
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram

import mirte_drake
from mirte_drake.angles import pose_error
from mirte_drake.assembly import MakeDiagram
from mirte_drake.control.dlqr import DlqrDesign
from mirte_drake.control.lagged_law import tracking_error
from mirte_drake.control.plan import Plan, SolveStatus
from mirte_drake.controllers.lagged_controller import ESTIMATES
from mirte_drake.controllers.parts import COVERAGE
from mirte_drake.files import replacing, write_json
from mirte_drake.pacing import Pace, WireStopped
from mirte_drake.scenario import Scenario, check_simulated
from mirte_drake.systems.nominal_nmpc import NominalNmpc
from mirte_drake.typed_yaml import write_typed
from mirte_drake.vectors import POSE, POSE_SIZE

ROUNDING = 1e-9  # [m, rad, pwm] Where the controller meets a bound exactly.

RUN_FILES = ("log.npz", "summary.json", "as_run.scenario.yaml")
REPLAY_FILE = "replay.html"  # What ``replay`` makes of them.


@dc.dataclass(frozen=True)
class Run:
    """What one run gave: arrays with one row per sample, and how it came about."""

    name: str
    scenario: Scenario
    log: dict[str, np.ndarray]
    rate_limit: np.ndarray | None  # (4,) [pwm_per_sample] of the plan; None without one.
    wall_time: float  # [s]
    ended: str = ""  # Why it ended before its time; empty: it did not.


def simulate(scenario: Scenario, name: str, on_sample: Callable[[], object] = lambda: None) -> Run:
    """Simulates a scenario and logs every sample.

    Args:
        scenario: What to run.
        name: Name for the summary.
        on_sample: Called after each sample, for a progress bar.

    Raises:
        UserError: when its robot is beyond a wire.
        ValueError: when the scenario cannot be built; UserError is one.
    """
    check_simulated(scenario)
    return run_diagram(MakeDiagram(scenario), scenario, name, on_sample)


def run_diagram(
    diagram: Diagram,
    scenario: Scenario,
    name: str,
    on_sample: Callable[[], object] = lambda: None,
    pace: Pace | None = None,
) -> Run:
    """Runs the Diagram of a scenario and logs every sample; see ``simulate``.

    Args:
        diagram: As ``MakeDiagram`` builds it.
        scenario: The scenario.
        name: Name for the summary.
        on_sample: Called after each sample.
        pace: What makes samples come; None: simulated time. Where it raises WireStopped the run
            ends with the samples that it has.
    """
    start = time.perf_counter()
    rows: list[dict[str, object]] = []
    ended = ""
    try:
        for context, more in samples(diagram, scenario, pace):
            rows.append({**_sample(diagram, context), **more})
            on_sample()
    except WireStopped as stop:
        ended = str(stop)
    log = {key: np.array([row[key] for row in rows]) for key in rows[0]} if rows else {}
    rate_limit = None
    if diagram.HasOutputPort("plan"):
        nmpc = diagram.GetSubsystemByName("controller").GetSubsystemByName("nominal_nmpc")
        assert isinstance(nmpc, NominalNmpc)
        rate_limit = nmpc.problem.rate_limit
    wall_time = time.perf_counter() - start
    return Run(name, scenario, log, rate_limit, wall_time, ended)


def samples(
    diagram: Diagram, scenario: Scenario, pace: Pace | None = None
) -> Iterator[tuple[Context, Mapping[str, object]]]:
    """Runs the Diagram of a scenario and yields at every sample its Context and more to log.

    In the Context the updates of that instant are done, so that plan and command are those that
    follow from the measured pose. The true pose, where the robot gives one, and the reference are
    from before them: they take a robot with discrete states and a reference with a state on to
    the next step.
    """
    pace = pace or Pace()
    simulator = Simulator(diagram)
    simulator.get_mutable_integrator().set_target_accuracy(scenario.accuracy)
    context = simulator.get_mutable_context()
    for k in range(scenario.steps):
        pace.before(context)
        if k == 0:
            simulator.Initialize()  # Takes in what came over a wire before.
        else:
            simulator.AdvanceTo(k * scenario.period)
        more = {"reference": diagram.GetOutputPort("reference").Eval(context)}
        if diagram.HasOutputPort("true_pose"):
            more["true_pose"] = diagram.GetOutputPort("true_pose").Eval(context)
        simulator.AdvancePendingEvents()
        yield context, {**more, **pace.after(context)}


def _sample(diagram: Diagram, context: Context) -> dict[str, object]:
    def evaluate(port: str) -> object:
        return diagram.GetOutputPort(port).Eval(context)

    disturbed = diagram.HasOutputPort("disturbance")
    sample = {
        "time": context.get_time(),
        "pose": evaluate("pose"),
        "applied_input": evaluate("wheel_command"),
        "disturbance": evaluate("disturbance") if disturbed else np.zeros(POSE_SIZE),
    }
    if not diagram.HasOutputPort("plan"):
        return sample
    plan = evaluate("plan")
    assert isinstance(plan, Plan)
    gain = np.zeros((plan.inputs.shape[1], POSE_SIZE))
    if diagram.HasOutputPort("designs"):
        designs: tuple[DlqrDesign, ...] = evaluate("designs")  # type: ignore[assignment]
        gain = designs[0].gain
    more = {port: evaluate(port) for port in (*COVERAGE, *ESTIMATES) if diagram.HasOutputPort(port)}
    if diagram.HasOutputPort("reached"):
        more["reached"] = evaluate("reached")[0]  # type: ignore[index]
    if diagram.HasOutputPort("state"):
        more["nominal_next_velocity"] = plan.nominal_next[POSE_SIZE:]
    return {
        **sample,
        "nominal_pose": plan.nominal_state[POSE],
        "nominal_next": plan.nominal_next[POSE],
        "nominal_plan": plan.inputs,
        "nominal_input": plan.nominal_input,
        "gain": gain,
        "half_width": plan.data.half_width[POSE],
        "input_lower": plan.data.input_lower[0],
        "input_upper": plan.data.input_upper[0],
        "solve_time_s": plan.solve_time,
        "preparation_time_s": plan.preparation_time,
        "iterations": plan.iterations,
        "status": int(plan.status),
        **more,
    }


def summarise(run: Run) -> dict[str, object]:
    """Returns the summary of a run, as written to ``summary.json``.

    Of a controller that does not plan, it has nothing about solver, tube and bounds.
    """
    log = run.log
    return {
        "scenario": run.name,
        "seed": run.scenario.seed,
        "steps": len(log["time"]),
        "simulated_time_s": float(log["time"][-1]),
        "wall_time_s": run.wall_time,
        "rmse": _rmse(log["pose"], log["reference"]),
        "true_rmse": _rmse(log["true_pose"], log["reference"]) if "true_pose" in log else None,
        **(_plan_summary(run) if "nominal_plan" in log else {}),
        **({"wire": _wire_summary(run)} if "command_latency_s" in log else {}),
        "versions": versions(),
    }


def _plan_summary(run: Run) -> dict[str, object]:
    """Returns what a controller that plans adds to the summary of a run."""
    log, limit = run.log, run.scenario.input_limit
    assert run.rate_limit is not None
    planned_from = planned_pose(log)
    deviation = pose_error(planned_from, log["nominal_pose"])
    # What the ancillary law asked for: what is applied has been saturated.
    correction = np.einsum("kij,kj->ki", log["gain"], deviation)
    stopping = log["status"][:, None] == SolveStatus.STOPPING
    asked = log["nominal_input"] - np.where(stopping, 0.0, correction)
    beyond = np.abs(asked) > limit + ROUNDING
    if "reached" in log:
        beyond |= log["reached"][:, None] < 1.0
    statuses = [SolveStatus(status) for status in log["status"]]
    moves = np.abs(np.diff(log["nominal_input"], axis=0, prepend=0.0))
    return {
        "solve_time_ms": _percentiles(log["solve_time_s"]),
        "feedback_time_ms": _percentiles(log["solve_time_s"] - log["preparation_time_s"]),
        "solver": run.scenario.nominal_nmpc.solver,
        "solve_failures": sum(status.failed for status in statuses),
        "rate_relaxations": sum(status.relaxed for status in statuses),
        "early_solves": sum(status.early for status in statuses),
        "tube_violations": _count(np.abs(deviation) > log["half_width"] + ROUNDING),
        "successor_violations": int(np.sum(successor_outside(log))),
        "input_violations": _count(beyond),
        "rate_violations": _count(moves > run.rate_limit + ROUNDING),
        **({"coverage": _coverage_summary(run)} if "coverage" in log else {}),
    }


def _coverage_summary(run: Run) -> dict[str, object]:
    """Returns what a coverage monitor adds to the summary of a run.

    Shares of the one-step errors that the set in use and the calibrated set held, each judged by
    the set as it was before the error.
    """
    log, config, in_use = run.log, run.scenario.coverage_monitor, run.scenario.disturbance_bound
    assert config is not None and in_use is not None
    known = np.all(np.isfinite(log["pose"]), axis=1)
    seen = known[1:] & known[:-1]
    error, bound = np.abs(log["prediction_error"][1:][seen]), log["calibrated_bound"][:-1][seen]
    warnings = np.sum(log["coverage_warning"], axis=0)
    return {
        "target": config.target,
        "in_use": _share(np.all(error <= in_use, axis=1)),
        "calibrated": _share(np.all(error <= bound, axis=1)),
        "beyond_cap": _count(error > config.cap * in_use),
        "mean_calibrated_bound": np.mean(log["calibrated_bound"], axis=0).tolist(),
        "warnings": {"in_use": int(warnings[0]), "calibrated": int(warnings[1])},
    }


def _share(held: np.ndarray) -> float | None:
    return float(np.mean(held)) if len(held) else None


def planned_pose(log: dict[str, np.ndarray]) -> np.ndarray:
    """Returns the poses (K, 3) that plans begin around: estimated ahead where a state is."""
    return log["state"][:, POSE] if "state" in log else log["pose"]


def successor_outside(log: dict[str, np.ndarray]) -> np.ndarray:
    """Tells (K - 1,) which samples lie outside the tube around what was predicted for them."""
    if "error_bound" not in log:
        error = pose_error(planned_pose(log)[1:], log["nominal_next"][:-1])
        return np.any(np.abs(error) > log["half_width"][1:] + ROUNDING, axis=1)
    predicted = np.hstack([log["nominal_next"], log["nominal_next_velocity"]])[:-1]
    errors = [tracking_error(*states) for states in zip(log["state"][1:], predicted, strict=True)]
    # What is logged after a sample's updates is the bound on the error of the next sample.
    bound = log["error_bound"][:-1] + ROUNDING
    outside = np.abs(errors).swapaxes(1, 2).reshape(len(errors), -1) > bound
    return np.any(outside, axis=1)


def _wire_summary(run: Run) -> dict[str, object]:
    """Returns what a wire adds to the summary of a run."""
    log = run.log
    return {
        "ended": run.ended,
        "command_latency_ms": _percentiles(log["command_latency_s"]),
        "odometry_age_ms": _percentiles(log["odometry_age_s"]),
        "missed_odometry": int(np.sum(~log["fresh_odometry"])),
    }


def _rmse(pose: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    rmse = np.sqrt(np.mean(pose_error(pose, reference) ** 2, axis=0))
    return dict(zip(("x_m", "y_m", "yaw_rad"), rmse, strict=True))


def _percentiles(seconds: np.ndarray) -> dict[str, float]:
    return dict(
        zip(("p50", "p99", "max"), np.percentile(1e3 * seconds, [50, 99, 100]), strict=True)
    )


def _count(violated: np.ndarray) -> int:
    """Number of samples in which any entry is violated."""
    return int(np.sum(violated.any(axis=tuple(range(1, violated.ndim)))))


def versions() -> dict[str, str]:
    """Returns the versions that the numbers depend on."""
    return {
        "mirte_drake": mirte_drake.__version__,
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in ("drake", "numpy", "scipy")},
    }


def save_run(run: Run, folder: Path) -> dict[str, object]:
    """Writes ``RUN_FILES``: log, summary and the scenario as run, each complete or not at all.

    Returns:
        The summary.

    Raises:
        UserError: when the folder cannot be written.
    """
    summary = summarise(run)
    log, summary_file, scenario_file = (folder / name for name in RUN_FILES)
    with replacing(log) as path:
        np.savez_compressed(path, **run.log)  # type: ignore[arg-type]
    write_json(summary, summary_file)
    write_typed(run.scenario, scenario_file)
    return summary
