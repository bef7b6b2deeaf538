"""The README is true: its commands run, its numbers are those that its command gives."""

import re
import shlex
from pathlib import Path

import pytest

from mirte_drake.cli import main
from mirte_drake.comparison import (
    SCENARIOS,
    comparison,
    comparison_text,
    run_trials,
    trials,
)
from mirte_drake.control.excitation import ExcitationConfig
from mirte_drake.identification.csv_file import save_csv
from mirte_drake.identification.synthetic_recording import (
    SyntheticRecordingConfig,
    synthetic_recording,
)
from mirte_drake.robots.names import ROBOTS, robot_override
from mirte_drake.run import simulate, summarise
from mirte_drake.scenario import load_scenario, scenario_names

README = (Path(__file__).parents[1] / "README.md").read_text()
TABLE = README.split("<!-- results", 1)[1].split("\n\n", 1)[0]
COMPARISON = README.split("<!-- comparison", 1)[1].split("```")[1]
ROWS = dict(re.findall(r"^\| (\w+) \| (\d.*) \|$", TABLE, re.M))
COMMANDS = re.findall(r"^    (mirte-drake .*)$", README, re.M)


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
@pytest.mark.parametrize("scenario", ["rectangle"])
def test_the_comparison_is_what_the_command_gives(scenario):
    todo = trials([scenario], ROBOTS, runs=20)
    text = comparison_text(comparison(todo, run_trials(todo)))
    for line in text.splitlines()[3:]:
        name, robot, *numbers = line.split()
        (printed,) = re.findall(rf"^{name} +{robot} +(.*)$", COMPARISON, re.M)
        # The last digit may be rounded differently, and a sample may fall on the other side.
        tolerances = [1.01] * 6 + [0.5] * 3 + [0.1]
        for number, value, tolerance in zip(numbers, printed.split(), tolerances, strict=True):
            if "-" not in (number, value):
                assert float(number) == pytest.approx(float(value), rel=0.02, abs=tolerance)
            else:
                assert number == value


def test_every_command_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (own,) = re.findall(r"```yaml\n# (\S+)\n(.*?)```", README, re.S)
    (tmp_path / own[0]).write_text(own[1])
    excitation = ExcitationConfig(duration=20.0, random_duration=10.0)
    run = synthetic_recording(config=SyntheticRecordingConfig(excitation))
    save_csv(run, tmp_path / "run.csv")
    save_csv(run, tmp_path / "other_run.csv")
    # The parsing and the wiring as written, the runs shorter.
    shorter = {
        "simulate": "--set duration=0.3 --no-plots",
        "collect": "--duration 20",
        "benchmark": "--quick --solver realtime --solver converged",
        "campaign": "--runs 1 --set duration=0.3 --backend serial --output campaign",
        "compare": "--runs 1 --scenario baseline_circle --set duration=0.3",
    }
    assert len(COMMANDS) == 23
    for command in COMMANDS:
        arguments = shlex.split(command)[1:]
        main([*arguments, *shorter.get(arguments[0], "").split()])
    assert (tmp_path / "my_circle" / "summary.json").is_file()
    assert (tmp_path / "mine.yaml").is_file()
    assert (tmp_path / "fleet" / "weak_wheels.yaml").is_file()


def test_links_lead_somewhere():
    root = Path(__file__).parents[1]
    links = [link for link in re.findall(r"\]\(([^)]+)\)", README) if "://" not in link]
    assert len(links) > 6
    for link in links:
        assert (root / link).exists(), link
