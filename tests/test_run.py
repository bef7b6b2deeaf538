import dataclasses as dc
import functools
import itertools
import json

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from mirte_drake.angles import pose_error
from mirte_drake.assembly import MakeDiagram
from mirte_drake.control.dlqr import design_dlqr
from mirte_drake.control.realtime_nmpc import RealtimeNmpc
from mirte_drake.control.tracking_problem import cost_and_gradient
from mirte_drake.control.tube import rotated_bound
from mirte_drake.errors import UserError
from mirte_drake.model.model_file import load_model
from mirte_drake.run import Run, simulate
from mirte_drake.run_summary import save_run, summarise
from mirte_drake.scenario_file import load_scenario
from mirte_drake.systems.wheel_command_limiter import limit_wheel_command

W_MAX = np.array([0.04, 0.03, 0.09])
TS = 0.1
MODEL = load_model("extended_kinematic")


@functools.cache
def short_run(*overrides: str, name: str = "rectangle") -> Run:
    return simulate(load_scenario(name, ["duration=4", *overrides]), name)


def closed_loop(log, k):
    Q, R = 1000 * np.eye(3), 0.001 * np.eye(4)
    design = design_dlqr(MODEL, log["nominal_pose"][k], log["nominal_input"][k], TS, Q, R)
    np.testing.assert_allclose(design.gain, log["gain"][k], atol=1e-12)
    return design.closed_loop


def test_the_applied_input_is_nominal_plus_ancillary():
    for log in (short_run().log, short_run(name="turning_circle").log):
        error = log["pose"] - log["nominal_pose"]
        expected = log["nominal_input"] - np.einsum("kij,kj->ki", log["gain"], error)
        np.testing.assert_allclose(log["applied_input"], expected, rtol=0, atol=1e-9)
        assert np.abs(error[1:]).max() > 1e-4  # The tube is used: the law has something to do.


def test_the_half_width_follows_the_recursion():
    log = short_run().log
    assert log["half_width"][0].tolist() == [0, 0, 0]
    for k in range(len(log["time"]) - 1):
        expected = np.abs(closed_loop(log, k)) @ log["half_width"][k] + TS * W_MAX
        np.testing.assert_allclose(log["half_width"][k + 1], expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("which", ["current", "next"])
def test_the_bounds_are_those_of_the_source(which):
    log = short_run(f"tube_updater.tightening_half_width={which}").log
    assert log["input_upper"][0].tolist() == [90] * 4
    for k in range(len(log["time"]) - 1):
        d = log["half_width"][k + (which == "next")]
        room = np.abs(log["gain"][k]) @ d
        np.testing.assert_allclose(log["input_lower"][k + 1], -100 + room, rtol=0, atol=1e-12)
        np.testing.assert_allclose(log["input_upper"][k + 1], 100 - room, rtol=0, atol=1e-12)


def test_the_rotated_bound_turns_the_disturbance_box():
    log = short_run("tube_updater.disturbance_frame=rotated", name="turning_circle").log
    for k in range(len(log["time"]) - 1):
        w = rotated_bound(W_MAX, log["nominal_pose"][k, 2])
        expected = np.abs(closed_loop(log, k)) @ log["half_width"][k] + TS * w
        np.testing.assert_allclose(log["half_width"][k + 1], expected, rtol=0, atol=1e-12)


def test_stagewise_tightening_gives_later_stages_less_room():
    scenario = load_scenario("rectangle", ["tube_updater.tightening_over_horizon=stagewise"])
    diagram = MakeDiagram(scenario)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.25)
    plan = diagram.GetOutputPort("plan").Eval(simulator.get_context())
    # The tube still grows, so each stage's bound is tighter than the one before.
    assert np.all(np.diff(plan.data.input_upper, axis=0) < 0)
    assert np.all(plan.inputs <= plan.data.input_upper)


def test_no_sample_is_lost_between_measurement_and_command():
    """The pose at t_k, the command that follows from it and the next pose fit together."""
    log = short_run().log
    for k in range(len(log["time"]) - 1):
        x, yaw = log["pose"][k], log["pose"][k, 2]
        np.testing.assert_allclose(  # The problem solved at t_k holds the pose of t_k.
            np.abs(x - log["nominal_pose"][k]) <= log["half_width"][k] + 1e-12, True
        )
        u, w = log["applied_input"][k], log["disturbance"][k]
        steps = 200
        for _ in range(steps):  # Fine Euler-free check: many RK4 steps with the turning drift.
            yaw = x[2]
            drift = np.array(
                [
                    np.cos(yaw) * w[0] - np.sin(yaw) * w[1],
                    np.sin(yaw) * w[0] + np.cos(yaw) * w[1],
                    w[2],
                ]
            )
            x = MODEL.step(x, u, TS / steps) + TS / steps * drift
        np.testing.assert_allclose(log["pose"][k + 1], x, rtol=0, atol=2e-6)


