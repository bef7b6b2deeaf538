import json

import numpy as np
import pytest
from cli_runner import check_wrong_use, run_cli

from mirte_drake.cli import commands
from mirte_drake.identification.csv_file import save_csv
from mirte_drake.identification.differentiation import MODES
from mirte_drake.identification.synthetic_recording import synthetic_recording
from mirte_drake.identification.validation import INTEGRATORS
from mirte_drake.model.model_file import load_model, load_model_file


def test_identify_writes_a_model_and_prints_its_equations(recordings, tmp_path, capsys):
    file = tmp_path / "kinematic.yaml"
    data = recordings / "training_data.csv"
    code, out, err = run_cli(
        capsys, "identify", "--data", data, "--model", "kinematic", "--mode", "published",
        "--output", file,
    )  # fmt: skip
    assert code == 0
    assert "dtheta/dt = -0.0067258 u1 + 0.0069079 u2 + 0.0065961 u3 - 0.0066846 u4" in out
    assert "30 rows equal to the row before" in err
    assert load_model(file).num_states == 3
    assert load_model_file(file).training_scores.keys() == {
        f"{state}_derivative_rmse" for state in ("x", "y", "theta")
    }


def test_validate_ode45_prints_the_published_table(recordings, tmp_path, capsys):
    data = recordings / "validation_turn_rect.csv"
    code, out, _ = run_cli(
        capsys, "validate", "--data", data, "--integrator", "ode45", "--output", tmp_path
    )
    assert code == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert list(summary) == ["kinematic", "extended_kinematic", "dynamic"]
    extended = summary["extended_kinematic"]
    np.testing.assert_allclose(extended["pose_rmse"], [0.31, 0.36, 0.05], atol=0.005)
    np.testing.assert_allclose(extended["velocity_rmse"], [0.12, 0.02, 0.17], atol=0.005)
    assert "extended_kinematic" in out
    assert len(list(tmp_path.glob("*.pdf"))) == 2


def test_disturbance_says_that_the_published_value_is_no_bound(recordings, tmp_path, capsys):
    data = recordings / "training_data.csv"
    code, out, _ = run_cli(capsys, "disturbance", "--data", data, "--output", tmp_path)
    assert code == 0
    assert "w_max is not a bound" in out and "38%        46%        35%" in out
    summary = json.loads((tmp_path / "summary.json").read_text())
    keys = ("delay_samples", "lag_pole", "gain", "bias", "a", "b", "w_max")
    assert all(len(summary[key]) == 3 for key in keys)
    assert summary["delay_samples"] == [3, 2, 2]
    np.testing.assert_allclose(summary["w_max"], [0.0364, 0.0275, 0.0884], atol=5e-5)


