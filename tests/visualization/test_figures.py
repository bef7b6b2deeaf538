import numpy as np
import pytest

from mirte_drake.run import simulate
from mirte_drake.scenario_file import load_scenario
from mirte_drake.visualization.figures import (
    error_figure,
    input_figure,
    path_figure,
    save_figures,
)


@pytest.fixture(scope="module")
def logs():
    return {
        name: simulate(load_scenario(name, ["duration=2"]), name).log
        for name in ("rectangle", "baseline_rectangle", "pid_rectangle")
    }


def line(axes, label):
    return next(item for item in axes.get_lines() if item.get_label() == label)


def test_path_figure_draws_the_log(logs):
    log = logs["rectangle"]
    (axes,) = path_figure(log).axes
    for label, key in (("reference", "reference"), ("nominal", "nominal_pose"), ("actual", "pose")):
        np.testing.assert_array_equal(line(axes, label).get_xydata(), log[key][:, :2])
    tube = axes.collections[0]
    assert len(tube.get_paths()) == len(log["time"])
    box = tube.get_paths()[7].get_extents()
    np.testing.assert_allclose([box.width, box.height], 2 * log["half_width"][7, :2], rtol=1e-9)
    center = [(box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2]
    np.testing.assert_allclose(center, log["nominal_pose"][7, :2], atol=1e-12)


def test_baseline_path_has_no_tube(logs):
    (axes,) = path_figure(logs["baseline_rectangle"]).axes
    assert not axes.collections


def test_lines_differ_without_colour(logs):
    (axes,) = path_figure(logs["rectangle"]).axes
    styles = [str(line(axes, label)._unscaled_dash_pattern) for label in
              ("reference", "nominal", "actual")]  # fmt: skip
    assert len(set(styles)) == 3


def test_error_figure_has_the_rmse_in_its_titles(logs):
    log = logs["rectangle"]
    rmse = np.sqrt(np.mean((log["pose"] - log["reference"]) ** 2, axis=0))
    titles = [axes.get_title(loc="right") for axes in error_figure(log).axes]
    assert titles == [f"RMSE {v:.4f} {u}" for v, u in zip(rmse, ("m", "m", "rad"), strict=True)]


def test_input_figure_has_four_wheels_with_their_bounds(logs):
    log = logs["rectangle"]
    panels = input_figure(log, 100.0).axes
    wheels = [axes.get_title(loc="right") for axes in panels]
    assert wheels == ["front left", "front right", "rear right", "rear left"]
    for wheel, axes in enumerate(panels):
        np.testing.assert_array_equal(
            line(axes, "applied").get_ydata(), log["applied_input"][:, wheel]
        )
        np.testing.assert_array_equal(
            line(axes, "tightened bounds").get_ydata(), log["input_lower"][:, wheel]
        )


@pytest.mark.slow
def test_the_same_log_gives_the_same_files(logs, tmp_path):
    for folder in ("one", "two"):
        save_figures(logs["rectangle"], tmp_path / folder, input_limit=100.0)
    files = sorted(p.name for p in (tmp_path / "one").iterdir())
    assert len(files) == 9
    for name in files:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_where_the_robot_really_was_is_drawn_only_where_it_differs(logs):
    log = logs["rectangle"]
    elsewhere = {**log, "true_pose": log["pose"] + [0.1, 0.2, 0.3]}
    (axes,) = path_figure(elsewhere).axes
    np.testing.assert_array_equal(line(axes, "true").get_xydata(), elsewhere["true_pose"][:, :2])
    assert line(axes, "measured") is not None
    panels = error_figure(elsewhere).axes
    error = line(panels[2], "true").get_ydata() - line(panels[2], "measured").get_ydata()
    np.testing.assert_allclose(error, 0.3)
    assert ", true " in panels[0].get_title(loc="right")
    unknown = {key: value for key, value in log.items() if key != "true_pose"}  # On a wire.
    for same in (log, unknown):
        labels = [item.get_label() for item in path_figure(same).axes[0].get_lines()]
        assert "actual" in labels and "true" not in labels


def test_a_flat_path_has_a_flat_figure(logs):
    log = logs["rectangle"]  # Two seconds: a straight line.
    round_ = {**log, "pose": np.random.default_rng(1).normal(size=(21, 3))}
    assert path_figure(log).get_figheight() < 0.6 * path_figure(round_).get_figheight()


def test_a_controller_that_does_not_plan_has_neither_nominal_path_nor_bounds(logs, tmp_path):
    log = logs["pid_rectangle"]
    (axes,) = path_figure(log).axes
    assert not axes.collections
    labels = {item.get_label() for item in axes.get_lines()}
    assert {"reference", "actual"} <= labels and "nominal" not in labels
    for axes in input_figure(log, 100.0).axes:
        assert not axes.collections
        np.testing.assert_array_equal(line(axes, "applied").get_xdata(), log["time"])
    assert len(save_figures(log, tmp_path, input_limit=100.0)) == 9
