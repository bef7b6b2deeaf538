"""The tube NMPC of a robot whose velocity lags behind its commands."""

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Gain

from mirte_drake.control.lagged_tube import lagged_loop
from mirte_drake.controllers.parts import (
    add_coverage_monitor,
    add_limiter_and_hold,
    built,
    naming,
)
from mirte_drake.errors import UserError
from mirte_drake.model.lagged_model import LaggedModel
from mirte_drake.scenario import Scenario
from mirte_drake.systems.ancillary_lagged import AddAncillaryLagged, AncillaryLagged
from mirte_drake.systems.lagged_tube_updater import AddLaggedTubeUpdater, LaggedTubeUpdater
from mirte_drake.systems.nominal_nmpc import AddNominalNmpc
from mirte_drake.systems.state_estimator import AddStateEstimator, StateEstimator
from mirte_drake.vectors import POSE_SIZE

# Of the period. Of a shorter lag hardly anything is left after a sample: what a plan's first
# velocity does is then so little that its Hessian is singular.
SMALLEST_LAG = 0.15
# Outputs that other controllers do not have.
ESTIMATES = ("state", "bias", "innovation")


def MakeLaggedController(scenario: Scenario, model: LaggedModel) -> Diagram:
    """Builds the controller of a robot whose velocity lags.

    .. pydrake_system::

        name: LaggedController
        input_ports:
        - pose
        - reference_window
        output_ports:
        - wheel_command
        - plan
        - solve_status
        - half_width
        - error_bound
        - state
        - bias
        - innovation
        - prediction_error
        - calibrated_bound
        - coverage
        - coverage_warning

    Estimator, nominal NMPC, ancillary law, limiter and hold. Everything from the estimator's
    ``state`` (6,) on is about the sample at which the command begins to act, a delay of d samples
    after the measured ``pose`` (3,): the ``reference_window`` (3 (d + N + 1),) holds r_k, ...,
    r_{k+d+N}, of which the plan tracks those from r_{k+d} on. The plan's inputs are effective
    commands, ``wheel_command`` (4,) [pwm] is what gives them. ``half_width``
    and ``error_bound`` are there with a tube, the last four with a coverage monitor, whose
    one-step error is the innovation over T_s.

    Args:
        scenario: The scenario.
        model: Its prediction model.

    Raises:
        UserError: when the prediction model cannot be stabilised, or hardly lags.
        ValueError: when a config is out of range.
    """
    assert scenario.state_estimator is not None and scenario.ancillary_lagged is not None
    period, limit = scenario.period, model.effective_limit(scenario.input_limit)
    _check_lag(model, period)
    builder = DiagramBuilder()
    estimator = AddStateEstimator(builder, scenario.state_estimator, model, period=period)
    with naming("nominal_nmpc"):
        nmpc = AddNominalNmpc(
            builder,
            scenario.nominal_nmpc,
            model.effective(),
            period=period,
            input_limit=limit,
            lead=estimator.delay,
        )
    ancillary = AddAncillaryLagged(
        builder, scenario.ancillary_lagged, model, period=period, input_limit=limit
    )
    tube = None
    if scenario.lagged_tube is not None:
        tube = _add_tube(builder, scenario, model, estimator, ancillary)
        builder.Connect(nmpc.GetOutputPort("plan"), tube.GetInputPort("plan"))
        for port in ("half_width", "input_lower", "input_upper"):
            builder.Connect(tube.GetOutputPort(port), nmpc.GetInputPort(port))
    if scenario.coverage_monitor is not None:
        rate = builder.AddNamedSystem("innovation_rate", Gain(1.0 / period, POSE_SIZE))
        builder.Connect(estimator.GetOutputPort("innovation"), rate.get_input_port())
        monitor = add_coverage_monitor(builder, scenario, rate.get_output_port())
        if scenario.lagged_tube is not None and scenario.lagged_tube.calibrated:
            assert tube is not None
            port = "calibrated_bound"
            builder.Connect(monitor.GetOutputPort(port), tube.GetInputPort(port))
    limiter, hold = add_limiter_and_hold(builder, scenario)

    builder.ExportInput(estimator.GetInputPort("pose"), "pose")
    builder.ExportInput(nmpc.GetInputPort("reference_window"), "reference_window")
    builder.Connect(estimator.GetOutputPort("state"), nmpc.GetInputPort("state"))
    builder.Connect(estimator.GetOutputPort("state"), ancillary.GetInputPort("state"))
    builder.Connect(estimator.GetOutputPort("bias"), ancillary.GetInputPort("bias"))
    builder.Connect(nmpc.GetOutputPort("plan"), ancillary.GetInputPort("plan"))
    builder.Connect(ancillary.GetOutputPort("wheel_command"), limiter.GetInputPort("wheel_command"))
    limited = limiter.GetOutputPort("limited_command")
    builder.Connect(limited, estimator.GetInputPort("wheel_command"))
    builder.ExportOutput(hold.get_output_port(), "wheel_command")
    builder.ExportOutput(nmpc.GetOutputPort("plan"), "plan")
    builder.ExportOutput(nmpc.GetOutputPort("solve_status"), "solve_status")
    if tube is not None:
        for port in ("half_width", "error_bound"):
            builder.ExportOutput(tube.GetOutputPort(port), port)
    for port in ("state", "bias", "innovation"):
        builder.ExportOutput(estimator.GetOutputPort(port), port)
    return built(builder)


def _check_lag(model: LaggedModel, period: float) -> None:
    least, lag = SMALLEST_LAG * period, float(np.min(model.parameters.lag))
    if lag < least:
        raise UserError(
            f"prediction_model: {model.name}: lag: must be at least {least:g} s, {SMALLEST_LAG:g} "
            f"of the period, got {lag:g}; a robot that lags less needs no such model"
        )


def _add_tube(
    builder: DiagramBuilder,
    scenario: Scenario,
    model: LaggedModel,
    estimator: StateEstimator,
    ancillary: AncillaryLagged,
) -> LaggedTubeUpdater:
    """Adds the tube of the loop that estimator and ancillary law close."""
    assert scenario.lagged_tube is not None
    lag, period = model.parameters.lag, scenario.period
    updater = AddLaggedTubeUpdater(
        builder,
        scenario.lagged_tube,
        model,
        lagged_loop(lag, period, ancillary.gains, estimator.gains, estimator.delay),
        ancillary.gains,
        period=period,
        horizon=scenario.nominal_nmpc.horizon,
        input_limit=model.effective_limit(scenario.input_limit),
        command_error=scenario.wheel_command_limiter.command_error,
    )
    for port in ("state", "bias"):
        builder.Connect(estimator.GetOutputPort(port), updater.GetInputPort(port))
    return updater
