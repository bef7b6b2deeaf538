"""Every example runs as a script in an empty folder and prints what its docstring says."""

import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
SLOW = (  # Over 5 s, or in real time.
    "04_harder_robots",
    "06_from_data_to_drive",
    "08_drive_over_the_wire",
    "13_recover_a_known_model",
    "16_tune_a_controller",
)
NUMBER = r"\d+(?:\.\d+)?"

sys.path.insert(0, str(ROOT / "docs" / "extensions"))
from example_parts import parts  # noqa: E402 The site shows them by the same parts.


def example(name: str) -> Path:
    (path,) = (path for path in EXAMPLES if path.stem.endswith(name))
    return path


def check_output(printed: str, expected: str) -> None:
    """Compares words exactly and numbers up to what another processor may round differently."""
    words = [re.sub(NUMBER, "#", text).split() for text in (printed, expected)]
    assert words[0] == words[1], printed
    for value, said in zip(re.findall(NUMBER, printed), re.findall(NUMBER, expected), strict=True):
        last_digit = 10.0 ** -len(said.partition(".")[2])
        assert float(value) == pytest.approx(float(said), rel=0.1, abs=1.5 * last_digit), printed


def marks(name: str) -> list:
    """Returns the marks of an example: slow, or in real time, and then one after the other."""
    found = [pytest.mark.slow] if name in SLOW else []
    return [*found, pytest.mark.xdist_group("wire")] if name.endswith("wire") else found


@pytest.mark.parametrize(
    "path",
    [pytest.param(path, id=path.stem, marks=marks(path.stem)) for path in EXAMPLES],
)
def test_example_runs_in_an_empty_folder(path, tmp_path):
    done = subprocess.run([sys.executable, path], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    _, _, expected = parts(path.read_text())
    assert expected, "the docstring does not say what it prints"
    check_output(done.stdout, expected)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_is_short(path):
    _, code, _ = parts(path.read_text())
    assert 10 <= len(code.splitlines()) <= 60


@pytest.mark.slow
def test_recovery_gets_better_with_less_noise_and_more_data(tmp_path):
    """Errors of noises 0.2, 0.1, 0.05, 0.02 by durations 60, 120, 240 s, means over seeds."""
    results = runpy.run_path(str(example("recover_a_known_model")))["main"](tmp_path)
    errors, supports = results[..., 0].mean(axis=-1), results[..., 1].mean(axis=-1)
    assert np.all(np.diff(errors, axis=0) < 0)
    assert np.all(np.diff(errors, axis=1) < 0)
    assert np.all(supports[-1] == 1.0)
    assert (tmp_path / "recover_a_known_model.svg").is_file()


@pytest.mark.parametrize(
    ("printed", "differs"),
    [("RMSE 0.0120 m", False), ("RMSE 0.0140 m", True), ("error 0.0123 m", True)],
)
def test_the_comparison_of_outputs_can_fail(printed, differs):
    if differs:
        with pytest.raises(AssertionError):
            check_output(printed, "RMSE 0.0123 m")
    else:
        check_output(printed, "RMSE 0.0123 m")
