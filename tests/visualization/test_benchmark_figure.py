import numpy as np
import pytest

from mirte_drake.visualization.benchmark_figure import (
    BENCHMARK_FILES,
    benchmark_figure,
    save_benchmark_figure,
)

HORIZONS = (10, 20, 50)


@pytest.fixture
def numbers():
    rng = np.random.default_rng(0)
    times = {"realtime": 1e-4, "snopt": 7e-3, "casadi_ipopt": 3e-3}
    solve_time = {name: t * rng.lognormal(0.0, 0.2, 200) for name, t in times.items()}
    scaling = {name: t * np.array([1.0, 3.0, 9.0]) for name, t in times.items()}
    scaling["snopt"][2] = np.nan
    after_pause = {name: 1.5 * times[:20] for name, times in solve_time.items()}
    return solve_time, after_pause, scaling


def test_figure_draws_the_numbers(numbers):
    solve_time, after_pause, scaling = numbers
    left, right = benchmark_figure(solve_time, after_pause, 0.1, HORIZONS, scaling).axes
    labels = [label.get_text() for label in left.get_yticklabels()]
    assert labels == ["snopt", "casadi ipopt", "realtime"]  # The fastest on top.
    medians = [
        line.get_xydata()[0] for line in left.get_lines()
        if line.get_marker() == "o" and len(line.get_xdata())
    ]  # fmt: skip
    names = ("snopt", "casadi_ipopt", "realtime")
    expected = [
        [1e3 * np.median(times[name]), level]
        for times in (solve_time, after_pause)
        for level, name in enumerate(names)
    ]
    np.testing.assert_allclose(medians, expected)
    for name, values in scaling.items():
        label = name.replace("_", " ")
        line = next(line for line in right.get_lines() if line.get_label() == label)
        np.testing.assert_allclose(line.get_ydata(), 1e3 * values)
    for axes, at in ((left, "get_xdata"), (right, "get_ydata")):
        dotted = [line for line in axes.get_lines() if line.get_linestyle() == ":"]
        np.testing.assert_allclose(getattr(dotted[0], at)(), 100.0)


def test_lines_differ_without_colour(numbers):
    _, right = benchmark_figure(*numbers[:2], 0.1, HORIZONS, numbers[2]).axes
    lines = [line for line in right.get_lines() if not line.get_label().startswith("_")]
    styles = {(line.get_marker(), str(line._unscaled_dash_pattern)) for line in lines}
    assert len(styles) == len(lines) == 3


def test_one_solver_and_equal_times_are_drawn(tmp_path):
    unknown = {"snopt": np.full(3, np.nan)}
    times = {"snopt": np.full(5, 1e-3)}
    paths = save_benchmark_figure(times, times, 0.1, HORIZONS, unknown, tmp_path)
    assert sorted(path.name for path in paths) == sorted(BENCHMARK_FILES)
    assert (tmp_path / "benchmark.png").read_bytes().startswith(b"\x89PNG")
