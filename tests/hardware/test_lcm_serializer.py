import time

import numpy as np
import pytest
from lcm_examples import MESSAGES, check_equal
from pydrake.common.value import AbstractValue
from pydrake.lcm import DrakeLcm
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, TriggerType
from pydrake.systems.lcm import LcmPublisherSystem, LcmSubscriberSystem

from mirte_drake.hardware.lcm_link import LcmLink
from mirte_drake.hardware.lcm_messages import channel
from mirte_drake.hardware.lcm_serializer import MessageSerializer
from mirte_drake.hardware.link import Role
from mirte_drake.hardware.messages import NOTHING, DriveCommand, Odometry
from mirte_drake.hardware.wire_config import LcmWireConfig

CONFIG = LcmWireConfig(url="memq://")
ODOMETRY = channel(CONFIG.prefix, Odometry)


def make_diagram(lcm):
    """Odometry in, drive commands out when published by force, as a controller has it."""
    builder = DiagramBuilder()
    subscriber = LcmSubscriberSystem(ODOMETRY, MessageSerializer(Odometry), lcm, 0.0)
    publisher = LcmPublisherSystem(
        channel(CONFIG.prefix, DriveCommand),
        MessageSerializer(DriveCommand),
        lcm,
        {TriggerType.kForced},
        0.0,
    )
    builder.AddNamedSystem("subscriber", subscriber)
    builder.AddNamedSystem("publisher", publisher)
    builder.ExportOutput(subscriber.get_output_port(), "odometry")
    builder.ExportInput(publisher.get_input_port(), "drive_command")
    return builder.Build()


def odometry_after(simulator, time):
    simulator.AdvanceTo(time)
    simulator.AdvancePendingEvents()
    diagram = simulator.get_system()
    return diagram.GetOutputPort("odometry").Eval(simulator.get_context())


@pytest.fixture
def robot():
    return LcmLink(CONFIG, Role.ROBOT, DrakeLcm("memq://"))


def test_odometry_on_a_port(robot):
    simulator = Simulator(make_diagram(robot.lcm))
    assert odometry_after(simulator, 0.1) == NOTHING
    before = time.monotonic()
    robot.send(MESSAGES[Odometry])
    robot.lcm.HandleSubscriptions(0)
    check_equal(odometry_after(simulator, 0.2), MESSAGES[Odometry], arrived_after=before)


def test_malformed_bytes_leave_the_port_as_it_was(robot):
    simulator = Simulator(make_diagram(robot.lcm))
    robot.send(MESSAGES[Odometry])
    robot.lcm.HandleSubscriptions(0)
    first = odometry_after(simulator, 0.1)
    robot.lcm.Publish(ODOMETRY, b"nonsense")
    robot.lcm.HandleSubscriptions(0)
    check_equal(odometry_after(simulator, 0.2), first)


def test_a_forced_publish_sends_the_message_of_the_port(robot):
    guard = LcmLink(CONFIG, Role.GUARD, robot.lcm)
    diagram = make_diagram(robot.lcm)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    diagram.GetInputPort("drive_command").FixValue(
        context, AbstractValue.Make(MESSAGES[DriveCommand])
    )
    simulator.AdvanceTo(1.0)
    assert not guard.wait(0.0)
    diagram.ForcedPublish(context)
    assert guard.wait(0.0)
    check_equal(guard.latest(DriveCommand), MESSAGES[DriveCommand], arrived_after=0.0)


def test_contexts_are_independent(robot):
    diagram = make_diagram(robot.lcm)
    early, late = Simulator(diagram), Simulator(diagram)
    robot.send(MESSAGES[Odometry])
    robot.lcm.HandleSubscriptions(0)
    first = odometry_after(early, 0.1)
    robot.send(Odometry(1, np.ones(3), np.ones(3)))
    robot.lcm.HandleSubscriptions(0)
    assert odometry_after(late, 0.1).stamp == 1
    ports = diagram.GetOutputPort("odometry")
    check_equal(ports.Eval(early.get_context()), first)


def test_clone_carries_the_same_kind():
    serializer = MessageSerializer(DriveCommand).Clone()
    value = serializer.CreateDefaultValue()
    assert value.get_value() == NOTHING
    data = serializer.Serialize(AbstractValue.Make(MESSAGES[DriveCommand]))
    serializer.Deserialize(data, value)
    check_equal(value.get_value(), MESSAGES[DriveCommand], arrived_after=0.0)