@pytest.mark.parametrize("period", [0.1, 0.07, 1 / 3])
def test_exactly_one_solve_per_sample(period, monkeypatch):
    solved = []
    solve = RealtimeNmpc.solve

    def counted(self, data, guess):
        solved.append(data.state.copy())
        return solve(self, data, guess)

    monkeypatch.setattr(RealtimeNmpc, "solve", counted)
    overrides = [f"period={period}", f"duration={12 * period}"]
    log = simulate(load_scenario("rectangle", overrides), "rectangle").log
    np.testing.assert_allclose(log["time"], period * np.arange(13), atol=1e-12)
    # The first one is at rest, at construction, to compile.
    np.testing.assert_array_equal(solved[1:], log["pose"])


@pytest.mark.parametrize("name", ["robot_rectangle", "robot_circle"])
def test_with_robot_settings_the_limiter_stands_between_law_and_wheels(name):
    log = short_run(name=name).log
    error = log["pose"] - log["nominal_pose"]
    asked = log["nominal_input"] - np.einsum("kij,kj->ki", log["gain"], error)
    limited = limit_wheel_command(asked, limit=100.0, deadband=10.0, round_to_integer=True)
    np.testing.assert_array_equal(log["applied_input"], limited)


def test_a_stop_reaches_rest_through_deadband_and_rounding(monkeypatch):
    """Rounding up again must not keep the ramp from going on."""
    solve = RealtimeNmpc.solve
    count = itertools.count()

    def failing(self, data, guess):
        solution = solve(self, data, guess)
        return dc.replace(solution, success=next(count) < 30, message="broken on purpose")

    monkeypatch.setattr(RealtimeNmpc, "solve", failing)
    overrides = ["nominal_nmpc.rate_limit=4", "duration=12", "wheel_command_limiter.deadband=0"]
    log = simulate(load_scenario("robot_rectangle", overrides), "robot").log
    assert np.all(np.diff(np.abs(log["applied_input"][34:]), axis=0) <= 0)
    assert np.all(log["applied_input"][-1] == 0)
    assert np.any(log["applied_input"][33] != 0)


def test_ctrl_c_ends_the_run(monkeypatch):
    evaluations = itertools.count()

    def interrupted(*arguments):
        if next(evaluations) == 40:
            raise KeyboardInterrupt
        return cost_and_gradient(*arguments)

    monkeypatch.setattr("mirte_drake.control.nmpc_program.cost_and_gradient", interrupted)
    with pytest.raises(KeyboardInterrupt):
        simulate(load_scenario("rectangle", ["nominal_nmpc.solver=snopt"]), "rectangle")


def test_bounds_that_outrun_the_rate_limit_stop_nobody():
    legs = "reference=!VelocityLegsPath {legs: [{duration: 6, velocity: [1.0, 0, 0.8]}]}"
    disturbance = "disturbance=!ConstantDisturbance {value: [0.05, 0.05, 0.05]}"
    summary = summarise(simulate(load_scenario("robot_rectangle", [legs, disturbance]), "fast"))
    assert summary["solve_failures"] == 0 and summary["rate_violations"] == 0


def test_the_same_seed_gives_the_same_log():
    one = short_run().log
    two = simulate(load_scenario("rectangle", ["duration=4"]), "rectangle").log
    other = short_run("seed=1").log
    for key in one.keys() - {"solve_time_s", "preparation_time_s"}:
        np.testing.assert_array_equal(one[key], two[key], err_msg=key)
    assert not np.array_equal(one["pose"], other["pose"])


def test_two_simulators_on_one_diagram_do_not_disturb_each_other():
    diagram = MakeDiagram(load_scenario("circle"))
    pose = diagram.GetOutputPort("pose")
    alone = Simulator(diagram)
    alone.AdvanceTo(1.0)
    expected = pose.Eval(alone.get_context())

    first, second = Simulator(diagram), Simulator(diagram)
    for k in range(1, 11):
        first.AdvanceTo(0.1 * k)
        second.AdvanceTo(0.05 * k)
    np.testing.assert_array_equal(pose.Eval(first.get_context()), expected)
    second.AdvanceTo(1.0)
    np.testing.assert_allclose(pose.Eval(second.get_context()), expected, atol=1e-9)


