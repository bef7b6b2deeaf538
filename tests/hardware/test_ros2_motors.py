"""Wheel commands in the type that the robot wants, whoever comes first, and those of others."""

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed")

from ros2_wire import exchange, own_wire

from mirte_drake.hardware.dds_node import DdsNode, take, write
from mirte_drake.hardware.link import Role
from mirte_drake.hardware.messages import WheelCommand
from mirte_drake.hardware.ros2_motors import MOTOR_TYPES, MotorUsers, motor_topics
from mirte_drake.hardware.wire_config import open_link

DRIVING = WheelCommand(np.array([10.0, -20.0, 30.0, -40.0]))
ZERO = WheelCommand(np.zeros(4))


class Motors:
    """The motor drivers of a robot: readers of one type, as ROS 2 makes them."""

    def __init__(self, config, name):
        self._node = DdsNode(config)
        topics = motor_topics(config.namespace)
        self._readers = [self._node.reader(topic, MOTOR_TYPES[name]) for topic in topics]
        self._speed = {"Int32": lambda s, _: s.data, "SetSpeed": lambda s, _: s.speed}[name]
        self.heard = [[] for _ in topics]  # Of each wheel.

    def listen(self):
        for speeds, reader in zip(self.heard, self._readers, strict=True):
            speeds += take(reader, self._speed)[0]
        return self.heard

    def got(self, message) -> bool:
        """Whether all wheels have heard their part of a command."""
        return all(
            value in speeds for speeds, value in zip(self.listen(), message.command, strict=True)
        )

    def close(self):
        self._node.close()


class Wire:
    """Guard and motors, in the order in which a test wants them, closed at its end."""

    def __init__(self, **config):
        self.config = own_wire(**config)
        self._things = []

    def motors(self, name):
        return self._keep(Motors(self.config, name))

    def link(self, role):
        return self._keep(open_link(self.config, role))

    def _keep(self, thing):
        self._things.append(thing)
        return thing

    def close(self):
        for thing in self._things:
            thing.close()


@pytest.fixture
def wire():
    wire = Wire()
    yield wire
    wire.close()


def drive(guard, motors, message=DRIVING):
    """Sends a command until the motors have it."""
    exchange([guard], lambda: motors.got(message), lambda: guard.send(message))


@pytest.mark.parametrize("name", MOTOR_TYPES)
@pytest.mark.parametrize("robot_first", [True, False])
def test_the_type_is_the_one_that_the_robot_subscribes_to(wire, name, robot_first):
    if robot_first:
        motors = wire.motors(name)
        guard = wire.link(Role.GUARD)
    else:
        guard = wire.link(Role.GUARD)
        assert not guard.wait(0.05) and not guard.robot_present()
        motors = wire.motors(name)
    drive(guard, motors)
    assert guard.robot_present()
    for speed in range(100, 150):  # From now on nothing is lost.
        guard.send(WheelCommand(np.full(4, float(speed))))
        exchange([], lambda s=speed: motors.got(WheelCommand(np.full(4, s))))
    # A second type on the topics would keep `ros2 topic echo` from working.
    onlooker = DdsNode(wire.config)
    users = MotorUsers(onlooker, "/io")
    users.update()
    assert users.subscribed() == users.published() == {name}
    onlooker.close()


def test_two_robots_of_two_types_get_both(wire):
    guard = wire.link(Role.GUARD)
    old, new = wire.motors("Int32"), wire.motors("SetSpeed")
    drive(guard, old)
    drive(guard, new)
    guard.send(ZERO)
    exchange([guard], lambda: old.got(ZERO) and new.got(ZERO))


def test_a_robot_that_comes_again_with_the_other_type(wire):
    guard = wire.link(Role.GUARD)
    old = wire.motors("Int32")
    drive(guard, old)
    old.close()
    exchange([guard], lambda: not guard.robot_present())
    drive(guard, wire.motors("SetSpeed"))


@pytest.mark.parametrize("name", MOTOR_TYPES)
def test_a_type_that_is_configured_is_used_on_both_ends(name):
    wire = Wire(motor_type=name, namespace="/robot_2/io")
    guard, robot, motors = wire.link(Role.GUARD), wire.link(Role.ROBOT), wire.motors(name)
    drive(guard, motors)
    exchange([robot], lambda: robot.count(WheelCommand))
    np.testing.assert_array_equal(robot.latest(WheelCommand).command, DRIVING.command)
    wire.close()


@pytest.mark.parametrize("name", MOTOR_TYPES)
def test_the_guard_hears_what_others_send_and_not_itself(wire, name):
    guard, motors = wire.link(Role.GUARD), wire.motors("Int32")
    drive(guard, motors)
    assert not guard.wait(0.2) and guard.count(WheelCommand) == 0
    node = DdsNode(wire.config)
    writer = node.writer(motor_topics("/io")[3], MOTOR_TYPES[name])

    def tell(speed):
        return lambda: write(writer, MOTOR_TYPES[name](speed))

    exchange([guard], lambda: guard.count(WheelCommand), tell(-5))
    np.testing.assert_array_equal(guard.latest(WheelCommand).command, [0.0, 0.0, 0.0, -5.0])
    tell(0)()
    exchange([guard], lambda: not guard.latest(WheelCommand).command.any())
    node.close()


def test_a_guard_that_listens_is_no_robot(wire):
    """Nor are another guard's commands unheard."""
    one, other, motors = wire.link(Role.GUARD), wire.link(Role.GUARD), wire.motors("Int32")
    exchange([one, other], lambda: one.robot_present() and other.robot_present())
    drive(one, motors, DRIVING)
    drive(other, motors, WheelCommand(np.full(4, 7.0)))
    exchange([one, other], lambda: one.count(WheelCommand) and other.count(WheelCommand))
    motors.close()
    exchange([one, other], lambda: not one.robot_present() and not other.robot_present())
