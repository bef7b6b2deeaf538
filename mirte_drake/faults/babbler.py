"""Somebody on the wire whose messages have no sense."""

import socket
import struct
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

import numpy as np

from mirte_drake.hardware.messages import DriveCommand, Odometry, WheelCommand
from mirte_drake.hardware.wire_config import LcmWireConfig, Ros2WireConfig, WireConfig
from mirte_drake.vectors import POSE_SIZE, WHEELS

if TYPE_CHECKING:
    from cyclonedds.idl import IdlStruct

# Of each kind of message one whose bytes are met.
EXAMPLES: dict[type, Odometry | DriveCommand | WheelCommand] = {
    Odometry: Odometry(0, np.zeros(POSE_SIZE), np.zeros(POSE_SIZE)),
    DriveCommand: DriveCommand(1, 0, np.zeros(len(WHEELS)), np.zeros(POSE_SIZE), 0, False),
    WheelCommand: WheelCommand(np.zeros(len(WHEELS))),
}
PARTICIPANTS = 8  # Processes of a trial's domain: at most so many ports are met.
RTPS_HEADER = b"RTPS\x02\x01\x01\x10"  # Version 2.1, vendor Cyclone DDS.
DATA = 0x15  # Submessage that carries a sample; flags 5: little endian, with data.


class Babbler(ABC):
    """Sends bytes without sense where messages of one kind are expected."""

    length: int  # Of a message that has sense, in bytes.

    def babble(self, rng: np.random.Generator) -> None:
        """Sends a message of random bytes, less than half as long as it should be."""
        self.say(rng.bytes(int(rng.integers(self.length // 2))))

    @abstractmethod
    def say(self, data: bytes) -> None:
        """Sends a message of these bytes, whatever they are."""

    @abstractmethod
    def close(self) -> None:
        """Leaves the wire."""


class LcmBabbler(Babbler):
    """On an LCM channel."""

    def __init__(self, wire: LcmWireConfig, kind: type) -> None:
        """Joins the wire, for messages of a kind."""
        from mirte_drake.hardware.lcm_link import open_lcm
        from mirte_drake.hardware.lcm_messages import channel, encode

        self._lcm, self._channel = open_lcm(wire.url), channel(wire.prefix, kind)
        self.length = len(encode(EXAMPLES[kind]))

    def say(self, data: bytes) -> None:
        """Sends a message of these bytes, whatever they are."""
        self._lcm.Publish(self._channel, data)

    def close(self) -> None:
        """Leaves the wire."""
        del self._lcm


class Ros2Babbler(Babbler):
    """On a DDS topic, or the four of the wheels.

    DDS refuses to send a sample that is none of its type. So it only introduces its writers; what
    they say is put on loopback past DDS, as the datagrams that it would send itself.
    """

    def __init__(self, wire: Ros2WireConfig, kind: type) -> None:
        """Joins the wire, for messages of a kind."""
        from mirte_drake.hardware.dds_node import DdsNode
        from mirte_drake.hardware.ros2_channels import channels
        from mirte_drake.hardware.ros2_motors import motor_topics
        from mirte_drake.hardware.ros2_types import Int32

        if kind is WheelCommand:
            topics = motor_topics(wire.namespace)
            sample: IdlStruct = Int32(0)
        else:
            channel = channels(wire.odometry_topic)[kind]
            topics, sample = [channel.topic], channel.to_ros(EXAMPLES[kind])
        encoded = sample.serialize(use_version_2=False)
        self._encapsulation, self.length = encoded[:4], len(encoded) - 4
        self._node = DdsNode(wire)
        self._writers = [self._node.writer(topic, type(sample)) for topic in topics]
        self._ports = [7400 + 250 * wire.domain + 11 + 2 * i for i in range(PARTICIPANTS)]
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._said = 0

    def say(self, data: bytes) -> None:
        """Sends a sample of these bytes, whatever they are."""
        self._said += 1
        for writer in self._writers:
            datagram = rtps_data(writer.guid.bytes, self._said, self._encapsulation + data)
            for port in self._ports:
                self._socket.sendto(datagram, ("127.0.0.1", port))

    def close(self) -> None:
        """Leaves the wire."""
        self._socket.close()
        self._node.close()


def rtps_data(writer: bytes, number: int, payload: bytes) -> bytes:
    """Returns the datagram that carries a sample (DDSI-RTPS 2.2, 9.4.5.3).

    Args:
        writer: GUID of the writer, 16 bytes.
        number: Of the sample, from 1.
        payload: Encapsulation and data.
    """
    # Extra flags, offset of what follows, any reader, the writer, the number's halves.
    fields = struct.pack("<HH4s4siI", 0, 16, bytes(4), writer[12:], 0, number)
    head = struct.pack("<BBH", DATA, 5, len(fields) + len(payload))
    return RTPS_HEADER + writer[:12] + head + fields + payload


def join_wire(wire: WireConfig, kind: type) -> Babbler:
    """Returns a babbler where messages of a kind are expected."""
    if isinstance(wire, Ros2WireConfig):
        return Ros2Babbler(wire, kind)
    return LcmBabbler(wire, kind)
