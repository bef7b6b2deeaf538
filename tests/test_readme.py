"""The README is true: its commands run, its numbers are those that its command gives."""

import re
import shlex
from pathlib import Path

import pytest

from mirte_drake.cli import main
from mirte_drake.run import simulate, summarise
from mirte_drake.scenario import load_scenario, scenario_names

README = (Path(__file__).parents[1] / "README.md").read_text()
TABLE = README.split("<!-- results", 1)[1].split("\n\n", 1)[0]
ROWS = dict(re.findall(r"^\| (\w+) \| (\d.*) \|$", TABLE, re.M))
COMMANDS = re.findall(r"^    (mirte-drake .*)$", README, re.M)


def columns(name: str, *overrides: str) -> list[str]:
    summary = summarise(simulate(load_scenario(name, overrides), name))
    violations = f"{summary['successor_violations']} of {summary['steps'] - 1}"
    outside = "no tube" if name.startswith("baseline") else violations
    assert summary["solve_failures"] == summary["tube_violations"] == 0
    assert summary["input_violations"] == summary["rate_violations"] == 0
    return [*(f"{value:.4f}" for value in summary["rmse"].values()), outside]


def test_the_table_has_every_scenario():
    assert sorted(ROWS) == scenario_names()


@pytest.mark.slow
@pytest.mark.parametrize("name", ROWS)
def test_the_table_holds_what_the_command_gives(name):
    assert columns(name) == ROWS[name].split(" | ")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "override"),
    [
        ("rectangle", "nominal_nmpc.reference_alignment=aligned"),
        ("robot_rectangle", "nominal_nmpc.rate_unit=pwm_per_sample"),
    ],
)
def test_the_text_holds_what_the_command_gives(name, override):
    assert " / ".join(columns(name, override)[:3]) in README


def test_every_command_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (own,) = re.findall(r"```yaml\n# (\S+)\n(.*?)```", README, re.S)
    (tmp_path / own[0]).write_text(own[1])
    assert len(COMMANDS) == 7
    for command in COMMANDS:
        arguments = shlex.split(command)[1:]
        if arguments[0] == "simulate":  # The parsing and the wiring as written, the run shorter.
            arguments += ["--set", "duration=0.3", "--no-plots"]
        main(arguments)
    assert (tmp_path / "my_circle" / "summary.json").is_file()


def test_links_lead_somewhere():
    root = Path(__file__).parents[1]
    links = [link for link in re.findall(r"\]\(([^)]+)\)", README) if "://" not in link]
    assert len(links) > 6
    for link in links:
        assert (root / link).exists(), link
