import dataclasses as dc
import functools
import json

import numpy as np
import pytest

from mirte_drake.campaign.outcome import (
    LOST_DISTANCE,
    LOST_YAW,
    Failure,
    Outcome,
    oscillation,
    outcome,
    run_outcome,
)
from mirte_drake.robots.names import robot_override
from mirte_drake.robots.sindyc_robot import SindycRobotConfig
from mirte_drake.run import Run, simulate
from mirte_drake.run_summary import summarise
from mirte_drake.scenario_file import load_scenario


@functools.cache
def short_run(robot="multibody", name="rectangle") -> Run:
    return simulate(load_scenario(name, [robot_override(robot), "duration=2"]), name)


def changed(run: Run, **log) -> Outcome:
    return outcome(dc.replace(run, log={**run.log, **log}))


def test_oscillation_by_hand():
    zigzag = np.array([0.0, 1, 0, 1, 0, 1])  # 4 changes.
    ramp = np.arange(6.0)
    stairs = np.array([0.0, 1, 1, 2, 2, 1])  # Rests have no sign: one change.
    trembling = np.array([0.0, 1e-12, 0, 1e-12, 0, 1e-12])  # As still as rounding lets it be.
    commands = np.array([zigzag, ramp, stairs, trembling]).T
    assert oscillation(commands, 0.5) == pytest.approx((4 + 0 + 1 + 0) / 4 / 0.5)


def test_oscillation_of_a_still_command_is_none():
    assert oscillation(np.full((10, 4), 30.0), 1.0) == 0.0


def test_numbers_of_samples_by_hand():
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
        reference=zero,
        nominal_pose=zero,
        nominal_next=zero,
        half_width=width,
        applied_input=command,
    )
    samples = len(zero)
    assert shown.samples == samples == 21
    assert (shown.tube_violations, shown.true_violations, shown.successor_violations) == (1, 3, 1)
    assert shown.measured_inside == pytest.approx(1 - 1 / samples)
    assert shown.true_inside == pytest.approx(1 - 3 / samples)
    assert shown.successor_inside == pytest.approx(1 - 1 / (samples - 1))
    assert shown.saturation == pytest.approx(2 / samples)
    assert shown.max_distance_m == 0.3 and shown.max_yaw_rad == pytest.approx(0.2)


def test_with_a_delay_the_true_pose_is_compared_with_the_plan_of_its_time():
    settings = ["state_estimator.delay=2", "duration=2"]
    run = simulate(load_scenario("lagged_rectangle", settings), "lagged_rectangle")
    zero = np.zeros(run.log["pose"].shape)
    true_pose, nominal_pose = zero.copy(), zero.copy()
    true_pose[[1, 5], 0] = 0.11  # Before the first plan acts, and after.
    nominal_pose[[7, -1], 2] = 0.11  # Acts at 9, and never.
    shown = changed(
        run,
        state=np.zeros(run.log["state"].shape),
        true_pose=true_pose,
        nominal_pose=nominal_pose,
        half_width=np.full(zero.shape, 0.1),
    )
    assert (shown.samples, shown.delay) == (21, 2)
    assert (shown.true_violations, shown.tube_violations) == (2, 2)
    assert shown.true_inside == pytest.approx(1 - 2 / 19)
    assert shown.measured_inside == pytest.approx(1 - 2 / 21)


def test_errors_and_counts_are_those_of_the_summary():
    run = short_run()
    shown, summary = outcome(run), summarise(run)
    for key in ("x_m", "y_m", "yaw_rad"):
        assert getattr(shown, key) == summary["rmse"][key]
        assert getattr(shown, f"true_{key}") == summary["true_rmse"][key]
    for key in (
        *("solve_failures", "input_violations", "rate_violations"),
        *("tube_violations", "successor_violations"),
    ):
        assert getattr(shown, key) == summary[key]
    error = run.log["true_pose"][:, 0] - run.log["reference"][:, 0]
    assert shown.true_x_m == pytest.approx(np.sqrt(np.mean(error**2)))
    assert not shown.lost and shown.measured_inside == 1.0


def test_coverage_is_that_of_the_summary():
    shown = outcome(short_run(name="lagged_rectangle"))
    coverage = summarise(short_run(name="lagged_rectangle"))["coverage"]
    assert shown.errors == coverage["errors"] == shown.samples - 1  # The first has no prediction.
    assert shown.in_use_coverage == pytest.approx(coverage["in_use"])
    assert shown.calibrated_coverage == pytest.approx(coverage["calibrated"])
    unwatched = outcome(short_run())
    assert unwatched.errors is unwatched.in_use_misses is unwatched.calibrated_misses is None
    assert np.isnan(unwatched.calibrated_coverage)


def test_without_a_tube_nothing_is_inside():
    shown = outcome(short_run(name="baseline_rectangle"))
    assert shown.tube_violations is shown.true_violations is shown.successor_violations is None
    for key in ("measured_inside", "true_inside", "successor_inside"):
        assert np.isnan(getattr(shown, key))


def test_a_controller_that_does_not_plan_can_violate_no_plan():
    shown = outcome(short_run(name="lqr_rectangle"))
    assert shown.solve_failures is shown.input_violations is shown.rate_violations is None
    assert shown.true_violations is None and shown.true_x_m > 0.0


@pytest.mark.parametrize(
    ("error", "lost"),
    [
        ([0.0, 0.0, 0.0], False),
        ([0.8 * LOST_DISTANCE, -0.59 * LOST_DISTANCE, 0.0], False),
        ([0.8 * LOST_DISTANCE, -0.61 * LOST_DISTANCE, 0.0], True),
        ([0.0, 0.0, -0.99 * LOST_YAW], False),
        ([0.0, 0.0, 1.01 * LOST_YAW], True),
        ([0.0, 0.0, 2 * np.pi], False),
        ([np.nan, 0.0, 0.0], True),
    ],
)
def test_lost_is_who_was_ever_too_far_away(error, lost):
    run = short_run("sindyc")
    true_pose = run.log["reference"].copy()
    true_pose[7] += error
    assert changed(run, true_pose=true_pose).lost is lost


def test_an_outcome_survives_json_to_the_last_bit():
    shown = outcome(short_run(name="lagged_rectangle"))
    assert Outcome(**json.loads(json.dumps(dc.asdict(shown)))) == shown
    assert all(type(value) in (int, float, bool) for value in dc.astuple(shown))


def test_a_run_that_cannot_be_run_says_why():
    scenario = load_scenario("rectangle", ["duration=1"])
    assert isinstance(run_outcome(scenario), Outcome)
    robot = SindycRobotConfig(model="rocket")
    failure = run_outcome(dc.replace(scenario, robot=robot))
    assert isinstance(failure, Failure)
    assert failure.error.startswith("UserError: ") and "rocket" in failure.error
    assert "\n" not in failure.error


def test_a_run_that_drake_ends_does_not_end_the_process(monkeypatch):
    def end(*_):
        raise SystemExit("Failure at plant.cc")

    monkeypatch.setattr("mirte_drake.campaign.outcome.simulate", end)
    failure = run_outcome(load_scenario("rectangle"))
    assert failure == Failure("SystemExit: Failure at plant.cc")
