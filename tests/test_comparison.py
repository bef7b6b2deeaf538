import csv
import dataclasses as dc
import functools

import numpy as np
import pytest

from mirte_drake.comparison import (
    FIELDS,
    SCENARIOS,
    Outcome,
    Trial,
    comparison,
    comparison_text,
    oscillation,
    outcome,
    run_trials,
    save_runs,
    trials,
)
from mirte_drake.errors import UserError
from mirte_drake.robots.names import ROBOTS, robot_override
from mirte_drake.run import Run, simulate
from mirte_drake.scenario import load_scenario, scenario_names

SHORT = ("duration=1",)
BLANK = Outcome(*[0.0] * len(FIELDS))


@functools.cache
def short_run(robot="multibody", name="rectangle") -> Run:
    return simulate(load_scenario(name, [robot_override(robot), "duration=2"]), name)


def changed(run: Run, **log) -> Outcome:
    return outcome(dc.replace(run, log={**run.log, **log}))


def test_compares_every_scenario_with_and_without_the_tube():
    assert sorted(SCENARIOS) == scenario_names()
    for with_tube, without, lagged in zip(
        SCENARIOS[::3], SCENARIOS[1::3], SCENARIOS[2::3], strict=True
    ):
        assert without == f"baseline_{with_tube}" and lagged == f"lagged_{with_tube}"


@pytest.mark.parametrize("robot", ROBOTS)
def test_names_of_robots_are_those_of_their_configs(robot):
    scenario = load_scenario("rectangle", [robot_override(robot)])
    assert type(scenario.robot).__name__.lower() == f"{robot}robotconfig"


def test_trials_are_all_combinations():
    assert trials(["a", "b"], ["r", "s"], 2) == [
        *(Trial("a", "r", 0), Trial("a", "r", 1), Trial("a", "s", 0), Trial("a", "s", 1)),
        *(Trial("b", "r", 0), Trial("b", "r", 1), Trial("b", "s", 0), Trial("b", "s", 1)),
    ]


def test_oscillation_by_hand():
    zigzag = np.array([0.0, 1, 0, 1, 0, 1])  # 4 changes.
    ramp = np.arange(6.0)
    stairs = np.array([0.0, 1, 1, 2, 2, 1])  # Rests have no sign: one change.
    trembling = np.array([0.0, 1e-12, 0, 1e-12, 0, 1e-12])  # As still as rounding lets it be.
    commands = np.array([zigzag, ramp, stairs, trembling]).T
    assert oscillation(commands, 0.5) == pytest.approx((4 + 0 + 1 + 0) / 4 / 0.5)


def test_oscillation_of_a_still_command_is_none():
    assert oscillation(np.full((10, 4), 30.0), 1.0) == 0.0


def test_shares_by_hand():
    log = {key: value.copy() for key, value in short_run().log.items()}
    zero = np.zeros(log["pose"].shape)
    width = np.tile([0.1, 0.1, 0.1], (len(zero), 1))
    pose, true_pose, command = zero.copy(), zero.copy(), np.zeros((len(zero), 4))
    pose[3, 0], true_pose[[4, 5], 2], true_pose[6, 1] = 0.11, -0.2, 0.3
    true_pose[7, 2] = 2 * np.pi + 0.05  # A turn further on is where the tube is.
    command[[1, 2], [0, 3]] = [100.0, -100.0]
    shown = changed(
        short_run(),
        pose=pose,
        true_pose=true_pose,
        nominal_pose=zero,
        nominal_next=zero,
        half_width=width,
        applied_input=command,
    )
    samples = len(zero)
    assert shown.measured_inside == pytest.approx(1 - 1 / samples)
    assert shown.true_inside == pytest.approx(1 - 3 / samples)
    assert shown.successor_inside == pytest.approx(1 - 1 / (samples - 1))
    assert shown.saturation == pytest.approx(2 / samples)


