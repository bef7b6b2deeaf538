import json
import os
import subprocess
import sys

import numpy as np
import pytest
from cli_runner import check_wrong_use, run_cli

from mirte_drake.cli import commands
from mirte_drake.scenario_file import scenario_names

QUICK = ["--set", "duration=0.5", "--no-plots"]


def test_simulate_writes_what_the_contract_says(tmp_path, capsys):
    code, out, _ = run_cli(capsys, "simulate", "circle", "--seed", 3, *QUICK, "--output", tmp_path)
    assert code == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["scenario"], summary["seed"], summary["steps"]) == ("circle", 3, 6)
    with np.load(tmp_path / "log.npz") as log:
        assert len(log["pose"]) == 6
    assert f"{summary['rmse']['x_m']:.4f} m" in out
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "as_run.scenario.yaml",
        "log.npz",
        "summary.json",
    ]


def test_simulate_draws_its_figures(tmp_path, capsys):
    code, _, _ = run_cli(
        capsys, "simulate", "rectangle", "--set", "duration=1", "--output", tmp_path
    )
    assert code == 0
    for name in ("path", "errors", "wheel_commands"):
        assert (tmp_path / f"{name}.pdf").read_bytes().startswith(b"%PDF")
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert "<svg" in (tmp_path / f"{name}.svg").read_text()


def test_a_run_is_repeated_from_what_it_wrote(tmp_path, capsys):
    one, two = tmp_path / "one", tmp_path / "two"
    run_cli(capsys, "simulate", "circle", "--seed", 5, *QUICK, "--output", one)
    run_cli(capsys, "simulate", one / "as_run.scenario.yaml", "--no-plots", "--output", two)
    with np.load(one / "log.npz") as first, np.load(two / "log.npz") as second:
        np.testing.assert_array_equal(first["pose"], second["pose"])


def test_scenarios_lists_names_with_descriptions(capsys):
    code, out, _ = run_cli(capsys, "scenarios")
    assert code == 0
    lines = dict(line.split(maxsplit=1) for line in out.splitlines())
    assert "turning_circle" in lines and "baseline_robot_circle" in lines
    assert all(lines.values())


def test_diagram_writes_three_formats(tmp_path, capsys):
    code, out, _ = run_cli(capsys, "diagram", "rectangle", "--depth", 1, "--output", tmp_path)
    assert code == 0
    files = sorted(p.name for p in tmp_path.iterdir())
    assert files == ["rectangle.dot", "rectangle.png", "rectangle.svg"]
    assert len(out.splitlines()) == 3


def test_diagram_draws_all_scenarios(tmp_path, capsys):
    code, _, _ = run_cli(capsys, "diagram", "--all", "--depth", 1, "--output", tmp_path)
    assert code == 0
    assert {p.name for p in tmp_path.glob("*.svg")} == {f"{name}.svg" for name in scenario_names()}


@pytest.mark.parametrize("command", ["", *commands.commands])
def test_every_command_has_help(command, capsys):
    code, out, _ = run_cli(capsys, *filter(None, [command]), "--help")
    assert code == 0 and "Usage: mirte-drake" in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["simulate", "rectangel"], ["rectangel", "did you mean 'rectangle'"]),
        (["simulate", "no/such/file.yaml"], ["no/such/file.yaml", "cannot be read"]),
        (["simulate", "rectangle", "--set", "nominal_nmpc.horizn=4"], ["horizn"]),
        (["simulate", "rectangle", "--set", "period=fast"], ["period"]),
        (["simulate", "rectangle", "--set", "tube_updater.initial_half_width=[.nan, 0, 0]"],
         ["tube_updater.initial_half_width", "finite"]),
        (["simulate", "rectangle", "--set", "prediction_model=dynamic"],
         ["prediction_model", "kinematic or extended_kinematic"]),
        (["simulate", "rectangle", "--set", "prediction_model=magic"], ["magic", "use one of"]),
        (["simulate", "rectangle", "--set", "robot.model=magic"], ["magic", "use one of"]),
        (["simulate", "rectangle", "--seed", "-1"], ["--seed"]),
        (["simulate", "rectangle", "--output", "/dev/null/x"], ["/dev/null/x", "cannot be"]),
        (["simulate"], ["NAME"]),
        (["simulate", "rectangle", "--fast"], ["--fast"]),
        (["diagram", "rectangle", "--depth", "0"], ["--depth"]),
        (["diagram", "nothing"], ["nothing"]),
        (["diagram"], ["NAME", "--all"]),
        (["diagram", "rectangle", "--all"], ["NAME", "--all"]),
        (["drive_home"], ["drive_home"]),
    ],
)  # fmt: skip
def test_wrong_use_is_one_clear_line_and_code_2(arguments, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_wrong_use(capsys, arguments, words)
    assert list(tmp_path.iterdir()) == []


def test_an_unreadable_file_is_named(tmp_path, capsys):
    path = tmp_path / "binary.yaml"
    path.write_bytes(b"\xff\xfe\x00")
    code, _, err = run_cli(capsys, "simulate", path)
    assert code == 2 and "binary.yaml" in err and "UTF-8" in err


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission_is_named(tmp_path, capsys):
    tmp_path.chmod(0o500)
    code, _, err = run_cli(capsys, "simulate", "rectangle", "--output", tmp_path / "out")
    assert code == 2 and "cannot be written" in err


def test_the_installed_command_runs_from_any_folder(tmp_path):
    command = os.path.join(os.path.dirname(sys.executable), "mirte-drake")
    done = subprocess.run([command, "scenarios"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0 and "turning_circle" in done.stdout


def test_a_folder_holds_one_run_and_keeps_what_is_the_users(tmp_path, capsys):
    run_cli(capsys, "simulate", "circle", "--set", "duration=0.5", "--output", tmp_path)
    assert (tmp_path / "path.pdf").exists()
    own = tmp_path / "mine.scenario.yaml"
    own.write_text("extends: rectangle  # A comment of mine.\n")
    run_cli(capsys, "simulate", own, *QUICK, "--output", tmp_path)
    assert "A comment of mine" in own.read_text()
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "as_run.scenario.yaml",
        "log.npz",
        "mine.scenario.yaml",
        "summary.json",
    ]


def test_an_interrupted_run_leaves_nothing(tmp_path, capsys, monkeypatch):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("mirte_drake.visualization.figures.write_figures", interrupted)
    folder = tmp_path / "out"
    code, _, err = run_cli(
        capsys, "simulate", "circle", "--set", "duration=0.5", "--output", folder
    )
    assert code == 1 and "interrupted" in err
    assert list(folder.iterdir()) == []


def test_the_module_runs_as_a_command():
    done = subprocess.run([sys.executable, "-m", "mirte_drake"], capture_output=True, text=True)
    assert done.returncode == 2 and "Usage: mirte-drake" in done.stdout + done.stderr
