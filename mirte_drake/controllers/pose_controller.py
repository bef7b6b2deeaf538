"""Controllers to compare with, which do not plan: feedback from the pose alone."""

from pydrake.systems.framework import Diagram, DiagramBuilder

from mirte_drake.controllers.parts import add_limiter_and_hold, built, naming
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.scenario import Scenario
from mirte_drake.systems.pose_lqr import AddPoseLqr, PoseLqr
from mirte_drake.systems.pose_pid import AddPosePid, PosePid, PosePidConfig


def MakePoseController(scenario: Scenario, model: PredictionModel) -> Diagram:
    """Builds a controller that does not plan: feedback from the pose, limiter and hold.

    .. pydrake_system::

        name: PoseController
        input_ports:
        - pose
        - reference_window
        output_ports:
        - wheel_command

    Ports as of ``MakeTubeController``.

    Args:
        scenario: The scenario; its ``controller`` is given.
        model: Its prediction model, which a PID does without.

    Raises:
        UserError: when a value does not fit the rest of the scenario.
    """
    config, period, limit = scenario.controller, scenario.period, scenario.input_limit
    horizon = scenario.nominal_nmpc.horizon
    builder = DiagramBuilder()
    with naming("controller"):
        feedback: PosePid | PoseLqr
        if isinstance(config, PosePidConfig):
            feedback = AddPosePid(
                builder, config, period=period, horizon=horizon, input_limit=limit
            )
        else:
            assert config is not None
            feedback = AddPoseLqr(
                builder, config, model, period=period, horizon=horizon, input_limit=limit
            )
    limiter, hold = add_limiter_and_hold(builder, scenario)
    builder.ExportInput(feedback.GetInputPort("pose"), "pose")
    builder.ExportInput(feedback.GetInputPort("reference_window"), "reference_window")
    builder.Connect(feedback.GetOutputPort("wheel_command"), limiter.GetInputPort("wheel_command"))
    builder.ExportOutput(hold.get_output_port(), "wheel_command")
    return built(builder)
