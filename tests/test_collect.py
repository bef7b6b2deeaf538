import dataclasses as dc

import numpy as np
import pytest
from pydrake.systems.framework import LeafSystem

from mirte_drake.collect import Collected, collect, collect_scenario, num_samples
from mirte_drake.control.excitation import ExcitationConfig, excitation
from mirte_drake.identification.fit_sindyc import identify
from mirte_drake.identification.recorded_run import RecordedRun
from mirte_drake.identification.synthetic_recording import (
    SyntheticRecordingConfig,
    synthetic_recording,
)
from mirte_drake.model.model_file import load_model, load_model_file
from mirte_drake.robots.odometry_sensor import OdometrySensorConfig, body_increment, next_pose
from mirte_drake.robots.robot_ports import RobotPorts
from mirte_drake.robots.sindyc_robot import AddSindycRobot, SindycRobotConfig
from mirte_drake.scenario import Scenario
from mirte_drake.scenario_file import load_scenario

SHORT = ExcitationConfig(duration=12.0, random_duration=6.0)
# [m/s, m/s, rad/s] One tick of one wheel.
QUANTA = np.abs(body_increment(np.array([1.0, 0, 0, 0]), OdometrySensorConfig())) / 0.1


def scenario(model="kinematic", **robot) -> Scenario:
    robot = SindycRobotConfig(model=model, **robot)
    return dc.replace(load_scenario("circle"), robot=robot)


def kinematic(builder) -> RobotPorts:
    config = SindycRobotConfig(model="kinematic")
    return AddSindycRobot(builder, config, start=np.zeros(3))


class CountingRobot(LeafSystem):
    """Moves along x by the command of the first wheel once a sample, which it measures."""

    def __init__(self) -> None:
        super().__init__()
        self._command = self.DeclareVectorInputPort("wheel_command", 4)
        state = self.DeclareDiscreteState(3)
        self.DeclareStateOutputPort("pose", state)
        self.DeclareStateOutputPort("body_velocity", self.DeclareDiscreteState(3))
        self.DeclarePeriodicDiscreteUpdateEvent(0.1, 0.05, self._update)

    def _update(self, context, next_state):
        moved = self._command.Eval(context)[0]
        x = context.get_discrete_state(0).value()[0]
        next_state.set_value(0, [x + moved, 0, 0])
        next_state.set_value(1, [moved / 0.1, 0, 0])


def counting(builder) -> RobotPorts:
    robot = builder.AddSystem(CountingRobot())
    return RobotPorts(
        robot.get_input_port(), robot.GetOutputPort("pose"), robot.GetOutputPort("body_velocity")
    )


def as_run(data: Collected) -> RecordedRun:
    return RecordedRun(data.time, data.pose, data.body_velocity, data.wheel_command)