def test_errors_are_those_of_the_summary():
    run = short_run()
    shown = outcome(run)
    for key, pose in (("x_m", "pose"), ("true_x_m", "true_pose")):
        error = run.log[pose][:, 0] - run.log["reference"][:, 0]
        assert getattr(shown, key) == pytest.approx(np.sqrt(np.mean(error**2)))
    assert shown.solve_failures == 0 and shown.measured_inside == 1.0


def test_without_a_tube_nothing_is_inside():
    shown = outcome(short_run(name="baseline_rectangle"))
    for key in ("measured_inside", "true_inside", "successor_inside"):
        assert np.isnan(getattr(shown, key))


@pytest.mark.parametrize("robot", ROBOTS)
def test_seeds_repeat_and_differ(robot):
    first, other, again = run_trials([Trial("rectangle", robot, seed) for seed in (0, 1, 0)], SHORT)
    assert first == again != other


@pytest.mark.parametrize("batch", [50, 1])
def test_processes_give_what_one_gives(batch, monkeypatch):
    monkeypatch.setattr("mirte_drake.comparison.BATCH", batch)
    todo, calls = trials(["baseline_rectangle"], ["sindyc"], 3), []
    many = run_trials(todo, SHORT, jobs=2, on_run=lambda: calls.append(1))
    assert repr(many) == repr(run_trials(todo, SHORT))
    assert len(calls) == 3


def test_what_does_not_load_is_named_before_anything_runs():
    calls = []
    todo = [*trials(["rectangle"], ["sindyc"], 1), Trial("rectangel", "sindyc", 0)]
    with pytest.raises(UserError, match="did you mean 'rectangle'"):
        run_trials(todo, SHORT, on_run=lambda: calls.append(1))
    assert calls == []


def test_medians_by_scenario_and_robot():
    todo = [*trials(["rectangle"], ["sindyc"], 3), *trials(["baseline_circle"], ["dynamic"], 2)]
    values = [0.1, 0.5, 0.2, 0.3, 0.4]
    outcomes = [dc.replace(BLANK, x_m=value) for value in values]
    outcomes[3:] = [dc.replace(result, true_inside=np.nan) for result in outcomes[3:]]
    medians = comparison(todo, outcomes)["medians"]
    assert [(row["scenario"], row["robot"], row["runs"]) for row in medians] == [
        ("rectangle", "sindyc", 3),
        ("baseline_circle", "dynamic", 2),
    ]
    assert [row["x_m"] for row in medians] == pytest.approx([0.2, 0.35])
    assert [row["true_inside"] for row in medians] == [0.0, None]
    text = comparison_text({"medians": medians}).splitlines()
    assert text[3].split() == "rectangle sindyc 200 0 0 0 0 0 0.0 0.0 0.0 0.00".split()
    assert text[4].split() == "baseline_circle dynamic 350 0 0 0 0 0 - 0.0 0.0 0.00".split()


def test_solve_failures_are_summed():
    todo = [*trials(["rectangle"], ["sindyc"], 3), *trials(["baseline_circle"], ["sindyc"], 2)]
    outcomes = [dc.replace(BLANK, solve_failures=number) for number in (0, 7, 0, 1, 2)]
    medians = comparison(todo, outcomes)["medians"]
    assert [row["solve_failures"] for row in medians] == [7, 3]


def test_every_run_is_a_line_of_the_file(tmp_path):
    todo = trials(["rectangle"], ["sindyc"], 2)
    outcomes = [dc.replace(BLANK, y_m=0.25), dc.replace(BLANK, oscillation=1.5)]
    save_runs(todo, outcomes, tmp_path / "runs.csv")
    with (tmp_path / "runs.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["scenario"], row["robot"], row["seed"]) for row in rows] == [
        ("rectangle", "sindyc", "0"),
        ("rectangle", "sindyc", "1"),
    ]
    for row, result in zip(rows, outcomes, strict=True):
        assert {key: float(row[key]) for key in FIELDS} == dc.asdict(result)
