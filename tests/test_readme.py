"""The README is true: its commands run, its numbers are those that its command gives."""

import re
from pathlib import Path

import pages
import pytest

from mirte_drake.comparison import (
    SCENARIOS,
    comparison,
    comparison_text,
    run_trials,
    trials,
)
from mirte_drake.control.excitation import ExcitationConfig
from mirte_drake.identification import fit_robot
from mirte_drake.identification.csv_file import save_csv
from mirte_drake.identification.synthetic_recording import (
    SyntheticRecordingConfig,
    synthetic_recording,
)
from mirte_drake.robots.names import ROBOTS, robot_override
from mirte_drake.run import simulate
from mirte_drake.run_summary import summarise
from mirte_drake.scenario_file import load_scenario, scenario_names
from mirte_drake.visualization.run_controls import RunControls, Wish

README_FILE = Path(__file__).parents[1] / "README.md"
README = README_FILE.read_text()
TABLE = README.split("<!-- results", 1)[1].split("\n\n", 1)[0]
COMPARISON = README.split("<!-- comparison", 1)[1].split("```")[1]
ROWS = dict(re.findall(r"^\| (\w+) \| (\d.*) \|$", TABLE, re.M))


def check(name: str, rmse: list[str], outside: str, *overrides: str) -> None:
    """Compares with a run; other processors may round the last digit differently."""
    summary = summarise(simulate(load_scenario(name, overrides), name))
    printed = [float(value) for value in rmse]
    assert list(summary["rmse"].values()) == pytest.approx(printed, rel=0.01, abs=1e-4)
    assert summary["solve_failures"] == summary["rate_violations"] == 0
    if "robot" not in name:
        assert summary["input_violations"] == 0
    if not name.startswith("baseline"):
        violations, samples = (int(number) for number in outside.split(" of "))
        assert samples == summary["steps"] - 1
        assert abs(violations - summary["successor_violations"]) <= 2


def test_the_table_has_every_scenario():
    others = ("pid_", "lqr_", "lagged_")
    assert sorted(ROWS) == [name for name in scenario_names() if not name.startswith(others)]


@pytest.mark.slow
@pytest.mark.parametrize("name", ROWS)
def test_the_table_holds_what_the_command_gives(name):
    *rmse, outside = ROWS[name].split(" | ")
    check(name, rmse, outside)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "override", "outside"),
    [
        ("rectangle", "nominal_nmpc.reference_alignment=aligned", "1 of 250"),
        ("robot_rectangle", "nominal_nmpc.rate_unit=pwm_per_sample", "22 of 209"),
    ],
)
def test_the_text_holds_what_the_command_gives(name, override, outside):
    paragraph = README.split(override, 1)[1]
    rmse = re.search(r"(0\.\d{4}) / (0\.\d{4}) / (0\.\d{4})", paragraph).groups()
    check(name, rmse, outside, override)


@pytest.mark.slow
def test_the_slippery_floor_is_as_the_text_says():
    settings = [robot_override("multibody"), "robot.floor_friction=0.05"]
    summary = summarise(simulate(load_scenario("turning_circle", settings), "turning_circle"))
    assert [summary["rmse"][key] for key in ("x_m", "y_m")] == pytest.approx([0.005] * 2, abs=1e-3)
    true = [summary["true_rmse"][key] for key in ("x_m", "y_m")]
    assert true == pytest.approx([0.35, 0.55], abs=0.02)


