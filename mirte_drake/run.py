"""One run: build, simulate, log."""

import dataclasses as dc
import time
from collections.abc import Callable, Iterator, Mapping

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram

from mirte_drake.assembly import MakeDiagram
from mirte_drake.control.dlqr import DlqrDesign
from mirte_drake.control.plan import Plan
from mirte_drake.controllers.lagged_controller import ESTIMATES
from mirte_drake.controllers.parts import COVERAGE
from mirte_drake.pacing import Pace, WireStopped
from mirte_drake.scenario import Scenario, check_simulated
from mirte_drake.systems.nominal_nmpc import NominalNmpc
from mirte_drake.vectors import POSE, POSE_SIZE


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
    follow from the measured pose. The true pose, where the robot gives one, the reference, and the
    bound on the error of the estimate, are from before them: they take a robot with discrete
    states, a reference with a state, and the tube on to the next step.
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
        more = {
            port: diagram.GetOutputPort(port).Eval(context)
            for port in ("reference", "true_pose", "error_bound")
            if diagram.HasOutputPort(port)
        }
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
