"""Figures 3-2 to 3-4: the recordings, and the identified models over them."""

from pathlib import Path

import numpy as np

from mirte_drake.angles import rotation
from mirte_drake.errors import UserError
from mirte_drake.identification.differentiation import tvr_derivative
from mirte_drake.identification.recorded_run import RecordedRun, load_recorded_run
from mirte_drake.identification.validation import Validation, validate_model
from mirte_drake.model.model_file import load_model
from mirte_drake.thesis.published import VALIDATION_RMSE
from mirte_drake.vectors import YAW
from mirte_drake.visualization.identification_figures import (
    derivative_figure,
    pose_figure,
    velocity_figure,
    wheel_command_figure,
)
from mirte_drake.visualization.thesis_page import Table, ThesisFigure

FILES = {
    "3-2": "training_data.csv",
    "3-3": "validation_turn_rect.csv",
    "3-4": "validation_const_rect.csv",
}
_PATHS = {"3-3": "changing", "3-4": "constant"}
_COLUMNS = ("x [m]", "y [m]", "θ [rad]", "vx [m/s]", "vy [m/s]", "Ω [rad/s]")


def recorded_figure(number: str, data: Path) -> ThesisFigure:
    """Returns one of the figures of ``FILES``.

    Args:
        number: Its number.
        data: Folder of the recordings.

    Raises:
        UserError: when its recording is missing or damaged.
    """
    file = data / FILES[number]
    if not file.is_file():
        raise UserError(f"--data {data}: has no {file.name}, which figure {number} needs")
    run = load_recorded_run(file)
    return _training_figure(run) if number == "3-2" else _validation_figure(number, run)


def _training_figure(run: RecordedRun) -> ThesisFigure:
    derivative = tvr_derivative(run.pose, run.period, "published")
    world_velocity = np.einsum("kij,kj->ki", rotation(run.pose[:, YAW]), run.body_velocity)
    x, y, yaw = np.sqrt(np.mean((derivative - world_velocity) ** 2, axis=0))
    return ThesisFigure(
        "3-2",
        "Training data used for SINDYc",
        {
            "a": ("Wheel commands.", lambda: wheel_command_figure(run.time, run.wheel_command)),
            "b": ("Body velocities.", lambda: velocity_figure(run.time, run.body_velocity, {})),
            "c": ("Pose.", lambda: pose_figure(run.time, run.pose, {})),
            "d": (
                "Velocity in the world frame: measured, and as the derivative of the pose.",
                lambda: derivative_figure(run.time, derivative, run.pose, run.body_velocity),
            ),
        },
        ours=f"the derivative in (d), by total variation regularisation as far as the published "
        f"programs took it. Against the measured velocity it differs by {x:.3f} m/s, {y:.3f} m/s "
        f"and {yaw:.3f} rad/s (RMS).",
        published=f"the recording, {len(run.time)} samples, and the method. What (c) shows the "
        "text does not say.",
    )


def _validation_figure(number: str, run: RecordedRun) -> ThesisFigure:
    models = {name: load_model(name) for name in VALIDATION_RMSE[number]}
    drawn = {name: validate_model(model, run, integrator="ode45") for name, model in models.items()}
    exact = {name: validate_model(model, run) for name, model in models.items()}
    rows = []
    for name, published in VALIDATION_RMSE[number].items():
        label = name.replace("_", " ")
        rows += [
            [f"{label}, published", *(f"{value:.2f}" for value in published)],
            [f"{label}, as drawn", *_rmse(drawn[name])],
            [f"{label}, exact", *_rmse(exact[name])],
        ]
    poses = {name: result.pose for name, result in drawn.items()}
    velocities = {name: result.body_velocity for name, result in drawn.items()}
    return ThesisFigure(
        number,
        "Measured and simulated by the identified models: rectangular path with "
        f"{_PATHS[number]} heading",
        {
            "a": ("Path and yaw.", lambda: pose_figure(run.time, run.pose, poses)),
            "b": ("Body velocities.", lambda: velocity_figure(
                run.time, run.body_velocity, velocities)),
        },
        ours="the simulation, open loop from the first row. It is drawn as MATLAB's ode45 makes "
        "it, which steps over switches of the inputs; “exact” holds them from sample to "
        "sample.",
        published="the recording, the models' coefficients and the RMSE of table "
        f"{'3-4' if number == '3-3' else '3-5'}.",
        table=Table(("RMSE", *_COLUMNS), rows),
    )  # fmt: skip


def _rmse(result: Validation) -> list[str]:
    return [f"{value:.3f}" for value in (*result.pose_rmse, *result.velocity_rmse)]