def test_validate_keeps_what_is_the_users(tmp_path, capsys):
    data = tmp_path / "validation_run.csv"
    save_csv(synthetic_recording(), data)
    before = data.read_bytes()
    code, _, _ = run_cli(capsys, "validate", "--data", data, "--output", tmp_path)
    assert code == 0 and data.read_bytes() == before
    assert (tmp_path / "validation_pose.pdf").is_file()
    run_cli(capsys, "validate", "--data", data, "--no-plots", "--output", tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["summary.json", "validation_run.csv"]


@pytest.mark.parametrize("command", ["identify", "validate", "disturbance"])
def test_without_a_recording_a_synthetic_one_serves(command, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = run_cli(capsys, command)
    assert code == 0
    assert "synthetic recording" in err and "Written to runs/" in out + err


def test_identify_as_latex_with_search_and_figures(tmp_path, capsys):
    code, out, _ = run_cli(
        capsys, "identify", "--model", "kinematic", "--latex", "--search", "held_out",
        "--figures", tmp_path / "figures", "--output", tmp_path / "m.yaml",
    )  # fmt: skip
    assert code == 0
    assert r"\begin{aligned}" in out and "held out" in out and " *\n" in out
    assert len(list((tmp_path / "figures").glob("*.svg"))) >= 3


def test_identify_lagged_says_how_it_was_chosen_and_runs_in_a_scenario(tmp_path, capsys):
    file = tmp_path / "mine.yaml"
    code, out, err = run_cli(capsys, "identify", "--model", "lagged", "--output", file)
    assert code == 0 and "held-out error" in err and err.count(" *\n") == 1
    assert "dvx/dt = (0.0" in out and "u is that of 0 samples ago" in out
    code, out, _ = run_cli(
        capsys, "simulate", "lagged_circle", "--set", f"prediction_model={file}",
        "--set", "duration=1", "--no-plots", "--output", tmp_path / "run",
    )  # fmt: skip
    assert code == 0 and "0 failures" in out


def test_an_identified_model_runs_in_a_scenario(tmp_path, capsys):
    file = tmp_path / "mine.yaml"
    run_cli(capsys, "identify", "--model", "kinematic", "--output", file)
    code, out, _ = run_cli(
        capsys, "simulate", "circle", "--set", f"prediction_model={file}", "--set", "duration=1",
        "--no-plots", "--output", tmp_path / "run",
    )  # fmt: skip
    assert code == 0 and "0 failures" in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["identify", "--data", "no.csv"], ["no.csv", "cannot be read"]),
        (["identify", "--data", "no_bag.mcap"], ["no_bag.mcap"]),
        (["identify", "--model", "cubic"], ["--model", "extended_dynamic"]),
        (["identify", "--thresholds", "1,2"], ["--thresholds 1,2", "three numbers"]),
        (["identify", "--thresholds", "9,9,9"], ["threshold 9", "lower it"]),
        (["identify", "--model", "lagged", "--latex"], ["--latex", "leave it out"]),
        (["identify", "--search", "training", "--thresholds", "1,1,1"], ["--search", "leave"]),
        (["validate", "--model", "magic"], ["magic", "use one of"]),
        (["validate", "--model", "dynamic", "--model", "dynamic"], ["given twice"]),
        (["validate", *(f"--model={i}.yaml" for i in range(6))], ["at most 5", "--no-plots"]),
        (["validate", "--integrator", "euler"], ["--integrator", "ode45"]),
        (["disturbance", "--level", "1.5"], ["--level"]),
        (["disturbance", "--output", "/dev/null/x"], ["/dev/null/x", "cannot be written"]),
    ],
)
def test_wrong_use_is_one_clear_line_and_code_2(arguments, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_wrong_use(capsys, arguments, words)
    assert not list(tmp_path.rglob("*.*"))


def test_models_of_the_same_file_name_are_told_apart(tmp_path, capsys):
    for folder in ("a", "b"):
        run_cli(
            capsys, "identify", "--model", "kinematic", "--output", tmp_path / folder / "m.yaml"
        )
    names = [str(tmp_path / folder / "m.yaml") for folder in ("a", "b")]
    code, _, _ = run_cli(
        capsys, "validate", "--no-plots", *(f"--model={name}" for name in names),
        "--output", tmp_path,
    )  # fmt: skip
    assert code == 0
    assert list(json.loads((tmp_path / "summary.json").read_text())) == names


def test_a_correction_that_does_not_fit_the_model_is_called_so(recordings, tmp_path, capsys):
    data = recordings / "training_data.csv"
    code, out, _ = run_cli(
        capsys, "disturbance", "--data", data, "--model", "dynamic", "--output", tmp_path
    )
    assert code == 0 and "does not fit the model (yaw rate)" in out


def test_the_choices_are_those_of_the_package():
    """The command line names them itself, so that --help need not load everything."""

    def choices(command, option):
        return next(p for p in commands.commands[command].params if p.name == option).type.choices

    assert tuple(choices("identify", "mode")) == MODES
    assert tuple(choices("validate", "integrator")) == INTEGRATORS