def test_rows_are_those_of_a_recording_of_any_robot():
    data = collect(counting, SHORT, seed=2)
    command = excitation(SHORT, 2, 0.1)
    np.testing.assert_allclose(data.time, 0.1 * np.arange(121), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(data.wheel_command, [*command, np.zeros(4)])
    # The command of a row acts after it; the velocity of a row is that of the sample before.
    np.testing.assert_allclose(np.diff(data.pose[:, 0]), command[:, 0], atol=1e-9)
    np.testing.assert_array_equal(data.body_velocity[1:, 0], command[:, 0] / 0.1)
    np.testing.assert_array_equal(data.body_velocity[0], np.zeros(3))


@pytest.mark.parametrize("period", [0.1, 0.07])  # The second divides no control interval.
def test_commands_are_held_over_a_sample(period):
    """A robot that integrates them goes where the model does with a zero-order hold."""
    data = collect(kinematic, SHORT, seed=3, period=period)
    expected = load_model("kinematic").roll_out(np.zeros(3), data.wheel_command[:-1], period)
    np.testing.assert_allclose(data.pose, expected, rtol=0, atol=1e-5)


def test_period_need_not_divide_the_control_interval():
    data = collect(counting, SHORT, seed=2, period=0.07)
    assert len(data.time) == num_samples(SHORT, 0.07) == 173  # 12 / 0.07 = 171.4.
    np.testing.assert_array_equal(data.wheel_command[:-1], excitation(SHORT, 2, 0.07))


@pytest.mark.parametrize("model", ["kinematic", "extended_kinematic", "dynamic"])
def test_a_robot_without_wheels_is_recorded_as_by_encoders(model):
    data = collect_scenario(scenario(model), SHORT, seed=1)
    # Made in another way: the model's mean velocities. The count of each wheel errs by half a tick
    # at either end of a sample.
    config = SyntheticRecordingConfig(excitation=SHORT, quantised=False)
    truth = synthetic_recording(load_model(model), config, seed=1)
    assert np.all(np.abs(data.body_velocity[:-1] - truth.body_velocity) <= 4 * QUANTA)
    quanta = data.body_velocity / QUANTA
    assert np.all(np.abs(quanta).max(axis=0) > 100)
    np.testing.assert_allclose(quanta, np.round(quanta), rtol=0, atol=1e-9)


def test_pose_integrates_the_velocity_from_the_scenarios_start():
    data = collect_scenario(scenario(), SHORT)
    np.testing.assert_array_equal(data.pose[0], [0.4, 0.0, 0.0])
    pose = data.pose[0]
    for k in range(1, len(data.pose)):
        pose = next_pose(pose, 0.1 * data.body_velocity[k])
        np.testing.assert_allclose(data.pose[k], pose, rtol=0, atol=1e-12)


def test_the_robots_own_start_comes_first():
    start = np.array([3.0, 2.0, -1.0])
    data = collect_scenario(scenario(initial_pose=start), SHORT)
    np.testing.assert_array_equal(data.pose[0], start)


def test_it_ends_at_rest():
    data = collect_scenario(scenario(), SHORT)
    np.testing.assert_array_equal(data.wheel_command[-1], np.zeros(4))
    np.testing.assert_array_equal(data.body_velocity[-1], np.zeros(3))
    assert np.any(data.body_velocity[1] != 0)


def test_seeds_repeat_and_differ():
    first, again, other = (collect_scenario(scenario(), SHORT, seed=s) for s in (1, 1, 2))
    for name in ("time", "pose", "body_velocity", "wheel_command"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    assert np.any(first.wheel_command != other.wheel_command)


def test_the_seed_is_the_scenarios_unless_given():
    seeded = dc.replace(scenario(), seed=3)
    commands = [
        collect_scenario(seeded, SHORT).wheel_command,
        collect_scenario(scenario(), SHORT, seed=3).wheel_command,
        collect_scenario(seeded, SHORT, seed=0).wheel_command,
    ]
    np.testing.assert_array_equal(commands[0], commands[1])
    assert np.any(commands[0] != commands[2])


def test_every_row_is_announced():
    calls = []
    collect(counting, SHORT, on_sample=lambda: calls.append(1))
    assert len(calls) == num_samples(SHORT) == 121


def test_rejects_a_bad_excitation():
    with pytest.raises(ValueError, match=r"^duration: "):
        collect(counting, ExcitationConfig(duration=0.5))


@pytest.mark.parametrize("kind", ["kinematic", "extended_kinematic"])
def test_the_robot_is_identified_from_its_recording(kind):
    data = collect_scenario(scenario(kind), ExcitationConfig())
    found, truth = identify(as_run(data), kind).derivatives, load_model_file(kind).derivatives
    for state, table in truth.items():
        assert set(found[state]) == set(table)
        error = [found[state][term] - value for term, value in table.items()]
        # 0.015 to 0.054 measured: TVR smooths; with the robot's true pose it is the same.
        assert np.linalg.norm(error) < 0.08 * np.linalg.norm(list(table.values()))
