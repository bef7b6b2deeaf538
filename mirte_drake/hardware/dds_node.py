"""One participant of a DDS domain: its readers, its writers, and one place to wait for samples."""

import time
from collections.abc import Callable
from typing import Any, TypeVar

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopic
from cyclonedds.core import (
    DDSException,
    InstanceState,
    ReadCondition,
    SampleState,
    ViewState,
    WaitSet,
)
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.internal import InvalidSample
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from mirte_drake.hardware.dds_participant import OpenDomain, join_domain
from mirte_drake.hardware.wire_config import Ros2WireConfig

DEPTH = 10  # Samples that a reader or writer keeps; as in ROS 2.
# What ROS 2 does by default, but that a writer never waits for slow readers.
QOS = Qos(
    Policy.Reliability.Reliable(max_blocking_time=0),
    Policy.Durability.Volatile,
    Policy.History.KeepLast(DEPTH),
    Policy.DataRepresentation(use_cdrv0_representation=True),
)
_ANYTHING = ViewState.Any | InstanceState.Any | SampleState.Any

M = TypeVar("M")


class DdsNode:
    """A participant with readers and writers of ROS 2 topics.

    Attributes:
        participant: Of Cyclone DDS.
    """

    def __init__(self, config: Ros2WireConfig) -> None:
        """Joins the domain.

        Raises:
            UserError: see ``join_domain``.
        """
        self._domain: OpenDomain | None
        self._domain, self.participant = join_domain(config)
        self._wait_set = WaitSet(self.participant)

    def writer(self, topic: str, kind: type[IdlStruct]) -> DataWriter:
        """Returns a writer of a ROS 2 topic, as /mirte_base_controller/odom."""
        return DataWriter(self.participant, _topic(self.participant, topic, kind), QOS)

    def reader(self, topic: str, kind: type[IdlStruct], qos: Qos = QOS) -> DataReader:
        """Returns a reader of a ROS 2 topic; ``wait`` ends when something comes for it."""
        reader = DataReader(self.participant, _topic(self.participant, topic, kind), qos)
        self._attach(reader)
        return reader

    def builtin_reader(self, topic: BuiltinTopic) -> BuiltinDataReader:
        """Returns a reader of what DDS itself says, which ends ``wait`` likewise."""
        reader = BuiltinDataReader(self.participant, topic)
        self._attach(reader)
        return reader

    def _attach(self, reader: DataReader) -> None:
        self._wait_set.attach(ReadCondition(reader, _ANYTHING))

    def wait(self, until: float) -> bool:
        """Returns True as soon as a reader has something, False at ``until`` [s, monotonic]."""
        remaining = max(until - time.monotonic(), 0.0)
        return self._wait_set.wait(int(remaining * 1e9)) > 0

    def close(self) -> None:
        """Leaves the domain; the last of this process's nodes in it closes its sockets."""
        # The binding offers no other way to do so now, and not when garbage is collected.
        self.participant.__del__()
        self._domain = None


def take(reader: DataReader, convert: Callable[[Any, float], M]) -> tuple[list[M], int]:
    """Returns what came for a reader, converted, oldest first, and how many were malformed.

    At most as many as a reader keeps: a flood on one topic must not keep the others waiting.

    Args:
        reader: Of the samples.
        convert: Makes a message of a sample and the time of its arrival [s, monotonic], which is
            that of this call.
    """
    messages, malformed, arrival = [], 0, time.monotonic()
    for _ in range(DEPTH):
        try:
            samples = reader.take(1)
            # A sample without data says that its writer is gone.
            messages += [convert(s, arrival) for s in samples if not isinstance(s, InvalidSample)]
        except DDSException:
            raise
        except Exception:  # Bytes that are no sample fail in many ways inside the binding.
            malformed += 1
        else:
            if not samples:
                break
    return messages, malformed


def write(writer: DataWriter, sample: IdlStruct) -> None:
    """Sends a sample, or drops it where readers are so slow that the writer is full."""
    try:
        writer.write(sample)
    except DDSException as error:
        if error.code != DDSException.DDS_RETCODE_TIMEOUT:
            raise


def _topic(participant: DomainParticipant, topic: str, kind: type[IdlStruct]) -> Topic:
    return Topic(participant, f"rt{topic}", kind)  # As ROS 2 names its topics in DDS.
