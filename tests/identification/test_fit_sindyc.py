import dataclasses as dc
import math
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from mirte_drake.errors import UserError
from mirte_drake.identification.differentiation import TvrConfig
from mirte_drake.identification.fit_sindyc import (
    identify,
    regression_problem,
    search_thresholds,
)
from mirte_drake.identification.model_structure import KINDS, model_structure
from mirte_drake.identification.recorded_run import RecordedRun, load_recorded_run
from mirte_drake.identification.synthetic_recording import (
    SyntheticRecordingConfig,
    synthetic_recording,
)
from mirte_drake.model.model_file import load_model, load_model_file, save_model_file

PUBLISHED = ("kinematic", "extended_kinematic", "dynamic")


@pytest.fixture(scope="module")
def training(recordings):
    return load_recorded_run(recordings / "training_data.csv")


def units_of_the_fifth_digit(found: float, printed: float) -> float:
    return abs(found - printed) / 10 ** (math.floor(math.log10(abs(printed))) - 4)


@pytest.mark.parametrize(
    "kind", [*PUBLISHED[:-1], pytest.param(PUBLISHED[-1], marks=pytest.mark.slow)]
)
def test_published_mode_gives_the_published_coefficients(training, kind):
    """The model files of the package and the recording belong together."""
    found, published = identify(training, kind, "published"), load_model_file(kind)
    assert found.states == published.states and found.auxiliaries == published.auxiliaries
    assert found.identification.data_sha256 == published.identification.data_sha256
    for state, table in published.derivatives.items():
        assert set(found.derivatives[state]) == set(table)
        for term, printed in table.items():
            assert units_of_the_fifth_digit(found.derivatives[state][term], printed) <= 2.0


