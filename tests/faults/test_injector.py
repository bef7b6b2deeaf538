import numpy as np
import pytest
from scripted_link import ScriptedLink

from mirte_drake.faults import odometry_faults as faults
from mirte_drake.faults.injector import FaultyLink
from mirte_drake.hardware.link import Role
from mirte_drake.hardware.messages import Odometry, WheelCommand


class Robot:
    """A robot that sends odometry at 10 Hz through a FaultyLink, from 100.0 s on."""

    def __init__(self, fault=None, seed=0):
        self.wire = ScriptedLink(Role.ROBOT)
        self.link = FaultyLink(self.wire, np.random.default_rng(seed), self.wire.clock)
        self.link._wall = 0  # Stamps are those of the scripted clock.
        self.run(3)
        self.link.fault = fault

    def run(self, messages):
        for _ in range(messages):
            now = self.wire.now
            stamp = round(1e9 * now)
            self.link.send(Odometry(stamp, np.array([now - 100.0, 0.0, 0.0]), np.zeros(3)))
            while self.wire.now < now + 0.1 - 1e-9:
                self.link.wait(now + 0.1 - self.wire.now)

    @property
    def sent(self):
        return [(round(time - 100.0, 6), message) for time, message in self.wire.sent]


def test_without_a_fault_all_goes_through_at_once():
    robot = Robot()
    times = [time for time, _ in robot.sent]
    assert times == [0.0, 0.1, 0.2]
    for sent, time in zip(robot.link.odometry, times, strict=True):
        assert sent.measured == pytest.approx(100.0 + time)
        assert sent.sent == pytest.approx(100.0 + time)
        assert sent.good and not sent.altered


def test_a_fault_knows_what_was_before_it():
    met = []
    robot = Robot(lambda passing: met.append(passing) or [])
    robot.run(2)
    assert [passing.number for passing in met] == [0, 1]
    assert [round(passing.before.pose[0], 6) for passing in met] == [0.2, 0.2]
    assert [round(passing.previous.pose[0], 6) for passing in met] == [0.2, 0.3]
    np.testing.assert_allclose(np.linalg.norm(met[0].direction), 1.0)
    assert met[0].direction is met[1].direction and met[0].sign in (-1, 1)
    assert len(robot.sent) == 3


def test_delayed_messages_come_when_they_are_due():
    robot = Robot(faults.late_by(0.25, 0.25))
    robot.run(4)
    assert [time for time, _ in robot.sent[3:]] == pytest.approx([0.55, 0.65])
    late = robot.link.odometry[3]
    assert late.sent - late.measured == pytest.approx(0.25) and late.altered


def test_random_delays_change_the_order():
    robot = Robot(faults.late_by(0.0, 0.5), seed=1)
    robot.run(20)
    stamps = [message.stamp for _, message in robot.sent]
    assert stamps != sorted(stamps)
    times = [time for time, _ in robot.sent]
    assert times == sorted(times)


def test_of_a_swapped_pair_the_record_knows_when_each_was_measured():
    robot = Robot(faults.swapped)
    robot.run(2)
    measured = [round(sent.measured - 100.0, 6) for sent in robot.link.odometry[3:]]
    assert measured == [0.4, 0.3]
    assert [sent.good for sent in robot.link.odometry[3:]] == [True, False]


def test_the_fault_ends_when_it_is_taken_away():
    robot = Robot(faults.silent)
    robot.run(3)
    robot.link.fault = None
    robot.run(1)
    assert [time for time, _ in robot.sent] == pytest.approx([0.0, 0.1, 0.2, 0.6])


def test_wheel_commands_are_recorded_and_handed_on():
    robot = Robot()
    robot.wire.at(100.45, WheelCommand(np.full(4, 7.0)))
    robot.run(3)
    (command,) = robot.link.take(WheelCommand)
    assert command.arrival == 100.45
    assert robot.link.commands == [command]
    assert robot.link.count(WheelCommand) == 1
