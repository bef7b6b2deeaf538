"""The wire over DDS, on loopback; each group of tests has a domain of its own."""

import dataclasses as dc
import threading
import time

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed")

from ros2_wire import exchange, own_wire

from mirte_drake.hardware import ros2_types as ros
from mirte_drake.hardware.dds_node import DdsNode, take, write
from mirte_drake.hardware.link import SENDS, Role
from mirte_drake.hardware.messages import (
    DriveCommand,
    GuardStatus,
    Odometry,
    OperatorRequest,
    PlanView,
    Request,
    WheelCommand,
)
from mirte_drake.hardware.ros2_channels import VIEWS, channels
from mirte_drake.hardware.wire_config import open_link

ODOMETRY = Odometry(123, np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.3]))
DRIVE = DriveCommand(7, 3, np.arange(4.0), np.arange(3.0), 123, solve_failed=False, done=True)
STATUS = GuardStatus(7, 3, np.arange(4.0), True, "late odometry", 0.5, 2)
STOP = OperatorRequest(Request.STOP)
ZERO = WheelCommand(np.zeros(4))
DRIVING = WheelCommand(np.array([10.0, -20.0, 30.0, -40.0]))
VIEW = PlanView(np.zeros((2, 3)), np.ones((2, 3)), np.array([0.1, 0.2, 0.3]))


@dc.dataclass
class Wire:
    """All four ends of a wire."""

    controller: object
    guard: object
    robot: object
    operator: object
    config: object

    @property
    def links(self):
        return [self.controller, self.guard, self.robot, self.operator]

    def clear(self):
        """Forgets what is on its way."""
        for link in self.links:
            while link.wait(0.02):
                pass
            for kind in link._inboxes:
                link.take(kind)


@pytest.fixture(scope="module")
def shared_wire():
    config = own_wire()
    links = [open_link(config, role) for role in Role]
    exchange(links, lambda: all(link.robot_present() for link in (links[0], links[1], links[3])))
    yield Wire(*links, config)
    for link in links:
        link.close()


@pytest.fixture
def wire(shared_wire):
    shared_wire.clear()
    return shared_wire


@pytest.fixture
def links():
    """Opens links that are closed after the test."""
    opened = []

    def open_one(config, role):
        opened.append(open_link(config, role))
        return opened[-1]

    yield open_one
    for link in opened:
        link.close()


def equal(link, message) -> bool:
    """Whether the last message of its kind that came is this one."""
    latest = link.latest(type(message))
    return latest is not None and all(
        np.array_equal(getattr(latest, f.name), getattr(message, f.name))
        for f in dc.fields(message)
        if f.name != "arrival"
    )


ROUND_TRIPS = [
    ("robot", "controller", ODOMETRY),
    ("robot", "guard", ODOMETRY),
    ("robot", "operator", ODOMETRY),
    ("controller", "guard", DRIVE),
    ("controller", "robot", ZERO),
    ("controller", "guard", ZERO),
    ("guard", "robot", DRIVING),
    ("guard", "controller", STATUS),
    ("guard", "operator", STATUS),
    ("operator", "guard", STOP),
    ("operator", "robot", ZERO),
]


@pytest.mark.parametrize(("sender", "receiver", "message"), ROUND_TRIPS)
def test_every_message_arrives_where_it_should(wire, sender, receiver, message):
    sender, receiver, kind = getattr(wire, sender), getattr(wire, receiver), type(message)
    before, sent = receiver.count(kind), time.monotonic()
    sender.send(message)
    exchange([receiver], lambda: receiver.count(kind) > before and equal(receiver, message))
    received = receiver.take(kind)
    assert receiver.take(kind) == []
    if kind is not OperatorRequest:
        assert sent <= received[-1].arrival <= time.monotonic()


@pytest.mark.parametrize("role", Role)
def test_every_role_sends_all_that_it_may_and_nothing_else(wire, role):
    link = wire.links[list(Role).index(role)]
    for message in (ODOMETRY, ZERO, DRIVE, STATUS, STOP, VIEW):
        if type(message) in SENDS[role]:
            link.send(message)
        else:
            with pytest.raises(ValueError, match=f"is not for the {role.value} to send"):
                link.send(message)


def test_onlookers_see_the_plan_and_the_tube(wire):
    node = DdsNode(wire.config)
    readers = {topic: node.reader(topic, kind) for topic, kind, _ in VIEWS}
    seen = {}

    def look():
        for topic, reader in readers.items():
            for sample in take(reader, lambda sample, _: sample)[0]:
                seen[topic] = sample
        return len(seen) == len(VIEWS)

    exchange([], look, lambda: wire.controller.send(VIEW))
    assert seen["/reference_trajectory"].pose == ros.Pose()
    assert seen["/nominal_trajectory"].pose.position == ros.Point(1.0, 1.0, 0.0)
    assert [len(seen[f"/mirte_drake/{n}_path"].poses) for n in ("reference", "nominal")] == [2, 2]
    assert len(seen["/mirte_drake/tube"].markers[0].points) == 2
    node.close()


