"""The four wheels' command topics, in either of the types that a robot may want."""

import time
from collections.abc import Iterable
from uuid import UUID

import numpy as np
from cyclonedds.builtin import (
    BuiltinDataReader,
    BuiltinTopicDcpsPublication,
    BuiltinTopicDcpsSubscription,
)
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader

from mirte_drake.hardware.dds_node import QOS, DdsNode, take, write
from mirte_drake.hardware.messages import WheelCommand
from mirte_drake.hardware.ros2_types import Int32, SetSpeed
from mirte_drake.vectors import WHEELS

MOTOR_TYPES: dict[str, type[Int32] | type[SetSpeed]] = {"Int32": Int32, "SetSpeed": SetSpeed}
DDS_NAMES = {kind.__idl_typename__.replace(".", "::"): name for name, kind in MOTOR_TYPES.items()}
# Marks readers that only look on, so that nobody takes them for a robot.
_ONLOOKER = Policy.Userdata(b"mirte_drake onlooker")
# Of one who wants to know what others send.
ONLOOKER_QOS = Qos(Policy.IgnoreLocal.Participant, _ONLOOKER, base=QOS)


def motor_topics(namespace: str) -> list[str]:
    """Returns the topics of the four wheels, in the order of `WHEELS`."""
    return [f"{namespace}/motor/{wheel}/speed" for wheel in WHEELS]


class MotorUsers:
    """Who else writes and reads wheel commands, and in which type."""

    def __init__(self, node: DdsNode, namespace: str) -> None:
        """Begins to listen to what DDS discovers."""
        self._own = node.participant.guid
        self._names = {f"rt{topic}" for topic in motor_topics(namespace)}
        self._subscriptions = node.builtin_reader(BuiltinTopicDcpsSubscription)
        self._publications = node.builtin_reader(BuiltinTopicDcpsPublication)
        self._subscribed: dict[UUID, str] = {}
        self._published: dict[UUID, str] = {}

    def update(self) -> None:
        """Takes in what has been discovered since the last call."""
        self._follow(self._subscriptions, self._subscribed)
        self._follow(self._publications, self._published)

    def subscribed(self) -> set[str]:
        """Returns the types, Int32 or SetSpeed, that others subscribe to; not onlookers."""
        return set(self._subscribed.values())

    def published(self) -> set[str]:
        """Returns the types that others publish."""
        return set(self._published.values())

    def _follow(self, reader: BuiltinDataReader, endpoints: dict[UUID, str]) -> None:
        for endpoint in reader.take(100):  # What is more comes with the next call.
            if not endpoint.sample_info.valid_data:
                endpoints.pop(endpoint.key, None)
            elif (
                endpoint.topic_name in self._names
                and endpoint.type_name in DDS_NAMES
                and endpoint.participant_key != self._own
                and _ONLOOKER not in endpoint.qos
            ):
                endpoints[endpoint.key] = DDS_NAMES[endpoint.type_name]


class WheelCommandWriter:
    """Sends wheel commands in every type that has been asked for."""

    def __init__(self, node: DdsNode, namespace: str) -> None:
        """Begins with no type."""
        self._node, self._topics = node, motor_topics(namespace)
        self._writers: dict[str, list[DataWriter]] = {}

    def open(self, types: Iterable[str]) -> None:
        """Sends in these types as well from now on, Int32 or SetSpeed."""
        for name in set(types) - set(self._writers):
            kind = MOTOR_TYPES[name]
            self._writers[name] = [self._node.writer(topic, kind) for topic in self._topics]

    def write(self, message: WheelCommand) -> None:
        """Sends a command of whole numbers to all wheels."""
        for name, writers in self._writers.items():
            for writer, value in zip(writers, message.command, strict=True):
                write(writer, MOTOR_TYPES[name](int(value)))


class WheelCommandReader:
    """Puts the wheels' topics together to commands of all four."""

    def __init__(self, node: DdsNode, namespace: str) -> None:
        """Begins with no type."""
        self._node, self._topics = node, motor_topics(namespace)
        self._readers: dict[str, list[DataReader]] = {}
        self._command = np.zeros(len(WHEELS))

    def open(self, types: Iterable[str], qos: Qos = QOS) -> None:
        """Receives these types as well from now on, Int32 or SetSpeed."""
        for name in set(types) - set(self._readers):
            kind = MOTOR_TYPES[name]
            self._readers[name] = [self._node.reader(topic, kind, qos) for topic in self._topics]

    def take(self) -> tuple[list[WheelCommand], int]:
        """Returns one command with the newest value of each wheel, and how many were malformed.

        The wheels' topics are independent: a command may come in parts, each of which is delivered
        with the others' values as they were; zero before the first. No command when nothing came.
        """
        something, malformed = False, 0
        for readers in self._readers.values():
            for wheel, reader in enumerate(readers):
                values, bad = take(reader, _value)
                malformed += bad
                if values:
                    something = True
                    self._command[wheel] = values[-1]
        if not something:
            return [], malformed
        return [WheelCommand(self._command.copy(), time.monotonic())], malformed


def _value(sample: Int32 | SetSpeed, _: float) -> int:
    return sample.data if isinstance(sample, Int32) else sample.speed
