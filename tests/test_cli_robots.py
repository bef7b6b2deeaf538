"""Commands that choose, compare and export robots."""

import json

import numpy as np
import pytest
from cli_runner import check_wrong_use, run_cli
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from mirte_drake.identification.recorded_run import load_recorded_run
from mirte_drake.robots.robot_description import robot_sdf
from mirte_drake.scenario_file import load_scenario

QUICK = ["--set", "duration=0.5", "--no-plots"]


@pytest.mark.parametrize("robot", ["sindyc", "dynamic", "multibody"])
def test_simulate_on_every_robot(robot, tmp_path, capsys):
    code, out, _ = run_cli(
        capsys, "simulate", "circle", "--robot", robot, *QUICK, "--output", tmp_path
    )
    assert code == 0
    kind = type(load_scenario(str(tmp_path / "as_run.scenario.yaml")).robot).__name__
    assert kind == f"{robot.capitalize()}RobotConfig"
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert f"true {summary['true_rmse']['y_m']:.4f} m" in out
    with np.load(tmp_path / "log.npz") as log:
        assert np.array_equal(log["pose"], log["true_pose"]) == (robot == "sindyc")


def test_set_changes_the_robot_that_was_chosen(tmp_path, capsys):
    code, _, _ = run_cli(
        capsys, "simulate", "circle", "--set", "robot.floor_friction=0.3",
        "--robot", "multibody", *QUICK, "--output", tmp_path,
    )  # fmt: skip
    assert code == 0
    assert load_scenario(str(tmp_path / "as_run.scenario.yaml")).robot.floor_friction == 0.3


@pytest.mark.parametrize("robot", ["sindyc", "dynamic", "multibody"])
def test_diagram_shows_the_robot(robot, tmp_path, capsys):
    code, _, _ = run_cli(capsys, "diagram", "circle", "--robot", robot, "--output", tmp_path)
    assert code == 0
    text = (tmp_path / "circle.dot").read_text()
    assert f"{robot}_robot" in text
    assert ("odometry_sensor" in text) == (robot != "sindyc")
    assert ("disturbance_source" in text) == (robot != "multibody")


@pytest.mark.parametrize("robot", ["dynamic", "multibody"])
def test_collect_on_a_robot_with_wheels(robot, tmp_path, capsys):
    file = tmp_path / "run.csv"
    code, _, _ = run_cli(
        capsys, "collect", "circle", "--robot", robot, "--duration", "4", "--output", file
    )
    assert code == 0
    run = load_recorded_run(file)
    assert len(run.time) == 41 and np.ptp(run.pose, axis=0).min() > 0.01


def test_compare_writes_table_medians_and_runs(tmp_path, capsys):
    code, out, _ = run_cli(
        capsys, "compare", "--runs", 2, "--scenario", "rectangle", "--scenario", "baseline_circle",
        "--robot", "sindyc", "--robot", "dynamic", "--set", "duration=0.5", "--output", tmp_path,
    )  # fmt: skip
    assert code == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["comparison.json", "runs.csv"]
    medians = json.loads((tmp_path / "comparison.json").read_text())["medians"]
    rows = [(row["scenario"], row["robot"]) for row in medians]
    assert rows == [
        *(("rectangle", "sindyc"), ("rectangle", "dynamic")),
        *(("baseline_circle", "sindyc"), ("baseline_circle", "dynamic")),
    ]
    assert "Failed solves: 0 in 8 runs" in out
    for row in rows:
        assert any(tuple(line.split()[:2]) == row for line in out.splitlines())
    assert len((tmp_path / "runs.csv").read_text().splitlines()) == 1 + 4 * 2


def test_exported_robot_is_the_simulated_one(tmp_path, capsys):
    file = tmp_path / "robot.sdf"
    code, out, _ = run_cli(capsys, "export-robot", "--output", file)
    assert code == 0 and str(file) in out
    assert file.read_text() == robot_sdf()
    plant = MultibodyPlant(0.005)
    Parser(plant).AddModels(str(file))
    plant.Finalize()
    assert plant.num_actuators() == 4


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["simulate", "circle", "--robot", "hover"], ["--robot", "hover", "multibody"]),
        (["simulate", "circle", "--robot", "dynamic", "--set", "robot.model=kinematic"],
         ["robot", "model"]),
        (["collect", "circle", "--robot", "hover"], ["--robot", "hover"]),
        (["compare", "--runs", "0"], ["--runs"]),
        (["compare", "--jobs", "0"], ["--jobs"]),
        (["compare", "--robot", "hover"], ["--robot", "hover"]),
        (["compare", "--scenario", "squircle"], ["squircle", "Use one of"]),
        (["compare", "--set", "robot.payload=1"], ["robot", "payload"]),
        (["export-robot", "--output", "/dev/null/x.sdf"], ["/dev/null/x.sdf", "cannot be"]),
    ],
)  # fmt: skip
def test_wrong_use_is_one_clear_line_and_code_2(arguments, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_wrong_use(capsys, arguments, words)
    assert not list(tmp_path.rglob("*.*"))