def test_wait_ends_as_soon_as_something_comes_and_does_not_poll(wire):
    sender = threading.Timer(0.3, wire.robot.send, [ODOMETRY])
    wall, busy = time.monotonic(), time.process_time()
    sender.start()
    assert wire.controller.wait(5.0)
    wall, busy = time.monotonic() - wall, time.process_time() - busy
    assert 0.3 <= wall < 2.0
    assert busy < 0.1
    sender.join()


def test_wait_ends_after_its_time(wire):
    for timeout in (0.0, 0.2):
        start = time.monotonic()
        assert not wire.controller.wait(timeout)
        assert timeout - 0.01 <= time.monotonic() - start < timeout + 0.5


def test_what_has_come_before_is_there_without_waiting(wire):
    wire.robot.send(ODOMETRY)
    time.sleep(0.2)
    assert wire.controller.wait(0.0)
    assert equal(wire.controller, ODOMETRY)


def test_sending_does_not_wait_for_those_who_do_not_receive(wire):
    """The controller takes nothing meanwhile; then it gets the newest."""
    start = time.monotonic()
    for stamp in range(1000):
        wire.robot.send(dc.replace(ODOMETRY, stamp=stamp))
    assert time.monotonic() - start < 2.0
    exchange([wire.controller], lambda: wire.controller.latest(Odometry).stamp == 999)
    stamps = [message.stamp for message in wire.controller.take(Odometry)]
    assert stamps == sorted(set(stamps))


def test_nobody_listens(links):
    config = own_wire()
    messages = {type(m): m for m in (ODOMETRY, DRIVING, DRIVE, STATUS, STOP, VIEW)}
    for role in Role:
        link = links(config, role)
        for kind in SENDS[role]:
            link.send(messages[kind])
        assert not link.wait(0.0)
        link.close()


def test_odometry_that_is_not_a_number_is_not_malformed(wire):
    broken = Odometry(1, np.full(3, np.nan), np.array([np.inf, -np.inf, 0.0]))
    wire.robot.send(broken)
    exchange([wire.controller], lambda: wire.controller.count(Odometry) > 0)
    exchange([wire.controller], lambda: wire.controller.latest(Odometry).stamp == 1)
    np.testing.assert_array_equal(wire.controller.latest(Odometry).pose, broken.pose)
    assert wire.controller.malformed == 0


def test_malformed_samples_are_counted_and_dropped(wire):
    node = DdsNode(wire.config)
    status = channels("/odom")[GuardStatus]
    writer = node.writer(status.topic, status.kind)
    exchange([wire.controller], writer.get_matched_subscriptions)
    bad = status.to_ros(STATUS)
    good_bytes = bad.serialize(use_version_2=False)
    assert good_bytes.count(b"late") == 1
    bad.serialize = lambda use_version_2: good_bytes.replace(b"late", b"\xff\xfe\xfd\xfc")
    before = wire.controller.malformed
    for _ in range(3):
        write(writer, bad)
    assert not wire.controller.wait(0.3)  # It is not woken by what it cannot deliver.
    assert wire.controller.malformed == before + 3
    write(writer, status.to_ros(STATUS))
    exchange([wire.controller], lambda: equal(wire.controller, STATUS))
    node.close()


def test_a_request_that_does_not_exist_is_malformed(wire):
    node = DdsNode(wire.config)
    writer = node.writer(channels("/odom")[OperatorRequest].topic, ros.OperatorRequest)
    exchange([wire.guard], writer.get_matched_subscriptions)
    before, requests = wire.guard.malformed, wire.guard.count(OperatorRequest)
    write(writer, ros.OperatorRequest(7))
    exchange([wire.guard], lambda: wire.guard.malformed > before)
    assert wire.guard.count(OperatorRequest) == requests
    node.close()


def test_a_flood_of_malformed_samples_does_not_keep_wait_from_ending(wire):
    node = DdsNode(wire.config)
    writer = node.writer(channels("/odom")[OperatorRequest].topic, ros.OperatorRequest)
    exchange([wire.guard], writer.get_matched_subscriptions)
    over = threading.Event()

    def flood():
        while not over.is_set():
            write(writer, ros.OperatorRequest(7))

    flooding = threading.Thread(target=flood)
    flooding.start()
    start = time.monotonic()
    woken = wire.guard.wait(0.3)
    duration = time.monotonic() - start
    over.set()
    flooding.join()
    assert not woken and 0.29 <= duration < 1.5
    assert wire.guard.malformed > 10
    node.close()
