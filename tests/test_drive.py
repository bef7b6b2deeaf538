import dataclasses as dc

import numpy as np
from wire_world import WIRE, make_world  # noqa: F401 A fixture.

from mirte_drake.collect import collect_scenario
from mirte_drake.control.excitation import ExcitationConfig
from mirte_drake.drive import collect_over_wire, drive
from mirte_drake.robots.lcm_robot import LcmRobotConfig
from mirte_drake.run import simulate
from mirte_drake.run_summary import summarise
from mirte_drake.scenario_file import load_scenario

SESSION = 77


def wired(scenario, **change):
    return dc.replace(scenario, robot=LcmRobotConfig(WIRE, **change))


def short(seconds=3.0, *overrides):
    return load_scenario("rectangle", [f"duration={seconds}", *overrides])


def rmse(run):
    return np.array(list(summarise(run)["rmse"].values()))


def test_a_drive_is_what_the_simulation_is(make_world):  # noqa: F811
    """The robot obeys a few milliseconds after its odometry, or else nothing differs."""
    scenario = short(12.0)
    world = make_world(scenario)
    run = drive(wired(scenario), "rectangle", world.link, SESSION, clock=world.clock)
    assert run.ended == ""
    simulated = simulate(scenario, "rectangle")
    np.testing.assert_allclose(rmse(run), rmse(simulated), rtol=0.02)
    np.testing.assert_allclose(run.log["pose"], simulated.log["pose"], atol=2e-3)
    assert len(run.log["time"]) == 121
    summary = summarise(run)
    assert summary["true_rmse"] is None and "true_pose" not in run.log
    assert summary["wire"]["missed_odometry"] == 0
    assert summary["wire"]["odometry_age_ms"]["max"] < 1.5


def test_a_controller_that_does_not_plan_drives_over_the_wire(make_world):  # noqa: F811
    scenario = load_scenario("pid_rectangle", ["duration=3"])
    world = make_world(scenario)
    run = drive(wired(scenario), "pid_rectangle", world.link, SESSION, clock=world.clock)
    assert run.ended == "" and "nominal_plan" not in run.log
    np.testing.assert_allclose(rmse(run), rmse(simulate(scenario, "pid_rectangle")), rtol=0.1)
    assert np.any(run.log["applied_input"] != 0.0)


def test_a_robot_switched_on_elsewhere_drives_the_same_path(make_world):  # noqa: F811
    scenario = short(5.0, "disturbance.bound=[0, 0, 0]")
    turned = 2.5
    away = np.array([1.0, -2.0, turned])

    def elsewhere(message):
        c, s = np.cos(turned), np.sin(turned)
        x, y, yaw = message.pose
        pose = away + np.array([c * x - s * y, s * x + c * y, yaw])
        pose[2] = np.angle(np.exp(1j * pose[2]))  # As a quaternion gives it.
        return dc.replace(message, pose=pose)

    runs = []
    for odometry in (lambda message: message, elsewhere):
        world = make_world(scenario, odometry)
        runs.append(drive(wired(scenario), "x", world.link, SESSION, clock=world.clock))
    assert [run.ended for run in runs] == ["", ""]
    np.testing.assert_allclose(runs[0].log["pose"], runs[1].log["pose"], atol=1e-6)


def late_by(delay):
    """Odometry of ``delay`` samples ago, but for the first ones: the clocks are known by them."""
    kept = []

    def alter(message):
        kept.append(message)
        return kept[-1 - delay] if len(kept) > 12 else message

    return alter


def test_rolling_forward_makes_good_for_late_odometry(make_world):  # noqa: F811
    """One sample late: what is predicted is nearly what fresh odometry would have said."""
    scenario = short(6.0, "disturbance.bound=[0, 0, 0]")
    errors = []
    for odometry, rolls in ((late_by(0), True), (late_by(1), True), (late_by(1), False)):
        world = make_world(scenario, odometry)
        true = []
        run = drive(
            wired(scenario, roll_forward=rolls),
            "x",
            world.link,
            SESSION,
            on_sample=lambda w=world, t=true: t.append(w.robot.pose),
            clock=world.clock,
        )
        assert run.ended == ""
        errors.append(np.max(np.abs(run.log["pose"] - true)[20:, 0]))
    assert errors[0] < 2e-3 and errors[1] < 2e-3
    assert errors[2] > 8e-3


def test_a_stop_of_the_guard_ends_the_drive(make_world):  # noqa: F811
    scenario = short()
    sent = []

    def silent_after_a_second(message):
        sent.append(message)
        return message if len(sent) < 15 else None

    world = make_world(scenario, silent_after_a_second)
    run = drive(wired(scenario), "x", world.link, SESSION, clock=world.clock)
    assert run.ended.startswith("odometry is old: 0.23")
    assert 10 < len(run.log["time"]) < 20
    assert summarise(run)["wire"]["ended"] == run.ended
    time, command = world.commands[-1]
    np.testing.assert_array_equal(command, np.zeros(4))
    assert time - 101.3 < 0.25  # The last odometry came at 101.3.


def test_a_guard_that_dies_ends_the_drive(make_world):  # noqa: F811
    scenario = short()
    world = make_world(scenario)

    def kill():
        if world.now > 101.2:
            world.guard_lives = False

    run = drive(wired(scenario), "x", world.link, SESSION, on_sample=kill, clock=world.clock)
    assert run.ended.startswith("the guard has said nothing for 0.2")


def test_nobody_there_is_an_end_without_a_log(make_world):  # noqa: F811
    scenario = short()
    world = make_world(scenario, lambda _: None)
    run = drive(wired(scenario), "x", world.link, SESSION, clock=world.clock)
    assert run.ended == "no odometry was heard for 5 s" and run.log == {}


def test_a_recording_over_the_wire_is_that_of_the_robot(make_world):  # noqa: F811
    excitation = ExcitationConfig(duration=6.0, random_duration=3.0)
    scenario = load_scenario("rectangle", ["robot=!DynamicRobotConfig {}"])
    world = make_world(
        dc.replace(scenario, disturbance=short(3.0, "disturbance.bound=[0, 0, 0]").disturbance)
    )
    data = collect_over_wire(
        wired(scenario), excitation, world.link, SESSION, seed=3, clock=world.clock
    )
    expected = collect_scenario(scenario, excitation, seed=3)
    assert data.ended == ""
    np.testing.assert_array_equal(data.wheel_command, expected.wheel_command)
    np.testing.assert_allclose(data.pose, expected.pose, atol=0.02)
    assert np.ptp(data.pose[:, 0]) > 0.05


def test_drives_are_reproducible(make_world):  # noqa: F811
    """But for the robot's stamps, which are wall time and have its rounding."""
    logs = []
    for _ in range(2):
        world = make_world(short(1.0))
        logs.append(drive(wired(short(1.0)), "x", world.link, SESSION, clock=world.clock).log)
    for key in ("pose", "applied_input", "odometry_age_s"):
        np.testing.assert_allclose(logs[0][key], logs[1][key], atol=1e-3)
