import csv
import dataclasses as dc

import numpy as np
import pytest

from mirte_drake.campaign.outcome import Failure, Outcome
from mirte_drake.comparison import (
    FIELDS,
    SCENARIOS,
    comparison,
    comparison_text,
    run_trials,
    save_runs,
    trials,
)
from mirte_drake.errors import UserError
from mirte_drake.robots.names import ROBOTS, robot_override
from mirte_drake.scenario_file import load_scenario, scenario_names

SHORT = ("duration=1",)
BLANK = dc.replace(Outcome(*[0] * len(dc.fields(Outcome))), samples=11)


def test_compares_every_path_with_and_without_the_tube():
    assert set(SCENARIOS) <= set(scenario_names())
    for with_tube, without, lagged in zip(
        SCENARIOS[::3], SCENARIOS[1::3], SCENARIOS[2::3], strict=True
    ):
        assert without == f"baseline_{with_tube}" and lagged == f"lagged_{with_tube}"


@pytest.mark.parametrize("robot", ROBOTS)
def test_names_of_robots_are_those_of_their_configs(robot):
    scenario = load_scenario("rectangle", [robot_override(robot)])
    assert type(scenario.robot).__name__.lower() == f"{robot}robotconfig"


def test_trials_are_all_combinations():
    todo = trials(["circle", "rectangle"], ["sindyc", "dynamic"], 2, SHORT)
    combinations = [(trial.cell.name, *trial.cell.values, trial.seed) for trial in todo]
    assert combinations == [
        *(("circle", "sindyc", 0), ("circle", "sindyc", 1)),
        *(("circle", "dynamic", 0), ("circle", "dynamic", 1)),
        *(("rectangle", "sindyc", 0), ("rectangle", "sindyc", 1)),
        *(("rectangle", "dynamic", 0), ("rectangle", "dynamic", 1)),
    ]
    for trial, (_, robot, seed) in zip(todo, combinations, strict=True):
        assert type(trial.scenario.robot).__name__.lower() == f"{robot}robotconfig"
        assert (trial.scenario.seed, trial.scenario.duration) == (seed, 1.0)


@pytest.mark.parametrize("robot", ROBOTS)
def test_seeds_repeat_and_differ(robot):
    first, other = trials(["rectangle"], [robot], 2, SHORT)
    one, two, again = run_trials([first, other, first])
    assert one == again != two


@pytest.mark.slow
def test_processes_give_what_one_gives():
    todo, calls = trials(["baseline_rectangle"], ["sindyc"], 3, SHORT), []
    many = run_trials(todo, jobs=2, on_run=lambda: calls.append(1))
    assert many == run_trials(todo)
    assert len(calls) == 3


def test_what_does_not_load_is_named_before_anything_runs():
    with pytest.raises(UserError, match="did you mean 'rectangle'"):
        trials(["rectangle", "rectangel"], ["sindyc"], 1)


def test_a_run_that_cannot_be_run_is_named(monkeypatch):
    monkeypatch.setattr(
        "mirte_drake.campaign.study.run_outcome", lambda scenario: Failure("no floor")
    )
    with pytest.raises(RuntimeError, match="circle, seed 0: no floor"):
        run_trials(trials(["circle"], ["sindyc"], 1))


def test_medians_by_scenario_and_robot():
    todo = trials(["rectangle"], ["sindyc"], 3) + trials(["baseline_circle"], ["dynamic"], 2)
    values = [0.1, 0.5, 0.2, 0.3, 0.4]
    outcomes = [dc.replace(BLANK, x_m=value) for value in values]
    outcomes[:3] = [dc.replace(result, true_violations=11) for result in outcomes[:3]]
    outcomes[3:] = [dc.replace(result, true_violations=None) for result in outcomes[3:]]
    medians = comparison(todo, outcomes)["medians"]
    assert [(row["scenario"], row["robot"], row["runs"]) for row in medians] == [
        ("rectangle", "sindyc", 3),
        ("baseline_circle", "dynamic", 2),
    ]
    assert [row["x_m"] for row in medians] == pytest.approx([0.2, 0.35])
    assert [row["true_inside"] for row in medians] == [0.0, None]
    text = comparison_text({"medians": medians}).splitlines()
    assert text[3].split() == "rectangle sindyc 200 0 0 0 0 0 0.0 100.0 0.0 0.00".split()
    assert text[4].split() == "baseline_circle dynamic 350 0 0 0 0 0 - 100.0 0.0 0.00".split()


def test_solve_failures_are_summed():
    todo = trials(["rectangle"], ["sindyc"], 3) + trials(["baseline_circle"], ["sindyc"], 2)
    outcomes = [dc.replace(BLANK, solve_failures=number) for number in (0, 7, 0, 1, 2)]
    medians = comparison(todo, outcomes)["medians"]
    assert [row["solve_failures"] for row in medians] == [7, 3]


def test_every_run_is_a_line_of_the_file(tmp_path):
    todo = trials(["rectangle"], ["sindyc"], 2)
    outcomes = [dc.replace(BLANK, y_m=0.25), dc.replace(BLANK, tube_violations=1)]
    save_runs(todo, outcomes, tmp_path / "runs.csv")
    with (tmp_path / "runs.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["scenario"], row["robot"], row["seed"]) for row in rows] == [
        ("rectangle", "sindyc", "0"),
        ("rectangle", "sindyc", "1"),
    ]
    for row, result in zip(rows, outcomes, strict=True):
        assert {key: float(row[key]) for key in FIELDS} == {
            key: getattr(result, key) for key in FIELDS
        }
    np.testing.assert_allclose(float(rows[1]["measured_inside"]), 10 / 11)
