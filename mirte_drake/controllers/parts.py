"""What the controllers have in common: how their parts are added, and what ends each."""

from collections.abc import Iterator
from contextlib import contextmanager

from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import ZeroOrderHold

from mirte_drake.errors import UserError
from mirte_drake.scenario import Scenario
from mirte_drake.systems.coverage_monitor import AddCoverageMonitor, CoverageMonitor
from mirte_drake.systems.wheel_command_limiter import AddWheelCommandLimiter, WheelCommandLimiter
from mirte_drake.vectors import WHEELS

# Outputs of a coverage monitor.
COVERAGE = ("prediction_error", "calibrated_bound", "coverage", "coverage_warning")


@contextmanager
def naming(field: str) -> Iterator[None]:
    """Names the scenario's field in errors that only show when its system is made."""
    try:
        yield
    except ValueError as error:
        raise UserError(f"{field}: {error}") from None


def add_limiter_and_hold(
    builder: DiagramBuilder, scenario: Scenario
) -> tuple[WheelCommandLimiter, ZeroOrderHold]:
    """Adds what a wheel command passes last: limiter, and hold of what the wheels are told."""
    limiter = AddWheelCommandLimiter(
        builder, scenario.wheel_command_limiter, input_limit=scenario.input_limit
    )
    hold = builder.AddNamedSystem("command_hold", ZeroOrderHold(scenario.period, len(WHEELS)))
    builder.Connect(limiter.GetOutputPort("limited_command"), hold.get_input_port())
    builder.Connect(hold.get_output_port(), limiter.GetInputPort("last_command"))
    return limiter, hold


def add_coverage_monitor(
    builder: DiagramBuilder, scenario: Scenario, error: OutputPort
) -> CoverageMonitor:
    """Adds the coverage monitor of a one-step error, and exports what it finds."""
    assert scenario.coverage_monitor is not None
    bound = scenario.disturbance_bound
    assert bound is not None
    monitor = AddCoverageMonitor(builder, scenario.coverage_monitor, bound, period=scenario.period)
    builder.Connect(error, monitor.GetInputPort("error"))
    for port in COVERAGE:
        builder.ExportOutput(monitor.GetOutputPort(port), port)
    return monitor


def built(builder: DiagramBuilder) -> Diagram:
    """Returns the controller of a builder."""
    controller = builder.Build()
    controller.set_name("controller")
    return controller
