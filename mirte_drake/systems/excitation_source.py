"""Plays the excitation of algorithm 1 on the wheels, to record data for identification."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from mirte_drake.control.excitation import ExcitationConfig, excitation
from mirte_drake.sampling import sample_number


class ExcitationSource(LeafSystem):
    """Gives the wheel command of algorithm 1; past its end the wheels stand still.

    .. pydrake_system::

        name: ExcitationSource
        output_ports:
        - wheel_command

    =============  ===========  =====  =========================================
    port           type         unit   meaning
    =============  ===========  =====  =========================================
    wheel_command  vector (4,)  [pwm]  u, held for a control interval
    =============  ===========  =====  =========================================

    It depends on time alone: at k times any period it is row k of ``excitation``.

    Raises:
        ValueError: when ``config`` or ``seed`` is out of range (at construction).
    """

    def __init__(self, config: ExcitationConfig, *, seed: int = 0) -> None:
        """Draws the whole sequence.

        Args:
            config: Settings of algorithm 1.
            seed: Seed >= 0 of the sequence.
        """
        super().__init__()
        self._interval = config.control_interval
        self._commands = excitation(config, seed, config.control_interval)
        self._commands.setflags(write=False)
        self.DeclareVectorOutputPort(
            "wheel_command", 4, self._calc_wheel_command, {self.time_ticket()}
        )

    @property
    def commands(self) -> np.ndarray:
        """The whole sequence (control intervals, 4) [pwm], read-only."""
        return self._commands

    def _calc_wheel_command(self, context: Context, output: BasicVector) -> None:
        k = sample_number(context.get_time(), self._interval)
        output.SetFromVector(self._commands[k] if k < len(self._commands) else np.zeros(4))


def AddExcitationSource(
    builder: DiagramBuilder,
    config: ExcitationConfig,
    *,
    seed: int = 0,
    name: str = "excitation_source",
) -> ExcitationSource:
    """Adds an ExcitationSource to ``builder``; the caller connects its port."""
    return builder.AddNamedSystem(name, ExcitationSource(config, seed=seed))
