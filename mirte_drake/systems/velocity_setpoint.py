"""Turns a live body-velocity setpoint into a reference pose with preview (section 5-1)."""

import dataclasses as dc

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
)

from mirte_drake.checks import check_array
from mirte_drake.control.reference_paths import integrate_body_velocity, slew


@dc.dataclass
class VelocitySetpointConfig:
    """Config of VelocitySetpointSource."""

    setpoint: np.ndarray = dc.field(  # (3,) [m/s, m/s, rad/s] used while the port is open.
        default_factory=lambda: np.zeros(3)
    )
    acceleration_limit: np.ndarray = dc.field(  # (3,) [m/s^2, m/s^2, rad/s^2]
        default_factory=lambda: np.array([1.0, 1.0, 3.0])
    )
    start: np.ndarray = dc.field(default_factory=lambda: np.zeros(3))  # [m, m, rad] first pose.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_array("setpoint", self.setpoint, (3,))
        check_array("acceleration_limit", self.acceleration_limit, (3,), minimum=0)
        check_array("start", self.start, (3,))


class VelocitySetpointSource(LeafSystem):
    """Integrates a slew-limited body velocity to a reference pose.

    .. pydrake_system::

        name: VelocitySetpointSource
        input_ports:
        - velocity_setpoint
        output_ports:
        - reference
        - reference_window

    ======================  ==================  ==================  ===========================
    port                    type                unit                meaning
    ======================  ==================  ==================  ===========================
    velocity_setpoint (in)  vector (3,)         [m/s, m/s, rad/s]   body velocity wanted; if
                                                                    open, the config's; if not
                                                                    finite, zero
    reference               vector (3,)         [m, m, rad]         a state: r_k before the
                                                                    update at t_k, then r_{k+1}
    reference_window        vector (3 (N+1),)   [m, m, rad]         r_k, ..., r_{k+N}, the
                                                                    setpoint held over the
                                                                    horizon
    ======================  ==================  ==================  ===========================

    State, every ``period`` s: the pose (3,) and the slew-limited velocity (3,).

    Raises:
        ValueError: when ``config`` is out of range (at construction).
    """

    def __init__(self, config: VelocitySetpointConfig, *, period: float, horizon: int) -> None:
        """Declares ports and state.

        Args:
            config: The config.
            period: [s] sample time T_s.
            horizon: N, samples of preview.
        """
        super().__init__()
        config.validate()
        self._config, self._period, self._horizon = config, period, horizon
        self._setpoint = self.DeclareVectorInputPort("velocity_setpoint", 3)
        self._pose = self.DeclareDiscreteState(config.start)
        self._velocity = self.DeclareDiscreteState(np.zeros(3))
        self.DeclareStateOutputPort("reference", self._pose)
        self.DeclareVectorOutputPort(
            "reference_window",
            3 * (horizon + 1),
            self._calc_reference_window,
            {self.xd_ticket(), self._setpoint.ticket()},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _preview(self, context: Context, samples: int) -> tuple[np.ndarray, np.ndarray]:
        """Returns poses (samples + 1, 3) and the velocities (samples, 3) that lead there."""
        has_value = self._setpoint.HasValue(context)
        setpoint = self._setpoint.Eval(context) if has_value else self._config.setpoint
        if not np.all(np.isfinite(setpoint)):
            setpoint = np.zeros(3)
        velocity = context.get_discrete_state(self._velocity).value()
        velocities = np.empty((samples, 3))
        for i in range(samples):
            velocity = slew(velocity, setpoint, self._period * self._config.acceleration_limit)
            velocities[i] = velocity
        pose = context.get_discrete_state(self._pose).value()
        return integrate_body_velocity(velocities, pose, self._period), velocities

    def _calc_reference_window(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._preview(context, self._horizon)[0].ravel())

    def _update(self, context: Context, next_state: DiscreteValues) -> None:
        poses, velocities = self._preview(context, 1)
        next_state.set_value(self._pose, poses[1])
        next_state.set_value(self._velocity, velocities[0])


def AddVelocitySetpointSource(
    builder: DiagramBuilder,
    config: VelocitySetpointConfig,
    *,
    period: float,
    horizon: int,
    name: str = "velocity_setpoint_source",
) -> VelocitySetpointSource:
    """Adds a VelocitySetpointSource to ``builder``; the caller connects its ports."""
    system = VelocitySetpointSource(config, period=period, horizon=horizon)
    return builder.AddNamedSystem(name, system)
