"""Drives the robot by linear-quadratic feedback along its reference, to compare with."""

import dataclasses as dc

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from mirte_drake.angles import pose_error
from mirte_drake.checks import check_array, check_number
from mirte_drake.control.dlqr import design_dlqr
from mirte_drake.control.input_inversion import input_map, invert
from mirte_drake.control.pid import reference_velocity
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.vectors import POSE_SIZE, WHEELS


@dc.dataclass
class PoseLqrConfig:
    """Config of PoseLqr; the defaults are tuned: ``examples/16_tune_a_controller.py``."""

    state_weight: np.ndarray = dc.field(  # (3,) diagonal of Q, on [m, m, rad].
        default_factory=lambda: np.array([404.0, 4560.0, 21.4])
    )
    input_weight: np.ndarray = dc.field(  # (4,) diagonal of R, on [pwm].
        default_factory=lambda: np.full(4, 0.001)
    )
    preview: int = 0  # [samples] that the reference velocity is told earlier.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_array("state_weight", self.state_weight, (POSE_SIZE,), minimum=1e-9)
        check_array("input_weight", self.input_weight, (len(WHEELS),), minimum=1e-12)
        check_number("preview", self.preview, minimum=0)


class PoseLqr(LeafSystem):
    """Adds the infinite-horizon DLQR of the error to the input that drives along the reference.

    .. pydrake_system::

        name: PoseLqr
        input_ports:
        - pose
        - reference_window
        output_ports:
        - wheel_command

    =====================  ==================  ============  ====================================
    port                   type                unit          meaning
    =====================  ==================  ============  ====================================
    pose (in)              vector (3,)         [m, m, rad]   measured, yaw unwrapped
    reference_window (in)  vector (3 (N+1),)   [m, m, rad]   r_k, ..., r_{k+N}
    wheel_command          vector (4,)         [pwm]         uf_k - K_k (x_k - r_k), unlimited; not
                                                             finite where the pose is not
    =====================  ==================  ============  ====================================

    The feed-forward uf_k is the least input at which the model drives as fast as the reference,
    as far as that is within the limit; K_k is the DLQR of the model at r_k and uf_k, (4-11) to
    (4-14), and zero where that cannot be stabilised. Stateless.

    Raises:
        ValueError: when ``config`` is out of range, or the model's state is not the pose (at
            construction).
    """

    def __init__(
        self,
        config: PoseLqrConfig,
        model: PredictionModel,
        *,
        period: float,
        horizon: int,
        input_limit: float = 100.0,
    ) -> None:
        """Declares ports.

        Args:
            config: The config.
            model: Prediction model; its state is the pose.
            period: [s] sample time T_s.
            horizon: N, samples of preview that the reference comes with.
            input_limit: [pwm] that the feed-forward does not exceed.
        """
        super().__init__()
        config.validate()
        check_number("preview", config.preview, maximum=horizon - 1)
        if model.num_states != POSE_SIZE:
            raise ValueError(f"{model.name}: its state must be the pose")
        self._model, self._period, self._preview = model, period, config.preview
        self._Q, self._R = np.diag(config.state_weight), np.diag(config.input_weight)
        self._limit = np.full(len(WHEELS), input_limit)
        self._pose = self.DeclareVectorInputPort("pose", POSE_SIZE)
        self._window = self.DeclareVectorInputPort("reference_window", POSE_SIZE * (horizon + 1))
        self.DeclareVectorOutputPort(
            "wheel_command",
            len(WHEELS),
            self._calc_wheel_command,
            {self._pose.ticket(), self._window.ticket()},
        )

    def _calc_wheel_command(self, context: Context, output: BasicVector) -> None:
        window = self._window.Eval(context).reshape(-1, POSE_SIZE)
        velocity = reference_velocity(window, self._period, self._preview)
        mapping = input_map(self._model, window[0])
        forward = invert(mapping, velocity, np.zeros(len(WHEELS)), -self._limit, self._limit).input
        error = pose_error(self._pose.Eval(context), window[0])
        try:
            design = design_dlqr(self._model, window[0], forward, self._period, self._Q, self._R)
        except ValueError:
            output.SetFromVector(forward)
            return
        output.SetFromVector(forward - design.gain @ error)


def AddPoseLqr(
    builder: DiagramBuilder,
    config: PoseLqrConfig,
    model: PredictionModel,
    *,
    period: float,
    horizon: int,
    input_limit: float = 100.0,
    name: str = "pose_lqr",
) -> PoseLqr:
    """Adds a PoseLqr to ``builder``; the caller connects its ports."""
    system = PoseLqr(config, model, period=period, horizon=horizon, input_limit=input_limit)
    return builder.AddNamedSystem(name, system)
