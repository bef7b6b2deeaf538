import numpy as np
import pytest
from cli_runner import check_wrong_use, run_cli

from mirte_drake.collect import collect_scenario
from mirte_drake.control.excitation import ExcitationConfig
from mirte_drake.identification.csv_file import HEADER
from mirte_drake.identification.recorded_run import load_recorded_run
from mirte_drake.scenario_file import load_scenario

SHORT = ["--duration", "4"]


def test_collect_writes_a_recording_in_the_robots_format(tmp_path, capsys):
    file = tmp_path / "run.csv"
    code, out, _ = run_cli(capsys, "collect", "circle", *SHORT, "--seed", 3, "--output", file)
    assert code == 0 and "41 samples, 4.0 s" in out and str(file) in out
    assert file.read_text().splitlines()[0] == ",".join(HEADER)
    run = load_recorded_run(file)
    config = ExcitationConfig(duration=4.0, random_duration=2.0)
    data = collect_scenario(load_scenario("circle"), config, seed=3)
    for name in ("time", "pose", "body_velocity", "wheel_command"):
        np.testing.assert_array_equal(getattr(run, name), getattr(data, name))


def test_same_command_same_file(tmp_path, capsys):
    contents = []
    for seed, name in ((1, "a.csv"), (1, "b.csv"), (2, "c.csv")):
        file = tmp_path / name
        run_cli(capsys, "collect", "circle", *SHORT, "--seed", seed, "--output", file)
        contents.append(file.read_bytes())
    assert contents[0] == contents[1] != contents[2]


def test_seed_of_the_scenario_is_the_default(tmp_path, capsys):
    contents = []
    for seed, name in ((("--set", "seed=3"), "a.csv"), (("--seed", 3), "b.csv"), ((), "c.csv")):
        file = tmp_path / name
        run_cli(capsys, "collect", "circle", *SHORT, *seed, "--output", file)
        contents.append(file.read_bytes())
    assert contents[0] == contents[1] != contents[2]


def test_default_file_and_settings_of_the_scenario(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, _ = run_cli(
        capsys, "collect", "rectangle", *SHORT, "--set", "robot.initial_pose=[1, 2, 3]"
    )
    assert code == 0 and "Written to runs/rectangle.csv" in out
    run = load_recorded_run(tmp_path / "runs" / "rectangle.csv")
    np.testing.assert_array_equal(run.pose[0], [1, 2, 3])


def test_a_model_is_identified_from_it(tmp_path, capsys):
    file = tmp_path / "run.csv"
    run_cli(capsys, "collect", "circle", "--duration", "20", "--output", file)
    code, out, err = run_cli(
        capsys, "identify", "--data", file, "--model", "kinematic",
        "--output", tmp_path / "model.yaml",
    )  # fmt: skip
    assert code == 0 and "dtheta/dt" in out and "run.csv: 201 samples, 20.0 s" in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["collect"], ["NAME"]),
        (["collect", "squircle"], ["squircle", "Use one of"]),
        (["collect", "circle", "--duration", "0.5"], ["--duration", ">= 1", "0.5"]),
        (["collect", "circle", "--duration", "nan"], ["--duration", "finite"]),
        (["collect", "circle", "--duration", "1.5"], ["16 rows", "at least 20", "longer"]),
        (["collect", "circle", "--seed", "-1"], ["--seed"]),
        (["collect", "circle", "--set", "odometry.latency=0.05"],
         ["odometry.latency", "must be 0", "0.05"]),
        (["collect", "circle", "--robot", "dynamic", "--set", "odometry.period=0.05"],
         ["odometry.period", "must be 0.1", "0.05"]),
        (["collect", "circle", "--set", "robot.model=none"], ["robot.model", "none"]),
        (["collect", "circle", *SHORT, "--output", "/dev/null/x.csv"], ["cannot be written"]),
    ],
)  # fmt: skip
def test_wrong_use_is_one_clear_line_and_code_2(arguments, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_wrong_use(capsys, arguments, words)
    assert not list(tmp_path.rglob("*.*"))
