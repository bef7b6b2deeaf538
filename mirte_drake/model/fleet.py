"""Robots that resemble one another: variations for studies from robot to robot."""

import dataclasses as dc

import numpy as np

from mirte_drake.geometry import HALF_TRACK, HALF_WHEELBASE
from mirte_drake.model.drivetrain import BY_DIRECTION, DrivetrainParameters
from mirte_drake.model.dynamic_model import DynamicParameters
from mirte_drake.model.model_file import Identification
from mirte_drake.model.robot_file import RobotFile

SEED = 0  # Of the robots drawn at random.
GAIN_SPREAD, FRICTION_SPREAD = 0.06, 0.25  # Standard deviations, as shares, from wheel to wheel.


def fleet(fitted: DynamicParameters, seed: int = SEED) -> dict[str, DynamicParameters]:
    """Returns variations of a robot, by name.

    Gains vary by as much as the wheels of one fitted robot differ (some 10 %), friction by what
    wear and floors may do to it.

    Args:
        fitted: The robot in the middle.
        seed: Of ``mixed_1`` and ``mixed_2``, whose wheels are drawn at random.
    """
    draw = np.random.default_rng(seed)
    weak_wheel = np.array([0.85, 1.0, 1.0, 1.0])
    one_sided = np.array([1.06, 0.94, 0.94, 1.06])  # Left and right wheels.
    return {
        "clean": clean(fitted),
        "weak_wheels": scaled(fitted, gain=0.9),
        "strong_wheels": scaled(fitted, gain=1.1),
        "weak_front_left": scaled(fitted, gain=weak_wheel),
        "one_sided": scaled(fitted, gain=one_sided),
        "low_friction": scaled(fitted, friction=0.5, rollers=0.7),
        "high_friction": scaled(fitted, friction=1.6, rollers=1.3),
        "payload_5kg": loaded(fitted, payload=5.0),
        "mixed_1": _mixed(fitted, draw),
        "mixed_2": _mixed(fitted, draw),
    }


def fleet_files(fitted: RobotFile, seed: int = SEED) -> list[RobotFile]:
    """Returns the variations of a robot as files; see ``fleet``."""
    source = f"{fitted.name} ({fitted.identification.source}), varied by mirte_drake.model.fleet"
    return [
        RobotFile(
            name=name,
            parameters=parameters,
            identification=Identification(
                source=source,
                data_sha256=fitted.identification.data_sha256,
                date=fitted.identification.date,
                settings={"seed": str(seed)},
            ),
        )
        for name, parameters in fleet(fitted.parameters, seed).items()
    ]


def clean(fitted: DynamicParameters) -> DynamicParameters:
    """Returns the robot of the kinematic model (2-5): ideal equal gains, no friction.

    Mass, inertia and motor damping, so the time constants, are the fitted ones.
    """
    return dc.replace(
        fitted,
        viscous_friction=0.0,
        breakaway=0.0,
        roller_friction=0.0,
        drivetrain=DrivetrainParameters(lag=fitted.drivetrain.lag.copy()),
    )


def scaled(
    robot: DynamicParameters,
    *,
    gain: float | np.ndarray = 1.0,
    friction: float | np.ndarray = 1.0,
    rollers: float = 1.0,
) -> DynamicParameters:
    """Returns a robot with other gains and frictions.

    Args:
        robot: The robot.
        gain: Factor on the gains, one or (4,) or (2, 4).
        friction: Factor on the wheels' Coulomb friction, likewise.
        rollers: Factor on the rollers' friction.
    """
    drivetrain = dc.replace(
        robot.drivetrain,
        gain=robot.drivetrain.gain * gain,
        friction=robot.drivetrain.friction * friction,
    )
    roller_friction = robot.roller_friction * rollers
    return dc.replace(robot, drivetrain=drivetrain, roller_friction=roller_friction)


def loaded(robot: DynamicParameters, payload: float) -> DynamicParameters:
    """Returns a robot with a load [kg], spread evenly over the rectangle between its wheels.

    The rollers' friction grows with the weight on them; that of the gearboxes stays.
    """
    spread = ((2 * HALF_WHEELBASE) ** 2 + (2 * HALF_TRACK) ** 2) / 12
    return dc.replace(
        robot,
        mass=robot.mass + payload,
        yaw_inertia=robot.yaw_inertia + spread * payload,
        roller_friction=robot.roller_friction * (1 + payload / robot.mass),
    )


def _mixed(robot: DynamicParameters, draw: np.random.Generator) -> DynamicParameters:
    gain, friction = np.exp(
        draw.normal(size=(2, *BY_DIRECTION)) * np.reshape([GAIN_SPREAD, FRICTION_SPREAD], (2, 1, 1))
    )
    return scaled(robot, gain=gain, friction=friction)
