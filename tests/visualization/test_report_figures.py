import numpy as np

from mirte_drake.visualization.report_figures import coverage_figure, solve_time_figure, tube_figure

COUNT = 20
LOG = {
    "time": 0.1 * np.arange(COUNT),
    "solve_time_s": np.linspace(1e-3, 2e-3, COUNT),
}


def line(axes, label):
    return next(item for item in axes.get_lines() if item.get_label() == label)


def test_who_leaves_the_tube_is_marked_and_counted():
    error, bound = np.zeros((COUNT - 1, 3)), np.full((COUNT - 1, 3), 0.1)
    error[3, 1], error[8, 1] = 0.11, -0.1  # The second is on the edge.
    panels = tube_figure(LOG["time"], error, bound, np.abs(error) > bound).axes
    titles = [axes.get_title(loc="right") for axes in panels]
    assert titles == ["outside 0 of 19", "outside 1 of 19", "outside 0 of 19"]
    np.testing.assert_allclose(line(panels[1], "outside").get_xydata(), [[0.4, 0.11]])
    np.testing.assert_allclose(line(panels[1], "robot").get_ydata(), error[:, 1])


def test_velocities_stand_beside_their_axes():
    error = np.tile(np.arange(6.0), (COUNT - 1, 1))
    bound = np.full(error.shape, 4.5)
    panels = tube_figure(LOG["time"], error, bound, error > bound).axes
    shown = [(axes.get_ylabel(), line(axes, "robot").get_ydata()[0]) for axes in panels]
    assert [value for _, value in shown] == [0, 3, 1, 4, 2, 5]
    assert [label.partition("[")[2] for label, _ in shown] == [
        *("m]", "m/s]", "m]", "m/s]", "rad]", "rad/s]")
    ]
    assert [axes.get_title(loc="right")[:9] for axes in panels] == ["outside 0"] * 5 + ["outside 1"]


def test_solve_times_stand_against_the_period():
    (axes,) = solve_time_figure(LOG, 0.1).axes
    np.testing.assert_allclose(line(axes, "solve").get_ydata(), np.linspace(1, 2, COUNT))
    for label, value in (("median: 1.5 ms", 1.5), ("99 %: 2 ms", 1.99), ("period: 100 ms", 100)):
        np.testing.assert_allclose(line(axes, label).get_ydata(), value)


def test_coverage_of_both_sets_and_the_size_of_the_calibrated_one():
    coverage = np.column_stack([np.linspace(0.5, 1.0, COUNT), np.full(COUNT, 0.9)])
    bound = np.linspace(1.0, 3.0, COUNT)[:, None] * [0.04, 0.03, 0.09]
    log = {**LOG, "coverage": coverage, "calibrated_bound": bound}
    shares, size = coverage_figure(log, 0.9, np.array([0.02, 0.015, 0.045])).axes
    np.testing.assert_allclose(line(shares, "set in use").get_ydata(), 100 * coverage[:, 0])
    np.testing.assert_allclose(line(shares, "calibrated").get_ydata(), 90.0)
    np.testing.assert_allclose(line(shares, "target: 90 %").get_ydata(), 90.0)
    np.testing.assert_allclose(size.get_lines()[0].get_ydata(), np.linspace(2.0, 6.0, COUNT))
