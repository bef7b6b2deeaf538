"""Every example runs as a script in an empty folder and shows what it says."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.py"))

# What each example must print: numbers are checked where they mean something.
EXPECTED = {
    "run_a_study": r"rectangle +RMSE x 0\.00\d\d m, y 0\.01\d\d m\nbaseline_rectangle",
    "one_system_alone": r"after 5\.0 s: \+-0\.0149 m, \+-0\.0246 m, \+-0\.0137 rad",
    "own_robot": r"position error: mean 0\.01\d\d m, largest 0\.02\d\d m",
    "export_the_picture": r"rectangle\.svg\n(.*\n)+.*controller\.dot",
}


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs_in_an_empty_folder(path, tmp_path):
    done = subprocess.run([sys.executable, path], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert re.search(EXPECTED[path.stem], done.stdout), done.stdout


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_is_short(path):
    assert 20 <= len(path.read_text().splitlines()) <= 65
