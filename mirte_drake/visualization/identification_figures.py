"""Figures of identification and validation, in the manner of the thesis's 3-2, 3-3 and 3-4."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mirte_drake.angles import rotation
from mirte_drake.errors import UserError
from mirte_drake.vectors import WHEELS, YAW
from mirte_drake.visualization.style import (
    BACKGROUND,
    FOREGROUND,
    FORMATS,
    MEASURED,
    PREDICTED,
    Line,
    write_figures,
)

MAX_MODELS = len(PREDICTED)  # That lines tell apart in black and white.

VALIDATION_FILES = tuple(
    f"validation_{what}.{suffix}" for what in ("pose", "velocity") for suffix in FORMATS
)

Predictions = Mapping[str, np.ndarray]  # One array (N, 3) per model, by its name.
Curve = tuple[str, np.ndarray, Line]  # Label, values (N, 3), style.

_VELOCITY_LABELS = ("$v_x$ [m/s]", "$v_y$ [m/s]", r"$\Omega$ [rad/s]")
_RATE_LABELS = (r"$\dot{x}_w$ [m/s]", r"$\dot{y}_w$ [m/s]", r"$\dot{\theta}$ [rad/s]")


def pose_figure(time: np.ndarray, measured: np.ndarray, predictions: Predictions) -> Figure:
    """Draws the path, and below it the yaw over time.

    Args:
        time: (N,) [s].
        measured: (N, 3) [m, m, rad] pose, yaw unwrapped.
        predictions: Pose (N, 3) by model; none for a training run.

    Raises:
        UserError: when there are more models than line styles.
    """
    figure = Figure(figsize=(5.2, 5.6), layout="constrained")
    path, yaw = figure.subplots(2, 1, height_ratios=(2.2, 1))
    for label, pose, style in _curves("measured", measured, predictions):
        path.plot(*pose[:, :2].T, label=label, **style)
        yaw.plot(time, pose[:, YAW], **style)
    path.plot(*measured[0, :2], "o", color="black", ms=4, label="start")
    path.set(xlabel="$x$ [m]", ylabel="$y$ [m]")
    path.set_aspect("equal", adjustable="datalim")
    yaw.set_ylabel(r"$\theta$ [rad]")
    _finish(figure, [yaw], time, path)
    return figure


def velocity_figure(time: np.ndarray, measured: np.ndarray, predictions: Predictions) -> Figure:
    """Draws the body velocities over time.

    Args:
        time: (N,) [s].
        measured: (N, 3) [m/s, m/s, rad/s] body velocity.
        predictions: Body velocity (N, 3) by model; none for a training run.

    Raises:
        UserError: when there are more models than line styles.
    """
    return _over_time(time, _VELOCITY_LABELS, _curves("measured", measured, predictions))


def derivative_figure(
    time: np.ndarray, estimated: np.ndarray, pose: np.ndarray, body_velocity: np.ndarray
) -> Figure:
    """Draws the estimated derivative of the pose against the measured velocity, world frame.

    Args:
        time: (N,) [s].
        estimated: (N, 3) [m/s, m/s, rad/s] derivative of the pose, as used in the regression.
        pose: (N, 3) [m, m, rad] measured; its yaw turns the velocity by (2-1).
        body_velocity: (N, 3) [m/s, m/s, rad/s] measured.
    """
    measured = np.einsum("kij,kj->ki", rotation(pose[:, YAW]), body_velocity)
    curves = [("measured", measured, BACKGROUND), ("estimated", estimated, FOREGROUND)]
    return _over_time(time, _RATE_LABELS, curves)


def wheel_command_figure(time: np.ndarray, wheel_command: np.ndarray) -> Figure:
    """Draws the wheel commands (N, 4) [PWM percent], held from sample to sample, over time [s]."""
    figure = Figure(figsize=(5.2, 5.2), layout="constrained")
    panels = figure.subplots(4, 1, sharex=True, sharey=True)
    for wheel, axes in enumerate(panels):
        axes.step(time, wheel_command[:, wheel], where="post", **MEASURED)
        axes.set_ylabel(f"$u_{wheel + 1}$ [%]")
        axes.set_title(WHEELS[wheel].replace("_", " "), loc="right", fontsize=9)
    _finish(figure, panels, time)
    return figure


def save_training_figures(
    folder: Path,
    *,
    time: np.ndarray,
    pose: np.ndarray,
    body_velocity: np.ndarray,
    wheel_command: np.ndarray,
    estimated_derivative: np.ndarray,
) -> list[Path]:
    """Writes the figures of a training run (3-2) as PDF, SVG and PNG; see the figures for shapes.

    Returns:
        The files written: training_pose, _velocity, _wheel_commands, _derivative.

    Raises:
        UserError: when the folder cannot be written.
    """
    figures: dict[str, Callable[[], Figure]] = {
        "training_pose": lambda: pose_figure(time, pose, {}),
        "training_velocity": lambda: velocity_figure(time, body_velocity, {}),
        "training_wheel_commands": lambda: wheel_command_figure(time, wheel_command),
        "training_derivative": lambda: derivative_figure(
            time, estimated_derivative, pose, body_velocity
        ),
    }
    return write_figures(figures, folder)


def save_validation_figures(
    folder: Path,
    *,
    time: np.ndarray,
    pose: np.ndarray,
    body_velocity: np.ndarray,
    predicted_poses: Predictions,
    predicted_velocities: Predictions,
    name: str = "validation",
) -> list[Path]:
    """Writes the figures of a validation run (3-3, 3-4) as PDF, SVG and PNG.

    Returns:
        The files written, of which names end in _pose and _velocity.

    Raises:
        UserError: when the folder cannot be written, or there are more models than line styles.
    """
    figures: dict[str, Callable[[], Figure]] = {
        f"{name}_pose": lambda: pose_figure(time, pose, predicted_poses),
        f"{name}_velocity": lambda: velocity_figure(time, body_velocity, predicted_velocities),
    }
    return write_figures(figures, folder)


def _curves(label: str, measured: np.ndarray, predictions: Predictions) -> list[Curve]:
    if len(predictions) > MAX_MODELS:
        raise UserError(f"figures show at most {MAX_MODELS} models, got {len(predictions)}")
    styled = zip(predictions.items(), PREDICTED, strict=False)
    names = [(name.replace("_", " "), values, style) for (name, values), style in styled]
    return [(label, measured, MEASURED), *names]


def _over_time(time: np.ndarray, labels: Sequence[str], curves: Sequence[Curve]) -> Figure:
    figure = Figure(figsize=(5.2, 4.8), layout="constrained")
    panels = figure.subplots(len(labels), 1, sharex=True)
    for entry, axes in enumerate(panels):
        for label, values, style in curves:
            axes.plot(time, values[:, entry], label=label, **style)
        axes.set_ylabel(labels[entry])
    _finish(figure, panels, time, panels[0] if len(curves) > 1 else None)
    return figure


def _finish(
    figure: Figure, panels: Sequence[Axes], time: np.ndarray, legend_of: Axes | None = None
) -> None:
    panels[-1].set_xlabel("time [s]")
    panels[-1].set_xlim(time[0], time[-1])
    figure.align_ylabels()
    if legend_of is not None:
        handles, labels = legend_of.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=3)
