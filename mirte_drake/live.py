"""A scenario live: at the pace of the clock, seen in a browser, with somebody at the controls."""

import dataclasses as dc
import time
from collections.abc import Callable

from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator

from mirte_drake.assembly import MakeDiagram
from mirte_drake.live_view import LiveView
from mirte_drake.scenario import Scenario, check_simulated
from mirte_drake.visualization.meshcat_scene import FRAMES_PER_SAMPLE
from mirte_drake.visualization.run_controls import RunControls

IDLE = 0.02  # [s] Between looks at the controls while nothing moves.


@dc.dataclass
class KeptTime:
    """Time that was simulated, and time that it took, pauses left out."""

    simulated: float = 0.0  # [s] Divided by the speed that was wanted.
    taken: float = 0.0  # [s]

    @property
    def rate(self) -> float:
        """Part of the wanted speed that was kept; 1 before anything was simulated."""
        return self.simulated / self.taken if self.taken else 1.0


def watch(
    scenario: Scenario,
    meshcat: Meshcat,
    *,
    background: str = "light",
    ready: Callable[[], bool] = lambda: True,
    check: Callable[[], object] = lambda: None,
) -> KeptTime:
    """Runs a scenario at the pace of the clock until somebody stops it.

    At its end it waits, for the button that begins anew or the one that stops.

    Args:
        scenario: What to run.
        meshcat: Where to draw, and whose page gets the controls.
        background: "light" or "dark".
        ready: Whether to go on; asked before each picture. While it is not, the robot waits.
        check: Called at each look at the controls; what it raises ends the run.

    Raises:
        ValueError: when the scenario cannot be built; UserError is one.
    """
    check_simulated(scenario)
    diagram = MakeDiagram(scenario, view=LiveView(scenario, meshcat, background))
    simulator = Simulator(diagram)
    simulator.get_mutable_integrator().set_target_accuracy(scenario.accuracy)
    _begin(simulator)
    controls, pace = RunControls(meshcat), KeptTime()
    step, last_frame = scenario.period / FRAMES_PER_SAMPLE, (scenario.steps - 1) * FRAMES_PER_SAMPLE
    frame, restarts, now = 0, 0, 0.0
    speed = 0.0  # No speed: it stands still, and has to take up its pace anew.
    while not (wish := controls.read()).stop:
        check()
        if wish.restarts > restarts:
            simulator.reset_context(diagram.CreateDefaultContext())
            _begin(simulator)
            frame, restarts, speed = 0, wish.restarts, 0.0
        if wish.paused or frame == last_frame or not ready():
            speed = 0.0
            time.sleep(IDLE)
            continue
        if wish.speed != speed:
            speed = wish.speed
            simulator.set_target_realtime_rate(speed)
            simulator.ResetStatistics()
            now = time.perf_counter()
        frame += 1
        simulator.AdvanceTo(frame * step)
        before, now = now, time.perf_counter()
        pace.taken += now - before
        pace.simulated += step / speed
        meshcat.SetRealtimeRate(simulator.get_actual_realtime_rate())
    return pace


def _begin(simulator: Simulator) -> None:
    """Goes to the first sample, updates included: the first solve compiles the solver."""
    simulator.set_target_realtime_rate(0.0)
    simulator.Initialize()
    simulator.AdvancePendingEvents()
