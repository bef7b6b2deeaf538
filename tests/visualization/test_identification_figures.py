import numpy as np
import pytest

from mirte_drake.angles import rotation
from mirte_drake.errors import UserError
from mirte_drake.visualization.identification_figures import (
    derivative_figure,
    pose_figure,
    save_training_figures,
    save_validation_figures,
    velocity_figure,
    wheel_command_figure,
)

MODELS = ("kinematic", "extended_kinematic", "dynamic")
TIME = 0.1 * np.arange(50)
RNG = np.random.default_rng(1)
POSE = np.cumsum(0.1 * RNG.normal(size=(50, 3)), axis=0)
VELOCITY = RNG.normal(size=(50, 3))
COMMAND = RNG.uniform(-50, 50, size=(50, 4))
POSES = {name: POSE + 0.1 * (i + 1) for i, name in enumerate(MODELS)}
VELOCITIES = {name: VELOCITY + 0.1 * (i + 1) for i, name in enumerate(MODELS)}


def line(axes, label):
    return next(item for item in axes.get_lines() if item.get_label() == label)


def legend_labels(figure):
    (legend,) = figure.legends
    return [text.get_text() for text in legend.get_texts()]


def test_pose_figure_draws_path_and_yaw():
    figure = pose_figure(TIME, POSE, POSES)
    path, yaw = figure.axes
    np.testing.assert_array_equal(line(path, "measured").get_xydata(), POSE[:, :2])
    for name in MODELS:
        label = name.replace("_", " ")
        np.testing.assert_array_equal(line(path, label).get_xydata(), POSES[name][:, :2])
    np.testing.assert_array_equal(yaw.get_lines()[2].get_xydata().T, [TIME, POSES[MODELS[1]][:, 2]])
    expected = ["measured", "kinematic", "extended kinematic", "dynamic", "start"]
    assert legend_labels(figure) == expected


def test_velocity_figure_has_one_panel_per_velocity():
    figure = velocity_figure(TIME, VELOCITY, VELOCITIES)
    for entry, axes in enumerate(figure.axes):
        np.testing.assert_array_equal(line(axes, "measured").get_ydata(), VELOCITY[:, entry])
        np.testing.assert_array_equal(
            line(axes, "dynamic").get_ydata(), VELOCITIES["dynamic"][:, entry]
        )
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["$v_x$ [m/s]", "$v_y$ [m/s]", r"$\Omega$ [rad/s]"]


def test_lines_differ_without_colour():
    five = {str(i): POSE + i for i in range(5)}
    path, _ = pose_figure(TIME, POSE, five).axes
    styles = [str(curve._unscaled_dash_pattern) for curve in path.get_lines()[:6]]
    assert len(set(styles)) == 6


def test_more_models_than_line_styles_is_an_error():
    with pytest.raises(UserError, match="at most 5 models, got 6"):
        pose_figure(TIME, POSE, {str(i): POSE for i in range(6)})


def test_derivative_figure_compares_in_the_world_frame():
    axes = derivative_figure(TIME, 2 * VELOCITY, POSE, VELOCITY).axes
    world = np.array([rotation(p[2]) @ v for p, v in zip(POSE, VELOCITY, strict=True)])
    for entry, panel in enumerate(axes):
        np.testing.assert_allclose(line(panel, "measured").get_ydata(), world[:, entry])
        np.testing.assert_array_equal(line(panel, "estimated").get_ydata(), 2 * VELOCITY[:, entry])


def test_wheel_commands_are_held():
    panels = wheel_command_figure(TIME, COMMAND).axes
    assert [p.get_title(loc="right") for p in panels] == [
        "front left", "front right", "rear right", "rear left"
    ]  # fmt: skip
    for wheel, panel in enumerate(panels):
        (curve,) = panel.get_lines()
        assert curve.get_drawstyle() == "steps-post"
        np.testing.assert_array_equal(curve.get_ydata(), COMMAND[:, wheel])


def test_a_legend_fits_into_the_figure(tmp_path):
    for figure in (pose_figure(TIME, POSE, POSES), velocity_figure(TIME, VELOCITY, VELOCITIES)):
        figure.savefig(tmp_path / "figure.png", dpi=50)
        box = figure.legends[0].get_window_extent()
        assert box.x0 >= 0
        assert box.x1 <= figure.bbox.x1


def test_files_written(tmp_path, monkeypatch):
    # That the same figure gives the same file in all formats is tested in test_figures.
    monkeypatch.setattr("mirte_drake.visualization.style.FORMATS", ("svg",))
    written = save_validation_figures(
        tmp_path, time=TIME, pose=POSE, body_velocity=VELOCITY, predicted_poses=POSES,
        predicted_velocities=VELOCITIES, name="rectangle",
    )  # fmt: skip
    written += save_training_figures(
        tmp_path, time=TIME, pose=POSE, body_velocity=VELOCITY, wheel_command=COMMAND,
        estimated_derivative=VELOCITY,
    )  # fmt: skip
    assert all(path.stat().st_size > 5000 for path in written)
    stems = ["rectangle_pose", "rectangle_velocity", "training_pose", "training_velocity",
             "training_wheel_commands", "training_derivative"]  # fmt: skip
    assert written == [tmp_path / f"{stem}.svg" for stem in stems]
