import numpy as np
import pytest
from cli_runner import check_wrong_use, run_cli

from mirte_drake.identification import fit_robot as fitting
from mirte_drake.identification.csv_file import save_csv
from mirte_drake.identification.synthetic_recording import (
    SyntheticRecordingConfig,
    recording_of,
)
from mirte_drake.model.model_file import load_model
from mirte_drake.model.robot_file import load_robot_file


@pytest.fixture
def quick(monkeypatch):
    """One simple structure: what the command does with it is the same."""
    monkeypatch.setattr(fitting, "STRUCTURES", (fitting.Structure("robot", "robot"),))


@pytest.fixture
def data(tmp_path):
    """Two recordings of a robot with inertia."""
    paths = []
    for seed in (1, 2):
        rng = np.random.default_rng(seed)
        commands = np.round(np.repeat(rng.uniform(-60, 60, (20, 4)), 3, axis=0))
        run = recording_of(load_model("dynamic"), commands, SyntheticRecordingConfig(), seed=seed)
        paths.append(tmp_path / f"run_{seed}.csv")
        save_csv(run, paths[-1])
    return paths


def test_fit_writes_a_robot_its_fleet_and_a_table(quick, data, tmp_path, capsys):
    file, folder = tmp_path / "out" / "mine.yaml", tmp_path / "fleet"
    code, out, err = run_cli(
        capsys, "fit-robot", "--data", data[0], "--validate", data[1], "--output", file,
        "--fleet", folder,
    )  # fmt: skip
    assert code == 0
    assert "run_1.csv: 60 samples" in err and "run_2.csv: 60 samples" in err
    lines = out.splitlines()
    assert lines[1].startswith("gain by robot, friction by robot") and lines[1].endswith("*")
    assert [line.split()[0] for line in lines[3:5]] == ["run_1", "run_2"]
    content = load_robot_file(file)
    assert content.identification.source == "fitted to run_1.csv, 60 samples"
    assert len(content.identification.data_sha256) == 64
    assert f"{content.scores['run_2 vx [m/s]']:.3f}" in lines[4]
    names = {path.stem for path in folder.glob("*.yaml")}
    assert {"clean", "weak_wheels", "payload_5kg", "mixed_1"} <= names
    assert load_robot_file(folder / "payload_5kg.yaml").parameters.mass == pytest.approx(18.6)


def test_validation_has_no_part_in_the_fit(quick, data, tmp_path, capsys):
    alone, beside = tmp_path / "alone.yaml", tmp_path / "beside.yaml"
    run_cli(capsys, "fit-robot", "--data", data[0], "--output", alone)
    run_cli(capsys, "fit-robot", "--data", data[0], "--validate", data[1], "--output", beside)
    a, b = (load_robot_file(path).parameters for path in (alone, beside))
    np.testing.assert_equal(vars(a.drivetrain), vars(b.drivetrain))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--data", "nowhere.csv"], ["nowhere.csv"]),
        (["--seed", "-1"], ["seed"]),
    ],
)
def test_wrong_use(arguments, words, capsys):
    check_wrong_use(capsys, ["fit-robot", *arguments], words)


def test_the_same_name_twice_is_wrong_use(data, capsys):
    arguments = ["fit-robot", "--data", data[0], "--validate", data[0]]
    check_wrong_use(capsys, arguments, ["--validate", "names of their own"])