def test_the_comparison_has_every_scenario_on_every_robot():
    rows = [tuple(line.split()[:2]) for line in COMPARISON.splitlines()[4:]]
    assert rows == [(scenario, robot) for scenario in SCENARIOS for robot in ROBOTS]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "robot"), [("rectangle", "sindyc"), ("lagged_rectangle", "dynamic")]
)
def test_the_comparison_is_what_the_command_gives(scenario, robot):
    """Where it is soon found out: on the robots without rigid bodies."""
    todo = trials([scenario], [robot], runs=20)
    text = comparison_text(comparison(todo, run_trials(todo)))
    for line in text.splitlines()[3:]:
        name, _, *numbers = line.split()
        (printed,) = re.findall(rf"^{name} +{robot} +(.*)$", COMPARISON, re.M)
        # The last digit may be rounded differently, and a sample may fall on the other side.
        tolerances = [1.01] * 6 + [0.5] * 3 + [0.1]
        for number, value, tolerance in zip(numbers, printed.split(), tolerances, strict=True):
            if "-" not in (number, value):
                assert float(number) == pytest.approx(float(value), rel=0.02, abs=tolerance)
            else:
                assert number == value


def at_the_wire(block: pages.Block) -> bool:
    return any("--transport" in command or " faults " in command for command in block.commands)


def test_every_command_is_run():
    every = pages.blocks(README_FILE)
    assert sum(len(block.commands) for block in every) == 45
    assert sum(map(at_the_wire, every)) == 6
    assert not any(block.not_run for block in every)


@pytest.mark.slow
def test_every_block_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    excitation = ExcitationConfig(duration=20.0, random_duration=10.0)
    run = synthetic_recording(config=SyntheticRecordingConfig(excitation))
    save_csv(run, tmp_path / "run.csv")
    save_csv(run, tmp_path / "other_run.csv")
    monkeypatch.setattr(fit_robot, "STRUCTURES", fit_robot.STRUCTURES[:1])
    # Nobody is there to stop what is watched.
    monkeypatch.setattr(RunControls, "read", lambda controls: Wish(1.0, False, 0, stop=True))
    with pages.Reader() as reader:
        for block in pages.blocks(README_FILE):
            if not at_the_wire(block):
                reader.run(block)
    assert (tmp_path / "my_circle" / "summary.json").is_file()
    assert (tmp_path / "my_circle" / "replay.html").is_file()
    assert (tmp_path / "mine.yaml").is_file()
    assert (tmp_path / "fleet" / "weak_wheels.yaml").is_file()


@pytest.mark.slow
@pytest.mark.realtime
@pytest.mark.xdist_group("wire")
def test_every_block_at_the_wire_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pages.Reader() as reader:
        for block in filter(at_the_wire, pages.blocks(README_FILE)):
            reader.run(block)
    assert (tmp_path / "runs" / "rectangle" / "drive.mcap").is_file()
    assert "zeros sent" in capsys.readouterr().out


def newcomers_steps() -> list[list[str]]:
    """Returns the commands of every step from nothing to a controller of one's own."""
    (text,) = re.findall(r"<!-- steps: .*-->\n```sh\n(.*?)```", README, re.S)
    return [step.splitlines()[1:] for step in re.split(r"^(?=# )", text, flags=re.M)[1:]]


def test_every_step_of_a_newcomer_is_at_most_two_commands():
    assert [len(step) for step in newcomers_steps()] == [1, 1, 1, 1, 2, 1]


@pytest.mark.slow
def test_a_newcomer_gets_there_in_an_empty_folder(tmp_path, monkeypatch, capsys):
    """With the README alone, nothing shortened, and a recording of one's own."""
    monkeypatch.chdir(tmp_path)
    save_csv(synthetic_recording(), tmp_path / "run.csv")
    with pages.Reader(short=False) as reader:
        for block in pages.blocks(README_FILE):
            if block.file == "own_path.scenario.yaml":
                reader.run(block)
        for step in newcomers_steps():
            for command in step:
                reader.run_command(command)
    assert (tmp_path / "runs" / "own_path" / "path.png").is_file()
    assert (tmp_path / "runs" / "own_path" / "replay.html").is_file()
    assert "dx/dt" in capsys.readouterr().out


def test_links_lead_somewhere():
    root = Path(__file__).parents[1]
    links = [link for link in re.findall(r"\]\(([^)]+)\)", README) if "://" not in link]
    assert len(links) > 10
    for link in links:
        assert (root / link).exists(), link
