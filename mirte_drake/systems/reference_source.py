"""Plays a reference path, with the preview that the nominal controller needs."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from mirte_drake.control.reference_paths import (
    CirclePath,
    RectanglePath,
    VelocityCirclePath,
    VelocityLegsPath,
    window,
)
from mirte_drake.control.waypoint_path import WaypointPath
from mirte_drake.sampling import sample_number

ReferencePathConfig = (
    RectanglePath | CirclePath | VelocityLegsPath | VelocityCirclePath | WaypointPath
)


class ReferenceSource(LeafSystem):
    """Gives the reference pose now and over the horizon; past its end the path stands still.

    .. pydrake_system::

        name: ReferenceSource
        output_ports:
        - reference
        - reference_window

    ================  ==================  =============  ====================================
    port              type                unit           meaning
    ================  ==================  =============  ====================================
    reference         vector (3,)         [m, m, rad]    r_k
    reference_window  vector (3 (N+1),)   [m, m, rad]    r_k, r_{k+1}, ..., r_{k+N}, by rows
    ================  ==================  =============  ====================================

    Both depend on time alone. Yaw is unwrapped.

    Raises:
        ValueError: when ``config`` is out of range (at construction).
    """

    def __init__(self, config: ReferencePathConfig, *, period: float, horizon: int) -> None:
        """Samples the path.

        Args:
            config: The path.
            period: [s] sample time T_s.
            horizon: N, samples of preview.
        """
        super().__init__()
        config.validate()
        self._poses = config.poses(period)
        self._poses.setflags(write=False)
        self._period, self._length = period, horizon + 1
        time = {self.time_ticket()}
        self.DeclareVectorOutputPort("reference", 3, self._calc_reference, time)
        self.DeclareVectorOutputPort(
            "reference_window", 3 * self._length, self._calc_reference_window, time
        )

    @property
    def poses(self) -> np.ndarray:
        """The whole path (samples, 3), read-only."""
        return self._poses

    def _index(self, context: Context) -> int:
        return int(sample_number(context.get_time(), self._period))

    def _calc_reference(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(window(self._poses, self._index(context), 1)[0])

    def _calc_reference_window(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(window(self._poses, self._index(context), self._length).ravel())


def AddReferenceSource(
    builder: DiagramBuilder,
    config: ReferencePathConfig,
    *,
    period: float,
    horizon: int,
    name: str = "reference_source",
) -> ReferenceSource:
    """Adds a ReferenceSource to ``builder``; the caller connects its ports."""
    return builder.AddNamedSystem(name, ReferenceSource(config, period=period, horizon=horizon))
