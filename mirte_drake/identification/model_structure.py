"""Which candidate terms each state derivative may have: tables 3-1, 3-2 and 3-3 with masks."""

import dataclasses as dc
from itertools import combinations_with_replacement

from mirte_drake.model.candidate_library import COS, SIN

INPUTS = ("u1", "u2", "u3", "u4")
BODY_VELOCITIES = ("vx", "vy", "yaw_rate")
PRODUCTS = tuple("*".join(pair) for pair in combinations_with_replacement(INPUTS, 2))
KINDS = ("kinematic", "extended_kinematic", "dynamic", "extended_dynamic")


@dc.dataclass(frozen=True)
class ModelStructure:
    """States, candidate terms and default thresholds of a kind of model.

    ``candidates`` and ``thresholds`` belong to the derivatives that are identified: of the pose
    for kinematic models, of the pose's derivative for dynamic ones.
    """

    kind: str
    states: dict[str, str]  # Name to unit.
    auxiliaries: dict[str, dict[str, float]]
    known: dict[str, dict[str, float]]  # Derivatives that need no identification.
    candidates: dict[str, tuple[str, ...]]
    thresholds: dict[str, float]

    @property
    def order(self) -> int:
        """How often the pose is differentiated: 1 for kinematic, 2 for dynamic models."""
        return 2 if self.known else 1


def _times(factor: str, variables: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"{factor}*{variable}" for variable in variables)


def model_structure(kind: str) -> ModelStructure:
    """Returns the structure of a kind of model.

    Raises:
        ValueError: for an unknown kind.
    """
    trigonometric = _times(SIN, INPUTS) + _times(COS, INPUTS)
    match kind:
        case "kinematic":
            return _kinematic(kind, trigonometric, INPUTS, yaw_threshold=1e-4)
        case "extended_kinematic":
            plain = INPUTS + PRODUCTS
            return _kinematic(kind, plain + trigonometric, plain, yaw_threshold=1e-5)
        case "dynamic":
            x = (*trigonometric, f"{COS}*vx", f"{SIN}*vy")
            y = (*trigonometric, f"{COS}*vy", f"{SIN}*vx")
            return _dynamic(kind, x, y, ("yaw_rate", *INPUTS))
        case "extended_dynamic":
            plain = BODY_VELOCITIES + INPUTS
            everything = plain + _times(SIN, plain) + _times(COS, plain)
            return _dynamic(kind, everything, everything, plain)
    raise ValueError(f"model: must be one of {', '.join(KINDS)}, got {kind!r}")


def _kinematic(
    kind: str, translation: tuple[str, ...], yaw: tuple[str, ...], yaw_threshold: float
) -> ModelStructure:
    return ModelStructure(
        kind=kind,
        states={"x": "m", "y": "m", "theta": "rad"},
        auxiliaries={},
        known={},
        candidates={"x": translation, "y": translation, "theta": yaw},
        thresholds={"x": 1e-4, "y": 1e-4, "theta": yaw_threshold},
    )


def _dynamic(
    kind: str, x: tuple[str, ...], y: tuple[str, ...], yaw: tuple[str, ...]
) -> ModelStructure:
    pose = {"x": "m", "y": "m", "theta": "rad"}
    rates = {"x_dot": "m/s", "y_dot": "m/s", "theta_dot": "rad/s"}
    return ModelStructure(
        kind=kind,
        states=pose | rates,
        auxiliaries={  # The body velocity, by (2-1).
            "vx": {f"{COS}*x_dot": 1.0, f"{SIN}*y_dot": 1.0},
            "vy": {f"{COS}*y_dot": 1.0, f"{SIN}*x_dot": -1.0},
            "yaw_rate": {"theta_dot": 1.0},
        },
        known={state: {rate: 1.0} for state, rate in zip(pose, rates, strict=True)},
        candidates={"x_dot": x, "y_dot": y, "theta_dot": yaw},
        thresholds=dict.fromkeys(rates, 1e-5),
    )
