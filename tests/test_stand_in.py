import dataclasses as dc
import multiprocessing

import numpy as np
import pytest
from scripted_link import ScriptedLink

from mirte_drake.hardware.link import Role
from mirte_drake.hardware.messages import Odometry, WheelCommand
from mirte_drake.robot_assembly import MakeRobot
from mirte_drake.scenario_file import load_scenario
from mirte_drake.stand_in import PERIOD, StandIn

FORWARD = np.full(4, 50.0)


def still(**change):
    """The rectangle's robot, undisturbed."""
    overrides = [f"{key}={value}" for key, value in change.items()]
    return load_scenario("rectangle", ["disturbance.bound=[0, 0, 0]", *overrides])


def run(scenario, seconds, commands=()):
    """Returns the stand-in and the link it spoke on, after commands at given times."""
    link = ScriptedLink(Role.ROBOT)
    robot = StandIn(scenario, link, link.clock)
    for time, command in commands:
        link.at(100.0 + time, WheelCommand(np.array(command)))
    while link.now < 100.0 + seconds:
        robot.step()
    return robot, [(time - 100.0, message) for time, message in link.sent]


def test_odometry_comes_at_10_hz_with_stamps_as_even():
    _, sent = run(still(), 1.04)
    times = [time for time, _ in sent]
    np.testing.assert_allclose(times, np.arange(11) * PERIOD, atol=1e-6)
    stamps = np.array([message.stamp for _, message in sent])
    np.testing.assert_allclose(np.diff(stamps), 1e8, atol=200)  # [ns]
    assert all(isinstance(message, Odometry) for _, message in sent)


def test_it_stands_until_the_first_command_and_then_obeys_at_once():
    robot, sent = run(still(), 1.0, [(0.2, np.zeros(4)), (0.43, FORWARD)])
    start = still().first_pose
    for time, message in sent:
        if time < 0.45:
            np.testing.assert_array_equal(message.pose, start)
    moved = np.array([message.pose - start for _, message in sent])
    speed = sent[-1][1].body_velocity[0]
    assert speed > 0.2
    # The kinematic robot runs at once: at 0.5 it has been moving for 0.07 s.
    assert moved[5, 0] == pytest.approx(0.07 * speed, rel=1e-2)
    assert moved[9, 0] == pytest.approx(0.47 * speed, rel=1e-2)
    np.testing.assert_array_equal(robot.command, FORWARD)


@pytest.mark.parametrize("start", [100.0, 9000.3, 1e6 + 0.7, 1e7 + 0.1])
def test_velocity_is_that_of_the_motion_before_whatever_the_clock_reads(start):
    """A clock's round-off grows with its reading: no disturbance may change before its time."""
    link = ScriptedLink(Role.ROBOT)
    link.now = start
    robot = StandIn(load_scenario("rectangle"), link, link.clock)
    link.at(start + 0.15, WheelCommand(FORWARD))
    while link.now < start + 4.0:
        robot.step()
    yaw = np.array([message.pose[2] for _, message in link.sent])
    rate = np.array([message.body_velocity[2] for _, message in link.sent])
    assert np.ptp(rate) > 0.1
    np.testing.assert_allclose(np.diff(yaw)[3:] / PERIOD, rate[4:], atol=0.01)


def compiled_while_it_drives(kind):
    """Names of the functions that a new process compiles, or loads, after it is on the wire."""
    from numba.core.dispatcher import Dispatcher

    link = ScriptedLink(Role.ROBOT)
    robot = StandIn(still(robot=f"!{kind}RobotConfig {{}}"), link, link.clock)
    link.at(100.2, WheelCommand(FORWARD))
    late, compiling = [], Dispatcher.compile
    Dispatcher.compile = lambda self, of: late.append(self.py_func.__name__) or compiling(self, of)
    while link.now < 101.0:
        robot.step()
    assert len(link.sent) > 5
    assert link.sent[-1][1].body_velocity[0] > 0.1
    return late


@pytest.mark.parametrize("kind", ["Sindyc", "Dynamic", "Multibody"])
def test_nothing_is_compiled_while_it_drives(kind):
    """It takes a third of a second even where it is only loaded: the drive would end for it."""
    with multiprocessing.get_context("spawn").Pool(1) as process:
        assert process.apply(compiled_while_it_drives, [kind]) == []


def test_the_last_command_persists():
    robot, sent = run(still(), 5.0, [(0.2, FORWARD)])
    assert sent[-1][1].body_velocity[0] == pytest.approx(sent[5][1].body_velocity[0], rel=1e-2)
    assert robot.pose[0] - still().first_pose[0] > 1.0


def test_it_moves_as_in_simulation():
    """Commands at the samples give the poses that the Diagram alone gives."""
    from pydrake.systems.analysis import Simulator

    scenario = still(robot="!DynamicRobotConfig {}")
    # A command that comes with odometry counts from the next instant on.
    _, sent = run(scenario, 1.01, [(0.3 + 1e-9, FORWARD)])
    diagram = MakeRobot(scenario)
    simulator = Simulator(diagram)
    simulator.get_mutable_integrator().set_target_accuracy(scenario.accuracy)
    diagram.GetInputPort("wheel_command").FixValue(simulator.get_mutable_context(), FORWARD)
    for time, message in sent:
        if time >= 0.3:
            simulator.AdvanceTo(max(time - 0.3, 0))
            expected = diagram.GetOutputPort("pose").Eval(simulator.get_context())
            np.testing.assert_allclose(message.pose, expected, atol=2e-3)


def test_wheels_turn_no_faster_than_they_can():
    robot, _ = run(still(), 0.5, [(0.2, [1000, -1000, 50, 0])])
    np.testing.assert_array_equal(robot.command, [100, -100, 50, 0])


def test_it_measures_how_fast_it_is_answered():
    robot, _ = run(still(), 0.5, [(0.101, FORWARD), (0.203, FORWARD), (0.204, FORWARD)])
    assert robot.log.latencies == pytest.approx([0.001, 0.003], abs=1e-6)
    assert robot.log.commands == 3


def test_held_up_it_sends_one_late_odometry_and_leaves_the_others_out():
    link = ScriptedLink(Role.ROBOT)
    robot = StandIn(still(), link, link.clock)
    while link.now < 100.25:
        robot.step()
    link.now += 0.33
    while link.now < 101.0:
        robot.step()
    times = np.array([time for time, _ in link.sent]) - 100.0
    expected = [0, 0.1, 0.2, 0.58, 0.6, 0.7, 0.8, 0.9, 1.0]
    np.testing.assert_allclose(times, expected, atol=1e-6)


def test_disturbance_and_seed_are_the_scenarios():
    scenario = load_scenario("rectangle")
    poses = []
    for seed in (0, 0, 1):
        robot, _ = run(dc.replace(scenario, seed=seed), 1.0, [(0.2, FORWARD)])
        poses.append(robot.pose)
    np.testing.assert_array_equal(poses[0], poses[1])
    assert np.max(np.abs(poses[0] - poses[2])) > 1e-4
