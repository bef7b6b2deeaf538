import dataclasses as dc
import re

import numpy as np
import pytest

from mirte_drake.errors import UserError
from mirte_drake.visualization.comparison_figures import (
    MAX_SETTINGS,
    errors_figure,
    paths_figure,
    rmse_figure,
)
from mirte_drake.visualization.comparison_report import comparison_report


def rows(text):
    """Returns the cells of every row by its label, without notes."""
    found = {}
    for label, cells in re.findall(r'<tr><th scope="row">(.*?)<span.*?</th>(.*?)</tr>', text):
        values = re.findall(r'<td class="number( best)?">([^<]*)', cells)
        found[label] = [f"*{value}" if best else value for best, value in values]
    return found


def test_seeds_are_taken_together(reported_runs, blank_figures):
    names = ("rectangle", "rectangle_1", "baseline_rectangle")
    text = comparison_report({name: reported_runs[name] for name in names})
    assert "<h1>3 runs, 2 settings</h1>" in text
    assert "tube NMPC, sindyc robot, 2 runs" in text
    values = [1e3 * reported_runs[name].summary["rmse"]["y_m"] for name in names]
    median, baseline = np.median(values[:2]), values[2]
    table = text.split("All runs")[0]
    tube_cell, baseline_cell = (
        rows(table)[name][1] for name in ("rectangle", "baseline_rectangle")
    )
    marks = ("*", "") if median < baseline else ("", "*")
    assert (tube_cell, baseline_cell) == (f"{marks[0]}{median:.1f}", f"{marks[1]}{baseline:.1f}")
    assert f"{min(values[:2]):.1f}–{max(values[:2]):.1f}" in table
    assert rows(text.split("All runs")[1]).keys() == set(names)


def test_true_columns_only_where_odometry_measures(reported_runs, blank_figures):
    one = {name: reported_runs[name] for name in ("rectangle", "baseline_rectangle")}
    assert "RMSE, true" not in comparison_report(one)
    both = {name: reported_runs[name] for name in ("rectangle", "dynamic")}
    text = comparison_report(both)
    assert "RMSE, true" in text
    cells = rows(text)
    assert cells["rectangle, sindyc"][3:6] == ["-"] * 3
    true = reported_runs["dynamic"].summary["true_rmse"]["x_m"]
    assert cells["rectangle, dynamic"][3] == f"{1e3 * true:.1f}"


def test_each_path_has_its_own_section(reported_runs, blank_figures):
    names = ("rectangle", "circle", "baseline_rectangle")
    text = comparison_report({name: reported_runs[name] for name in names})
    assert re.findall(r"<h2 id=\"path.*?>(.*?)</h2>", text) == [
        "rectangle, baseline_rectangle", "circle"
    ]  # fmt: skip
    assert text.count('<figure class="plot">') == 8


def test_a_controller_that_does_not_plan_has_no_solves(reported_runs, blank_figures):
    names = ("rectangle", "pid_rectangle")
    text = comparison_report({name: reported_runs[name] for name in names})
    assert rows(text)["pid_rectangle"][-3:] == ["-"] * 3
    assert rows(text)["rectangle"][-1] == "0"
    assert "pose PID, sindyc robot" in text


def test_settings_that_names_do_not_tell_apart_go_by_their_folders(reported_runs, blank_figures):
    run = reported_runs["rectangle"]
    other = dc.replace(run, scenario=run.scenario.replace("horizon: 10", "horizon: 12"))
    text = comparison_report({"runs/a": run, "runs/b": other})
    assert rows(text).keys() == {"runs/a", "runs/b"}


def test_more_settings_than_lines_is_an_error(reported_runs):
    run = reported_runs["rectangle"]
    many = {f"r{i}": dc.replace(run, scenario=f"horizon: {i}") for i in range(MAX_SETTINGS + 1)}
    with pytest.raises(UserError, match=f"at most {MAX_SETTINGS} settings apart, got 7: r0, r1"):
        comparison_report(many)


def test_runs_lie_over_their_reference(reported_runs):
    logs = {name: [reported_runs[name].log] for name in ("rectangle", "baseline_rectangle")}
    (axes,) = paths_figure(logs).axes
    tube, baseline, reference = axes.get_lines()
    np.testing.assert_array_equal(tube.get_xydata(), logs["rectangle"][0]["pose"][:, :2])
    np.testing.assert_array_equal(
        baseline.get_xydata(), logs["baseline_rectangle"][0]["pose"][:, :2]
    )
    np.testing.assert_array_equal(reference.get_xydata(), logs["rectangle"][0]["reference"][:, :2])


def test_a_setting_has_one_line_style_and_one_entry_in_the_legend(reported_runs):
    runs = [reported_runs[name].log for name in ("rectangle", "rectangle_1")]
    figure = errors_figure({"tube": runs, "other": [reported_runs["baseline_rectangle"].log]})
    first, second, other, _ = figure.axes[0].get_lines()
    assert first.get_color() == second.get_color() != other.get_color()
    np.testing.assert_allclose(
        second.get_ydata(), runs[1]["pose"][:, 0] - runs[1]["reference"][:, 0]
    )
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["tube", "other"]


def test_rmse_has_a_dot_for_each_run_and_a_bar_for_the_median():
    values = np.array([[1e-3, 2e-3, 3e-3], [3e-3, 4e-3, 5e-3], [4e-3, 9e-3, 6e-3]])
    panels = rmse_figure({"tube": values}).axes
    dots, median = panels[1].get_lines()
    np.testing.assert_allclose(dots.get_xdata(), [2, 4, 9])
    np.testing.assert_allclose(median.get_xdata(), [4])
