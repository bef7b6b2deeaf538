import csv
import dataclasses as dc

import numpy as np
import pytest
from cli_runner import check_wrong_use, run_cli

from mirte_drake.faults import trial as trial_module
from mirte_drake.faults.campaign import (
    kinds_text,
    report,
    report_text,
    save_failures,
    save_trials,
    trials,
)
from mirte_drake.faults.evaluation import Verdict
from mirte_drake.faults.kind import drives_on
from mirte_drake.faults.kinds import KINDS
from mirte_drake.faults.trial import Outcome, Trial, run_trial

pytestmark = [
    pytest.mark.realtime,
    pytest.mark.xdist_group("wire"),
]  # In real time: one after the other.


def outcome(kind, run, stop_time=np.nan, reason="drove on", problems=()):
    verdict = Verdict(bool(np.isfinite(stop_time)), stop_time, reason, problems)
    return Outcome(Trial(kind, "lcm", 0, run, run), verdict, timeline=("what happened",))


OUTCOMES = [
    outcome("odometry_stops", 0, 0.231, "odometry is old, rejected: a jump: 0.231 s"),
    outcome("odometry_stops", 1, 0.235, "odometry is old: 0.235 s (limit 0.23 s)"),
    outcome("odometry_stops", 2, 0.261, "controller is silent: 0.24 s", ("zero too late",)),
    outcome("yaw_at_pi", 0),
]


def test_every_kind_has_its_runs_and_every_trial_a_number_of_its_own():
    todo = trials(["a", "b"], "lcm", 3, 7)
    assert [trial.kind for trial in todo] == ["a", "b"] * 3
    assert [trial.number for trial in todo] == list(range(6))
    assert [trial.run for trial in todo if trial.kind == "b"] == [0, 1, 2]
    assert {trial.seed for trial in todo} == {7}
    # Both ways to have a guard are met.
    assert {trial.own_guard for trial in todo if trial.kind == "a"} == {True, False}


def test_the_report_counts():
    stopping, driving = report(OUTCOMES)["kinds"]
    assert (stopping["runs"], stopping["passed"], stopping["stops_due"]) == (3, 2, 3)
    assert stopping["stop_time_s"] == {"p50": 0.235, "max": 0.261, "limit": 0.25}
    assert stopping["reasons"] == {"odometry is old": 2, "controller is silent": 1}
    assert stopping["problems"] == {"zero too late": 1}
    assert stopping["due"] == KINDS["odometry_stops"].outcome
    assert (driving["passed"], driving["stop_time_s"]["max"]) == (1, None)


def test_the_table():
    lines = report_text(report(OUTCOMES)).splitlines()
    (stopping,) = (line for line in lines if line.startswith("odometry_stops"))
    assert stopping.split()[1:7] == ["3", "2", "3", "235", "261", "250"]
    assert "1 x zero too late" in "\n".join(lines)
    assert lines[-1] == "2 kinds, 4 trials, 3 passed"


def test_a_trial_that_breaks_down_has_failed(monkeypatch):
    def run(trial, kind):
        raise OSError("no such process")

    monkeypatch.setattr(trial_module, "_run", run)
    outcome = run_trial(Trial("nothing", "lcm", 0, 0, 0), drives_on("nothing"))
    assert not outcome.verdict.passed and "no such process" in outcome.verdict.problems[0]


def test_what_is_written(tmp_path):
    save_trials(OUTCOMES, tmp_path / "trials.csv")
    rows = list(csv.DictReader((tmp_path / "trials.csv").open()))
    assert [row["passed"] for row in rows] == ["True", "True", "False", "True"]
    assert rows[2]["problems"] == "zero too late" and float(rows[2]["stop_time_s"]) == 0.261
    save_failures(OUTCOMES, tmp_path / "failures.txt")
    text = (tmp_path / "failures.txt").read_text()
    assert text.splitlines() == ["odometry_stops, run 2: zero too late", "what happened"]


def test_the_list_shows_every_kind(capsys):
    code, out, _ = run_cli(capsys, "faults", "--list")
    assert code == 0 and out.strip() == kinds_text()
    for kind in KINDS.values():
        assert kind.outcome in out


def test_wrong_use(capsys):
    check_wrong_use(capsys, ["faults", "--kind", "odometry_stop"], ["odometry_stop", "--list"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "lax", "problem"),
    [
        ("odometry_stops", "max_odometry_age=0.4", "after it was due"),
        ("controller_lost", "heartbeat_timeout=0.4", "after it was due"),
        ("solver_fails_twice", "max_solve_failures=2", "stopped: failed solves in a row"),
    ],
)
def test_a_guard_that_is_not_as_it_should_be_is_found_out(kind, lax, problem):
    trial = Trial(kind, "lcm", 0, 1, 999)
    assert not run_trial(trial).verdict.problems
    changed = dc.replace(KINDS[kind], overrides=(f"robot.governor.{lax}",))
    assert any(problem in told for told in run_trial(trial, changed).verdict.problems)


FAMILIES = [
    "odometry_stops",
    "odometry_jumps_once",
    "odometry_nan",
    "odometry_late_300ms",
    "yaw_at_pi",
    "clock_1h_back",
    "robot_leaves_area",
    "controller_sigkill",
    "controller_raises",
    "solver_fails",
    "guard_sigkill",
    "second_controller",
    "foreign_wheel_command",
    "malformed_drive_command",
    "controller_lost",
    "operator_stops",
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("transport", "kinds"),
    [
        # One of each family; `mirte-drake faults` runs them all.
        ("lcm", FAMILIES),
        ("ros2", ["odometry_stops", "controller_sigkill", "guard_sigkill", "malformed_odometry"]),
    ],
)
def test_every_kind_does_as_stated(capsys, tmp_path, transport, kinds):
    """As the command does: two trials at once, each kind once."""
    if transport == "ros2":
        pytest.importorskip("cyclonedds", reason="cyclonedds is not installed")
    chosen = [word for kind in kinds for word in ("--kind", kind)]
    arguments = ("--runs", 1, "--transport", transport, "--output", tmp_path, *chosen)
    code, out, _ = run_cli(capsys, "faults", *arguments)
    assert code == 0, out
    assert f"{len(kinds)} kinds, {len(kinds)} trials, {len(kinds)} passed" in out
    assert len(list(csv.DictReader((tmp_path / "trials.csv").open()))) == len(kinds)
