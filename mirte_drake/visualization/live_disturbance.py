"""Puts the disturbance of a run into the hands of those who watch it."""

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
)

SIZE_SLIDER = "Disturbance size"
PUSH_BUTTON = "Push the robot"
LARGEST_SIZE = 3.0  # Times the scenario's disturbance.
PUSH = 0.06  # [m] A push moves the robot so far: several widths of the study's tube.

_GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))  # [rad] From one push to the next: never the same twice.


def push_velocity(click: int, period: float) -> np.ndarray:
    """Returns the body velocity (3,) [m/s, m/s, rad/s] of a push that lasts a period [s].

    Args:
        click: Its number, from 1 on; each push has another direction, the first is to the left.
        period: [s] how long it lasts.
    """
    angle = np.pi / 2 + (click - 1) * _GOLDEN_ANGLE
    return PUSH / period * np.array([np.cos(angle), np.sin(angle), 0.0])


class LiveDisturbance(LeafSystem):
    """Scales the disturbance by a slider, and adds a push when a button is clicked.

    .. pydrake_system::

        name: LiveDisturbance
        input_ports:
        - disturbance
        output_ports:
        - live_disturbance

    ================  ===========  ==================  ==========================================
    port              type         unit                meaning
    ================  ===========  ==================  ==========================================
    disturbance (in)  vector (3,)  [m/s, m/s, rad/s]   body frame
    live_disturbance  vector (3,)  [m/s, m/s, rad/s]   body frame: size times w, plus the push
    ================  ===========  ==================  ==========================================

    State, every ``period`` s: size, push (3,) and the number of clicks seen, -1 before the first
    sample. A click pushes for the period after the next sample; clicks in one period make one
    push, those before the first sample none.
    """

    def __init__(self, meshcat: Meshcat, *, period: float) -> None:
        """Declares ports and state, and adds slider and button to the page.

        Args:
            meshcat: Whose page it is.
            period: [s] sample time T_s.
        """
        super().__init__()
        self._meshcat, self._period = meshcat, period
        meshcat.AddSlider(SIZE_SLIDER, min=0.0, max=LARGEST_SIZE, step=0.1, value=1.0)
        meshcat.AddButton(PUSH_BUTTON, "KeyP")
        self._disturbance = self.DeclareVectorInputPort("disturbance", 3)
        self.DeclareDiscreteState(np.array([1.0, 0.0, 0.0, 0.0, -1.0]))
        self.DeclareVectorOutputPort(
            "live_disturbance", 3, self._calc, {self._disturbance.ticket(), self.xd_ticket()}
        )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _calc(self, context: Context, output: BasicVector) -> None:
        size, *push, _ = context.get_discrete_state_vector().value()
        output.SetFromVector(size * self._disturbance.Eval(context) + push)

    def _update(self, context: Context, next_state: DiscreteValues) -> None:
        seen = context.get_discrete_state_vector().GetAtIndex(4)
        clicks = self._meshcat.GetButtonClicks(PUSH_BUTTON)
        push = push_velocity(clicks, self._period) if clicks > seen >= 0 else np.zeros(3)
        size = self._meshcat.GetSliderValue(SIZE_SLIDER)
        next_state.set_value(np.array([size, *push, clicks]))


def AddLiveDisturbance(
    builder: DiagramBuilder, meshcat: Meshcat, *, period: float, name: str = "live_disturbance"
) -> LiveDisturbance:
    """Adds a LiveDisturbance to ``builder``; the caller connects its ports."""
    return builder.AddNamedSystem(name, LiveDisturbance(meshcat, period=period))