@pytest.mark.parametrize(
    "kind", [pytest.param("kinematic", marks=pytest.mark.slow), "extended_kinematic"]
)
def test_pysindy_finds_the_same(training, kind):
    """Its STLSQ without a threshold of its own, looped with ours outside: see its documentation.

    Its own ``normalize_columns`` would compare the threshold with the scaled coefficients.
    """
    pysindy = pytest.importorskip("pysindy", reason="independent check needs pip install pysindy")
    problem = regression_problem(training, kind, "published")
    found = identify(training, kind, "published")
    for state, names in problem.structure.candidates.items():
        Theta, y = problem.terms[state], problem.derivatives[state]
        active = np.ones(len(names), dtype=bool)
        for _ in range(10):
            optimizer = pysindy.STLSQ(threshold=0, alpha=1e-5, normalize_columns=True, unbias=False)
            optimizer.fit(Theta[:, active], y[:, None])
            xi = np.zeros(len(names))
            xi[active] = optimizer.coef_[0]
            active = np.abs(xi) >= problem.structure.thresholds[state]
            if np.array_equal(active, xi != 0):
                break
        table = {name: value for name, value in zip(names, xi, strict=True) if value != 0}
        assert set(table) == set(found.derivatives[state])
        for name, value in table.items():
            assert value == pytest.approx(found.derivatives[state][name], rel=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_converged_mode_gives_a_model_that_saves_and_drives(training, kind, tmp_path):
    found = identify(training, kind, date="2025-08-25")
    save_model_file(found, tmp_path / "model.yaml")
    model = load_model(tmp_path / "model.yaml")
    assert model.num_states == (6 if "dynamic" in kind else 3)
    x = np.zeros(model.num_states)
    for _ in range(20):  # Two seconds forward at 50 %.
        x = model.step(x, np.full(4, 50.0), 0.1)
    assert 0.4 < x[0] < 1.2 and abs(x[1]) < 0.3 and abs(x[2]) < 0.6
    assert all(0 < score < 1 for score in found.training_scores.values())


def test_converged_mode_is_quick(training):
    start = time.process_time()
    for kind in PUBLISHED:
        identify(training, kind)
    assert time.process_time() - start < 1.0


def test_the_search_returns_tables_and_their_best(training):
    best, tables = search_thresholds(training, "extended_kinematic")
    assert set(best) == {"x", "y", "theta"}
    for state, rows in tables.items():
        terms = [row.terms for row in rows]
        assert terms == sorted(terms, reverse=True)
        assert best[state] in [row.threshold for row in rows]
    assert identify(training, "extended_kinematic", thresholds=best).derivatives["theta"]


def test_the_structures_are_those_of_the_tables():
    kinematic = model_structure("kinematic").candidates
    assert len(kinematic["x"]) == len(kinematic["y"]) == 8 and len(kinematic["theta"]) == 4
    extended = model_structure("extended_kinematic").candidates
    assert len(extended["x"]) == 4 + 10 + 8 and len(extended["theta"]) == 4 + 10
    dynamic = model_structure("dynamic").candidates
    assert len(dynamic["x_dot"]) == 10 and "cos(theta)*vx" in dynamic["x_dot"]
    assert "sin(theta)*vx" in dynamic["y_dot"] and dynamic["theta_dot"][0] == "yaw_rate"
    assert len(model_structure("extended_dynamic").candidates["x_dot"]) == 21
    with pytest.raises(ValueError, match="extended_dynamic"):
        model_structure("magic")


def test_without_noise_the_held_input_is_recovered_nearly_exactly():
    """Means over a sample belong to the input held over it: no bias but the differentiation's."""
    config = SyntheticRecordingConfig(quantised=False)
    truth = load_model_file("kinematic").derivatives
    run = synthetic_recording(load_model("kinematic"), config)
    found = identify(run, "kinematic", tvr=TvrConfig(alpha=1e-6)).derivatives
    for state, table in truth.items():
        assert set(found[state]) == set(table)
        error = np.linalg.norm([found[state][term] - table[term] for term in table])
        assert error < 0.005 * np.linalg.norm(list(table.values()))


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").is_file(), reason="asks /proc for its memory")
def test_a_hundred_thousand_samples_cost_in_proportion():
    """All three models: ten times the samples in ten times the time, and within 500 MB.

    In a process of its own, whose ``ru_maxrss`` would be that of the one which started it, where
    that is larger. How fast it is depends on what else is running, so times are a ratio.
    """
    code = """
import re, time, numpy as np
from mirte_drake.identification.fit_sindyc import identify
from mirte_drake.identification.recorded_run import RecordedRun
def cost(n):
    rng = np.random.default_rng(0)
    command = np.repeat(rng.uniform(-100, 100, (n // 20, 4)), 20, axis=0)
    velocity = command @ (1e-3 * rng.normal(size=(4, 3)))
    run = RecordedRun(0.1 * np.arange(n), 0.1 * np.cumsum(velocity, axis=0), velocity, command)
    start = time.process_time()
    for kind in ("kinematic", "extended_kinematic", "dynamic"):
        identify(run, kind)
    return time.process_time() - start
cost(1000)  # Loads what is loaded once.
few, many = cost(10_000), cost(100_000)
memory = re.search(r"VmHWM:\\s+(\\d+) kB", open("/proc/self/status").read())
print(many / few, memory[1])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    ratio, kilobytes = map(float, done.stdout.split())
    assert ratio < 15.0
    assert kilobytes < 500_000


def still_run() -> RecordedRun:
    n = 50
    return RecordedRun(0.1 * np.arange(n), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 4)))


@pytest.mark.parametrize("use", [identify, search_thresholds])
def test_a_recording_without_motion_is_a_user_error(use):
    with pytest.raises(UserError, match="record more motion"):
        use(still_run(), "kinematic")


def test_a_wheel_that_rests_while_thresholds_are_fitted_is_a_user_error(training):
    """It moves in the held-out end of the run alone."""
    command = training.wheel_command.copy()
    command[:700, 2] = 0.0
    with pytest.raises(UserError, match="record more motion"):
        search_thresholds(dc.replace(training, wheel_command=command), "kinematic")


def test_a_threshold_that_leaves_nothing_is_a_user_error(training):
    with pytest.raises(UserError, match=r"leaves no term; lower it"):
        identify(training, "kinematic", thresholds={"x": 1.0, "y": 1.0, "theta": 1.0})