def test_log_has_the_contract_arrays_and_shapes():
    log = short_run().log
    n = 41
    shapes = {
        "time": (n,),
        "reference": (n, 3),
        "pose": (n, 3),
        "true_pose": (n, 3),
        "nominal_pose": (n, 3),
        "nominal_next": (n, 3),
        "nominal_plan": (n, 10, 4),
        "nominal_input": (n, 4),
        "applied_input": (n, 4),
        "gain": (n, 4, 3),
        "half_width": (n, 3),
        "input_lower": (n, 4),
        "input_upper": (n, 4),
        "disturbance": (n, 3),
        "solve_time_s": (n,),
        "preparation_time_s": (n,),
        "iterations": (n,),
        "status": (n,),
    }
    assert {key: value.shape for key, value in log.items()} == shapes


def test_summary_has_the_contract_keys_and_counts_by_hand():
    run = short_run()
    summary = summarise(run)
    assert list(summary) == [
        "scenario",
        "seed",
        "steps",
        "simulated_time_s",
        "wall_time_s",
        "rmse",
        "true_rmse",
        "solve_time_ms",
        "feedback_time_ms",
        "solver",
        "solve_failures",
        "rate_relaxations",
        "early_solves",
        "tube_violations",
        "successor_violations",
        "input_violations",
        "rate_violations",
        "versions",
    ]
    assert summary["steps"] == 41 and summary["simulated_time_s"] == pytest.approx(4.0)
    x_error = run.log["pose"][:, 0] - run.log["reference"][:, 0]
    assert summary["rmse"]["x_m"] == pytest.approx(np.sqrt(np.mean(x_error**2)), rel=1e-12)
    assert summary["true_rmse"] == summary["rmse"]  # The study measures the true pose.


def test_log_and_summary_of_a_controller_that_does_not_plan_have_no_plan(tmp_path):
    run = short_run(name="lqr_rectangle")
    assert set(run.log) == {
        *("time", "reference", "pose", "true_pose", "applied_input", "disturbance")
    }
    planned = short_run(name="baseline_rectangle").log
    for key, value in run.log.items():
        assert value.shape == planned[key].shape
    np.testing.assert_array_equal(run.log["reference"], planned["reference"])
    np.testing.assert_array_equal(run.log["disturbance"], planned["disturbance"])
    assert list(save_run(run, tmp_path)) == [
        *("scenario", "seed", "steps", "simulated_time_s", "wall_time_s"),
        *("rmse", "true_rmse", "versions"),
    ]


def test_rmse_is_of_odometry_and_true_rmse_of_where_the_robot_is():
    run = short_run("robot=!MultibodyRobotConfig {floor_friction: 0.05}")
    summary = summarise(run)
    for key, pose in (("rmse", "pose"), ("true_rmse", "true_pose")):
        error = pose_error(run.log[pose], run.log["reference"])
        np.testing.assert_allclose(
            list(summary[key].values()), np.sqrt(np.mean(error**2, axis=0)), rtol=1e-12
        )
    # The wheels spin where the robot does not follow.
    assert summary["true_rmse"]["x_m"] > 1.5 * summary["rmse"]["x_m"]


@pytest.mark.parametrize("robot", ["Dynamic", "Multibody"])
def test_odometry_is_measured_at_the_instant_of_the_true_pose(robot):
    """Wheels that hardly slip: they part by ticks and jitter, not by a step of the robot."""
    perfect = "odometry={ticks_per_revolution: 1000000, jitter: 0}"
    log = short_run(f"robot=!{robot}RobotConfig {{}}", perfect).log
    moved = np.linalg.norm(np.diff(log["true_pose"][:, :2], axis=0), axis=1)
    seen = np.linalg.norm(np.diff(log["pose"][:, :2], axis=0), axis=1)
    assert moved.max() > 0.01
    np.testing.assert_allclose(seen, moved, rtol=0, atol=1.2e-3)


def test_a_robot_without_an_input_for_a_disturbance_logs_none():
    log = short_run("robot=!MultibodyRobotConfig {}").log
    np.testing.assert_array_equal(log["disturbance"], np.zeros((41, 3)))
    assert np.any(short_run("robot=!DynamicRobotConfig {}").log["disturbance"] != 0)


def test_the_dynamic_robots_accuracy_is_enough():
    coarse, fine = (
        short_run("robot=!DynamicRobotConfig {}", f"integration_accuracy={accuracy}").log
        for accuracy in ("null", "1e-5")
    )
    np.testing.assert_allclose(coarse["true_pose"], fine["true_pose"], rtol=0, atol=1e-3)


