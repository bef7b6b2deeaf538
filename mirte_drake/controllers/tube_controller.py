"""The tube NMPC of a robot that follows its commands at once; without its parts, the baseline."""

from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem, OutputPort

from mirte_drake.controllers.parts import (
    add_coverage_monitor,
    add_limiter_and_hold,
    built,
    naming,
)
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.scenario import Scenario
from mirte_drake.systems.ancillary_dlqr import AddAncillaryDlqr
from mirte_drake.systems.ancillary_inversion import AddAncillaryInversion
from mirte_drake.systems.inversion_tube_updater import AddInversionTubeUpdater
from mirte_drake.systems.nominal_nmpc import AddNominalNmpc, NominalNmpc
from mirte_drake.systems.one_step_error import AddOneStepError
from mirte_drake.systems.tube_updater import AddTubeUpdater
from mirte_drake.systems.wheel_command_limiter import WheelCommandLimiter


def MakeTubeController(scenario: Scenario, model: PredictionModel) -> Diagram:
    """Builds the controller: nominal NMPC, ancillary law, its tube, limiter and hold.

    .. pydrake_system::

        name: TubeController
        input_ports:
        - pose
        - reference_window
        output_ports:
        - wheel_command
        - plan
        - solve_status
        - half_width
        - designs
        - reached
        - prediction_error
        - calibrated_bound
        - coverage
        - coverage_warning

    ``pose`` (3,) [m, m, rad] is measured, yaw unwrapped; ``reference_window`` (3 (N+1),) holds
    r_k, ..., r_{k+N}; ``wheel_command`` (4,) [pwm] is held for T_s. At a sample everything
    follows from the pose at that instant. ``half_width`` is there with a tube, ``designs`` with
    the ancillary DLQR, ``reached`` with the ancillary inversion, the last four with a coverage
    monitor; the baseline NMPC has none.

    Args:
        scenario: The scenario.
        model: Its prediction model; its state is the pose.

    Raises:
        UserError: when the prediction model cannot be stabilised.
        ValueError: when a config is out of range.
    """
    builder = DiagramBuilder()
    with naming("nominal_nmpc"):
        nmpc = AddNominalNmpc(
            builder,
            scenario.nominal_nmpc,
            model,
            period=scenario.period,
            input_limit=scenario.input_limit,
        )
    limiter, hold = add_limiter_and_hold(builder, scenario)
    builder.ExportInput(nmpc.GetInputPort("state"), "pose")
    builder.ExportInput(nmpc.GetInputPort("reference_window"), "reference_window")
    builder.Connect(hold.get_output_port(), nmpc.GetInputPort("applied_input"))
    builder.ExportOutput(hold.get_output_port(), "wheel_command")
    builder.ExportOutput(nmpc.GetOutputPort("plan"), "plan")
    builder.ExportOutput(nmpc.GetOutputPort("solve_status"), "solve_status")

    command: OutputPort = nmpc.GetOutputPort("nominal_input")
    tube: LeafSystem | None = None
    if scenario.ancillary_dlqr is not None:
        command, tube = _add_dlqr(builder, scenario, model, nmpc)
    elif scenario.ancillary_inversion is not None:
        command, tube = _add_inversion(builder, scenario, model, nmpc, limiter)
    builder.Connect(command, limiter.GetInputPort("wheel_command"))
    if tube is not None:
        for port in ("half_width", "input_lower", "input_upper"):
            builder.Connect(tube.GetOutputPort(port), nmpc.GetInputPort(port))
        builder.ExportOutput(tube.GetOutputPort("half_width"), "half_width")
    if scenario.coverage_monitor is not None:
        _add_monitor(builder, scenario, model, limiter)
    return built(builder)


def _add_dlqr(
    builder: DiagramBuilder, scenario: Scenario, model: PredictionModel, nmpc: NominalNmpc
) -> tuple[OutputPort, LeafSystem | None]:
    """Adds the published ancillary law and its tube; returns its command, and the tube."""
    config, tube = scenario.ancillary_dlqr, scenario.tube_updater
    period, horizon = scenario.period, scenario.nominal_nmpc.horizon
    assert config is not None
    stagewise = tube is not None and tube.tightening_over_horizon == "stagewise"
    with naming("ancillary_dlqr"):
        law = AddAncillaryDlqr(
            builder, config, model, period=period, stages=horizon if stagewise else 1
        )
    builder.Connect(nmpc.GetOutputPort("plan"), law.GetInputPort("plan"))
    builder.ConnectInput("pose", law.GetInputPort("state"))
    builder.ExportOutput(law.GetOutputPort("designs"), "designs")
    command = law.GetOutputPort("wheel_command")
    if tube is None:
        return command, None
    updater = AddTubeUpdater(
        builder, tube, period=period, horizon=horizon, input_limit=scenario.input_limit
    )
    builder.Connect(law.GetOutputPort("designs"), updater.GetInputPort("designs"))
    return command, updater


def _add_inversion(
    builder: DiagramBuilder,
    scenario: Scenario,
    model: PredictionModel,
    nmpc: NominalNmpc,
    limiter: WheelCommandLimiter,
) -> tuple[OutputPort, LeafSystem | None]:
    """Adds the ancillary law that inverts the input map; returns its command, and its tube."""
    config, tube = scenario.ancillary_inversion, scenario.inversion_tube_updater
    period, limit = scenario.period, scenario.input_limit
    assert config is not None
    with naming("ancillary_inversion"):
        law = AddAncillaryInversion(builder, config, model, period=period, input_limit=limit)
    builder.Connect(nmpc.GetOutputPort("plan"), law.GetInputPort("plan"))
    builder.ConnectInput("pose", law.GetInputPort("state"))
    builder.ExportOutput(law.GetOutputPort("reached"), "reached")
    command = law.GetOutputPort("wheel_command")
    if tube is None:
        return command, None
    with naming("inversion_tube_updater"):
        updater = AddInversionTubeUpdater(
            builder,
            tube,
            model,
            period=period,
            horizon=scenario.nominal_nmpc.horizon,
            feedback=config.feedback,
            input_limit=limit,
        )
    builder.Connect(nmpc.GetOutputPort("plan"), updater.GetInputPort("plan"))
    builder.ConnectInput("pose", updater.GetInputPort("state"))
    limited = limiter.GetOutputPort("limited_command")
    builder.Connect(limited, updater.GetInputPort("wheel_command"))
    return command, updater


def _add_monitor(
    builder: DiagramBuilder,
    scenario: Scenario,
    model: PredictionModel,
    limiter: WheelCommandLimiter,
) -> None:
    """Adds the coverage monitor and what it judges."""
    error = AddOneStepError(builder, model, period=scenario.period)
    builder.ConnectInput("pose", error.GetInputPort("state"))
    limited = limiter.GetOutputPort("limited_command")
    builder.Connect(limited, error.GetInputPort("wheel_command"))
    add_coverage_monitor(builder, scenario, error.GetOutputPort("error"))
