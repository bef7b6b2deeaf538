"""Compares each pose with what the model predicted for it a sample before."""

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
)

from mirte_drake.angles import pose_error, rotation
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.sampling import sample_number
from mirte_drake.vectors import POSE, POSE_SIZE, YAW


class OneStepError(LeafSystem):
    """Gives the error of the pose that was predicted a sample before.

    .. pydrake_system::

        name: OneStepError
        input_ports:
        - state
        - wheel_command
        output_ports:
        - error

    ==================  ===========  ==================  =========================================
    port                type         unit                meaning
    ==================  ===========  ==================  =========================================
    state (in)          vector (n,)  model's             x_k, measured; of a kinematic model the
                                                         pose
    wheel_command (in)  vector (m,)  [pwm]               u_k, as it is applied
    error               vector (3,)  [m/s, m/s, rad/s]   of the pose of x_k, over T_s, in the body
                                                         frame of the sample before; NaN: none
    ==================  ===========  ==================  =========================================

    The error has feedthrough from ``state``, holds until the next sample, and is NaN where this
    state or the one before is not finite. State, every ``period`` s: the next prediction, the yaw
    it was made at, the error of this sample, and its number.
    """

    def __init__(self, model: PredictionModel, *, period: float) -> None:
        """Declares ports and state.

        Args:
            model: What predicts; the first three states are the pose.
            period: [s] sample time T_s.
        """
        super().__init__()
        self._model, self._period = model, period
        self._state_input = self.DeclareVectorInputPort("state", model.num_states)
        self._command_input = self.DeclareVectorInputPort("wheel_command", model.num_inputs)
        nothing = np.full(POSE_SIZE, np.nan)
        self._prediction = self.DeclareDiscreteState(nothing)
        self._yaw = self.DeclareDiscreteState([np.nan])  # [rad]
        self._given = self.DeclareDiscreteState(nothing)
        self._newest = self.DeclareDiscreteState([-1.0])
        sources = {self.time_ticket(), self.xd_ticket(), self._state_input.ticket()}
        self.DeclareVectorOutputPort("error", POSE_SIZE, self._calc_error, sources)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _value(self, context: Context, index: int) -> np.ndarray:
        return context.get_discrete_state(index).value()

    def _error(self, context: Context) -> np.ndarray:
        """Returns the error of the last sample, or of one that is due."""
        number = sample_number(context.get_time(), self._period)
        if number <= self._value(context, self._newest)[0]:
            return self._value(context, self._given)
        pose, yaw = self._state_input.Eval(context)[POSE], self._value(context, self._yaw)[0]
        with np.errstate(invalid="ignore"):
            moved = pose_error(pose, self._value(context, self._prediction))
            return rotation(yaw).T @ moved / self._period

    def _calc_error(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._error(context))

    def _update(self, context: Context, next_state: DiscreteValues) -> None:
        state, command = self._state_input.Eval(context), self._command_input.Eval(context)
        with np.errstate(invalid="ignore"):
            prediction = self._model.step(state, command, self._period)[POSE]
        next_state.set_value(self._prediction, prediction)
        next_state.set_value(self._yaw, [state[YAW]])
        next_state.set_value(self._given, self._error(context))
        next_state.set_value(self._newest, [float(sample_number(context.get_time(), self._period))])


def AddOneStepError(
    builder: DiagramBuilder, model: PredictionModel, *, period: float, name: str = "one_step_error"
) -> OneStepError:
    """Adds a OneStepError to ``builder``; the caller connects its ports."""
    return builder.AddNamedSystem(name, OneStepError(model, period=period))
