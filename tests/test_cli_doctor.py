import importlib.metadata

import pytest
from cli_runner import run_cli

from mirte_drake.doctor import parts, timing
from mirte_drake.doctor.finding import Finding, Grade

GOOD = Finding("part", Grade.GOOD, "is there")


@pytest.fixture
def quick(monkeypatch):
    """A sound machine, looked over in no time."""
    monkeypatch.setattr(parts, "check_wires", lambda: [GOOD])
    monkeypatch.setattr(timing, "check_timer", lambda period: GOOD)
    monkeypatch.setattr(timing, "check_solves", lambda scenario, on_sample: GOOD)
    return monkeypatch


def test_a_sound_machine_ends_with_0(capsys, quick):
    code, out, _ = run_cli(capsys, "doctor")
    assert code == 0
    words = [line.split()[1] for line in out.splitlines() if line.startswith(" ok")]
    assert {"Python", "drake", "SNOPT", "IPOPT", "compiled", "part"} <= set(words)
    assert "BAD" not in out


def test_what_is_bad_ends_with_1_and_names_it(capsys, quick):
    slow = Finding("solve time", Grade.BAD, "200 ms", "a longer period")
    quick.setattr(timing, "check_solves", lambda scenario, on_sample: slow)
    code, out, err = run_cli(capsys, "doctor")
    assert code == 1
    assert "BAD  solve time      200 ms\n                     a longer period\n" in out
    assert err.endswith("Error: solve time: see the remedies above\n")


def test_a_missing_package_ends_with_1(capsys, quick):
    real = importlib.metadata.version

    def version(name):
        if name == "scipy":
            raise importlib.metadata.PackageNotFoundError(name)
        return real(name)

    quick.setattr(importlib.metadata, "version", version)
    code, out, err = run_cli(capsys, "doctor")
    assert code == 1 and "Error: scipy: see" in err
    assert "BAD  scipy           is not installed\n" in out
    assert "pip install 'scipy" in out
    assert "SNOPT" not in out  # What follows would need it.


def test_what_not_everybody_needs_ends_with_0(capsys, quick):
    lacking = Finding("ROS 2 wire", Grade.LACKING, "cannot be used", "pip install it")
    quick.setattr(parts, "check_wires", lambda: [lacking])
    code, out, _ = run_cli(capsys, "doctor")
    assert code == 0 and "  -  ROS 2 wire      cannot be used\n" in out


@pytest.mark.slow
def test_this_machine(capsys):
    code, out, _ = run_cli(capsys, "doctor")
    assert code in (0, 1)
    assert "ms p99" in out and "of 100 ms" in out