def test_violations_are_counted_where_they_are():
    log = {key: value.copy() for key, value in short_run().log.items()}
    log["pose"][5] += [0, 0, 0.02]  # Outside the tube at 5; also not where sample 4 predicted.
    log["nominal_pose"][7, 0] += 0.5  # Outside the tube at 7, and the law asks for too much.
    log["nominal_input"][9, 0] += 50.0  # Two moves too large: there and back.
    log["status"][3] = 1
    run = short_run()
    before, after = summarise(run), summarise(Run(run.name, run.scenario, log, run.rate_limit, 0.0))
    changes = {k: after[k] - before[k] for k in after if k.endswith(("violations", "failures"))}
    assert changes == {
        "solve_failures": 1,
        "tube_violations": 2,
        "successor_violations": 1,
        "input_violations": 1,
        "rate_violations": 2,
    }


def test_yaw_error_is_wrapped_and_log_is_unwrapped():
    run = simulate(load_scenario("turning_circle"), "turning_circle")
    assert run.log["pose"][-1, 2] > 2 * np.pi
    assert np.abs(np.diff(run.log["pose"][:, 2])).max() < 0.1
    assert np.abs(pose_error(run.log["pose"], run.log["reference"])[:, 2]).max() < 0.1


def test_a_run_saves_and_loads(tmp_path):
    run = short_run()
    summary = save_run(run, tmp_path / "deep" / "folder")
    with np.load(tmp_path / "deep" / "folder" / "log.npz") as log:
        assert sorted(log) == sorted(run.log)
        np.testing.assert_array_equal(log["gain"], run.log["gain"])
    assert json.loads((tmp_path / "deep" / "folder" / "summary.json").read_text()) == summary
    again = load_scenario(str(tmp_path / "deep" / "folder" / "as_run.scenario.yaml"))
    assert repr(again) == repr(run.scenario)
    assert sorted(p.name for p in (tmp_path / "deep" / "folder").iterdir()) == [
        "as_run.scenario.yaml",
        "log.npz",
        "summary.json",
    ]


def test_a_folder_that_is_a_file_is_a_user_error(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(UserError, match="cannot be written"):
        save_run(short_run(), tmp_path / "file")


def test_a_failing_solver_stops_the_robot_and_is_counted():
    """No solve can meet this limit: the run goes on, the wheels stay at rest."""
    run = short_run("nominal_nmpc.solver=snopt", "nominal_nmpc.time_limit=1e-9")
    summary = summarise(run)
    assert summary["solve_failures"] == summary["steps"] == 41
    assert np.all(run.log["applied_input"] == 0)
    assert np.all(run.log["status"] == 2)


def test_published_logs_have_no_columns_of_other_controllers():
    run = short_run()
    assert not {"reached", "coverage"} & (run.log.keys() | summarise(run).keys())


def test_the_rigorous_tube_is_logged_and_summarised():
    run = short_run(name="rigorous_rectangle")
    summary = summarise(run)
    assert summary["successor_violations"] == summary["tube_violations"] == 0
    assert summary["input_violations"] == 0
    np.testing.assert_array_equal(run.log["reached"], np.ones(41))
    error = np.abs(run.log["pose"] - run.log["nominal_pose"])
    assert np.all(error <= run.log["half_width"] + 1e-9) and error.max() > 1e-3


def test_a_law_that_cannot_reach_what_it_wants_is_counted():
    # The initial tube is so wide that its first correction takes more than the wheels have.
    wide = "inversion_tube_updater.initial_half_width=[0.1, 0.1, 0.1]"
    summary = summarise(
        short_run(wide, "robot.initial_pose=[-0.4, -0.3, 0.1]", name="rigorous_rectangle")
    )
    assert summary["input_violations"] >= 1
    assert summary["successor_violations"] == 0  # The tube knows.


def test_coverage_is_logged_and_summarised():
    run = short_run("coverage_monitor={window: 20}", name="rigorous_rectangle")
    log, coverage = run.log, summarise(run)["coverage"]
    held = np.all(np.abs(log["prediction_error"][1:]) <= W_MAX, axis=1)
    assert coverage["in_use"] == held.mean() > 0.9
    scale = log["calibrated_bound"][:, 0] / W_MAX[0]
    needed = np.max(np.abs(log["prediction_error"][1:]) / W_MAX, axis=1)
    assert coverage["calibrated"] == pytest.approx(np.mean(needed <= scale[:-1]))
    assert coverage["target"] == 0.9 and coverage["beyond_cap"] == 0
    warned = np.sum(log["coverage_warning"], axis=0)
    assert coverage["warnings"] == {"in_use": warned[0], "calibrated": warned[1]}
    assert log["coverage"].shape == (41, 2)
