"""Drives the robot by PID loops on its pose, to compare with."""

import dataclasses as dc

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
)

from mirte_drake.checks import check_array, check_number
from mirte_drake.control.pid import PidGains, PidMemory, pid_step, reference_velocity
from mirte_drake.vectors import POSE_SIZE, WHEELS


@dc.dataclass
class PosePidConfig:
    """Config of PosePid; gains of the axes forward, left and yaw.

    The defaults are tuned: ``examples/16_tune_a_controller.py``.
    """

    proportional: np.ndarray = dc.field(  # (3,) [1/s]
        default_factory=lambda: np.array([2.94, 3.85, 3.95])
    )
    integral: np.ndarray = dc.field(  # (3,) [1/s^2]
        default_factory=lambda: np.array([0.0556, 0.0726, 3.62])
    )
    derivative: np.ndarray = dc.field(  # (3,) [-]
        default_factory=lambda: np.array([0.00789, 0.0103, 0.109])
    )
    # (3,) [-] factor on the reference velocity; 1 would do for wheels that turn as told.
    feedforward: np.ndarray = dc.field(default_factory=lambda: np.array([1.05, 1.02, 1.67]))
    preview: int = 2  # [samples] that the reference velocity is told earlier.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        for name in ("proportional", "integral", "derivative", "feedforward"):
            check_array(name, getattr(self, name), (POSE_SIZE,), minimum=0)
        check_number("preview", self.preview, minimum=0)


class PosePid(LeafSystem):
    """Corrects the robot's pose by one PID loop per axis, see ``control.pid.pid_step``.

    .. pydrake_system::

        name: PosePid
        input_ports:
        - pose
        - reference_window
        output_ports:
        - wheel_command

    =====================  ==================  ============  =====================================
    port                   type                unit          meaning
    =====================  ==================  ============  =====================================
    pose (in)              vector (3,)         [m, m, rad]   measured, yaw unwrapped
    reference_window (in)  vector (3 (N+1),)   [m, m, rad]   r_k, ..., r_{k+N}
    wheel_command          vector (4,)         [pwm]         within the limit; not finite where the
                                                             pose is not
    =====================  ==================  ============  =====================================

    State (6,), every ``period`` s: the integral of the error and the last error, of which the
    first is taken to be zero. The command is that of the pose of its own instant.

    Raises:
        ValueError: when ``config`` is out of range (at construction).
    """

    def __init__(
        self, config: PosePidConfig, *, period: float, horizon: int, input_limit: float = 100.0
    ) -> None:
        """Declares ports and state.

        Args:
            config: The config.
            period: [s] sample time T_s.
            horizon: N, samples of preview that the reference comes with.
            input_limit: [pwm] that no wheel exceeds.
        """
        super().__init__()
        config.validate()
        check_number("preview", config.preview, maximum=horizon - 1)
        self._gains = PidGains(
            config.proportional, config.integral, config.derivative, config.feedforward
        )
        self._preview, self._period, self._limit = config.preview, period, input_limit
        self._pose = self.DeclareVectorInputPort("pose", POSE_SIZE)
        self._window = self.DeclareVectorInputPort("reference_window", POSE_SIZE * (horizon + 1))
        memory = self.DeclareDiscreteState(2 * POSE_SIZE)
        self.DeclareVectorOutputPort(
            "wheel_command",
            len(WHEELS),
            self._calc_wheel_command,
            {self._pose.ticket(), self._window.ticket(), self.discrete_state_ticket(memory)},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update_memory)

    def _step(self, context: Context) -> tuple[np.ndarray, PidMemory]:
        integral, error = context.get_discrete_state_vector().value().reshape(2, -1)
        window = self._window.Eval(context).reshape(-1, POSE_SIZE)
        return pid_step(
            self._gains,
            PidMemory(integral, error),
            self._pose.Eval(context),
            window[0],
            reference_velocity(window, self._period, self._preview),
            period=self._period,
            input_limit=self._limit,
        )

    def _calc_wheel_command(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._step(context)[0])

    def _update_memory(self, context: Context, next_state: DiscreteValues) -> None:
        memory = self._step(context)[1]
        next_state.set_value(np.concatenate([memory.integral, memory.error]))


def AddPosePid(
    builder: DiagramBuilder,
    config: PosePidConfig,
    *,
    period: float,
    horizon: int,
    input_limit: float = 100.0,
    name: str = "pose_pid",
) -> PosePid:
    """Adds a PosePid to ``builder``; the caller connects its ports."""
    system = PosePid(config, period=period, horizon=horizon, input_limit=input_limit)
    return builder.AddNamedSystem(name, system)
