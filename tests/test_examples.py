"""Every example runs as a script in an empty folder and shows what it says."""

import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.py"))

# What each example must print: numbers are checked where they mean something.
EXPECTED = {
    "run_a_study": r"rectangle +RMSE x 0\.00\d\d m, y 0\.01\d\d m\nbaseline_rectangle",
    "one_system_alone": r"after 5\.0 s: \+-0\.0149 m, \+-0\.0246 m, \+-0\.0137 rad",
    "own_robot": r"position error: mean 0\.01\d\d m, largest 0\.02\d\d m",
    "recover_a_known_model": r"240 s: error .*; support found in .* 100%",
    "from_data_to_drive": (
        r"identified model, second drive: velocity RMSE 0\.0[78]\d 0\.0[78]\d 0\.3\d\d\n"
        r"published model, second drive: velocity RMSE 0\.0[89]\d 0\.1[45]\d 0\.4\d\d\n"
        r"disturbance bound: 0\.1\d\d 0\.1\d\d 0\.6\d\d m/s, m/s, rad/s, holds in 9\d%.*\n"
        r"rectangle, identified model: rmse x 0\.00\d\d m, y 0\.00\d\d m, .*\n"
        r"rectangle, identified model: true_rmse x 0\.00\d\d m, y 0\.00\d\d m, .*\n"
        r"rectangle, identified model: outside the tube in 0 of 250 samples\n"
    ),
    "tune_a_controller": r"cost \d+\.\d mm by PoseLqrConfig\(state_weight=array\(\[",
    "export_the_picture": r"rectangle\.svg\n(.*\n)+.*controller\.dot",
}

SLOW = ("from_data_to_drive", "tune_a_controller")  # Half a minute.


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, id=path.stem, marks=[pytest.mark.slow] if path.stem in SLOW else [])
        for path in EXAMPLES
    ],
)
def test_example_runs_in_an_empty_folder(path, tmp_path):
    done = subprocess.run([sys.executable, path], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert re.search(EXPECTED[path.stem], done.stdout), done.stdout


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_is_short(path):
    assert 20 <= len(path.read_text().splitlines()) <= 61


@pytest.mark.slow
def test_recovery_gets_better_with_less_noise_and_more_data(tmp_path):
    """Errors of noises 0.2, 0.1, 0.05, 0.02 by durations 60, 120, 240 s, means over seeds."""
    path = Path(__file__).parents[1] / "examples" / "recover_a_known_model.py"
    results = runpy.run_path(str(path))["main"](tmp_path)
    errors, supports = results[..., 0].mean(axis=-1), results[..., 1].mean(axis=-1)
    assert np.all(np.diff(errors, axis=0) < 0)
    assert np.all(np.diff(errors, axis=1) < 0)
    assert np.all(supports[-1] == 1.0)
    assert (tmp_path / "recover_a_known_model.svg").is_file()
