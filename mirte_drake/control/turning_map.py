"""The map from wheel inputs to world velocity, with the yaw split off."""

from typing import NamedTuple

import numpy as np

from mirte_drake.control.input_inversion import InputMap, input_map
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.vectors import POSE_SIZE, YAW

PROBE_YAW = 1.0  # [rad] Where the split is tried out.


class TurningMap(NamedTuple):
    """World velocity F(yaw, u) = still(u) + sin(yaw) sine(u) + cos(yaw) cosine(u).

    The yaw rate is in ``still`` alone: the yaw of a held input is linear in time.
    """

    still: InputMap
    sine: InputMap
    cosine: InputMap

    def at(self, yaw: float) -> InputMap:
        """Returns the map F(yaw, .)."""
        return _sum((1.0, self.still), (1.0, self.turned(yaw)))

    def over(self, yaw: float, rate: float, duration: float) -> InputMap:
        """Returns the mean of F(yaw(t), .) while the yaw goes on from ``yaw`` at a rate.

        By Simpson's rule, as RK4 integrates it: of an input that gives this yaw rate [rad/s], the
        model's step of that duration [s] is the duration times the mean.
        """
        nodes = ((w, self.at(yaw + rate * t)) for w, t in simpson(duration))
        return _sum(*nodes)

    def turned(self, yaw: float) -> InputMap:
        """Returns the part T(yaw, .) of F that depends on the yaw; dF/dyaw is T(yaw + pi/2, .)."""
        return _sum((np.sin(yaw), self.sine), (np.cos(yaw), self.cosine))


def simpson(duration: float) -> tuple[tuple[float, float], ...]:
    """Returns weights, which add up to one, and times [s] of Simpson's rule."""
    return (1 / 6, 0.0), (4 / 6, 0.5 * duration), (1 / 6, duration)


def _sum(*parts: tuple[float, InputMap]) -> InputMap:
    scaled = [[factor * entries for entries in mapping] for factor, mapping in parts]
    return InputMap(*(np.sum(entries, axis=0) for entries in zip(*scaled, strict=True)))


def turning_map(model: PredictionModel) -> TurningMap:
    """Returns the map of a kinematic model, as its terms have it.

    Raises:
        ValueError: when the model's state is more than the pose, its velocities depend on the yaw
            in another way or on the position, its yaw rate depends on the yaw, or as
            ``input_map``.
    """
    if model.num_states != POSE_SIZE:
        raise ValueError(f"{model.name}: must have the pose as its state")
    ahead, left, back = (
        input_map(model, np.array([0.0, 0.0, yaw])) for yaw in (0.0, np.pi / 2, np.pi)
    )
    still = _sum((0.5, ahead), (0.5, back))
    parts = TurningMap(still, _sum((1.0, left), (-1.0, still)), _sum((0.5, ahead), (-0.5, back)))
    probe = input_map(model, np.array([1.0, 1.0, PROBE_YAW]))
    for expected, entries, still_entries in zip(parts.at(PROBE_YAW), probe, still, strict=True):
        if not np.allclose(expected, entries, rtol=1e-9, atol=1e-12):
            raise ValueError(
                f"{model.name}: velocities must depend on the state by sin and cos of yaw alone"
            )
        if not np.allclose(still_entries[YAW], entries[YAW], rtol=1e-9, atol=1e-12):
            raise ValueError(f"{model.name}: the yaw rate must not depend on the yaw")
    return parts
