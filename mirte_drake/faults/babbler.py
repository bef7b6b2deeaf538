"""Somebody on the wire whose messages have no sense."""

from collections.abc import Callable
from typing import Any

import numpy as np

from mirte_drake.hardware.messages import DriveCommand, Odometry, WheelCommand
from mirte_drake.hardware.wire_config import Ros2WireConfig, WireConfig
from mirte_drake.vectors import POSE_SIZE, WHEELS

# A message of each kind, whose bytes are cut off.
EXAMPLES = {
    Odometry: Odometry(0, np.zeros(POSE_SIZE), np.zeros(POSE_SIZE)),
    DriveCommand: DriveCommand(1, 0, np.zeros(len(WHEELS)), np.zeros(POSE_SIZE), 0, False),
    WheelCommand: WheelCommand(np.zeros(len(WHEELS))),
}


class Babbler:
    """Sends bytes without sense where messages of one kind are expected."""

    def __init__(self, wire: WireConfig, kind: type, rng: np.random.Generator) -> None:
        """Joins the wire.

        Args:
            wire: The wire.
            kind: Of the messages whose topic, or channel, is met.
            rng: Draws the bytes.
        """
        join = _join_ros2 if isinstance(wire, Ros2WireConfig) else _join_lcm
        self._say, self.close = join(wire, kind)
        self._rng = rng

    def babble(self) -> None:
        """Sends one message of random bytes, less than half as long as it should be."""
        self._say(lambda length: self._rng.bytes(self._rng.integers(length // 2)))


def _join_lcm(wire: Any, kind: type) -> tuple[Callable, Callable]:  # noqa: ANN401
    from mirte_drake.hardware.lcm_link import open_lcm
    from mirte_drake.hardware.lcm_messages import channel, encode

    lcm = open_lcm(wire.url)
    length = len(encode(EXAMPLES[kind]))

    def say(make: Callable[[int], bytes]) -> None:
        lcm.Publish(channel(wire.prefix, kind), make(length))

    return say, lambda: None


def _join_ros2(wire: Any, kind: type) -> tuple[Callable, Callable]:  # noqa: ANN401
    from mirte_drake.hardware.dds_node import DdsNode, write
    from mirte_drake.hardware.ros2_channels import channels
    from mirte_drake.hardware.ros2_motors import motor_topics
    from mirte_drake.hardware.ros2_types import Int32

    node = DdsNode(wire)
    if kind is WheelCommand:
        topics, sample = motor_topics(wire.namespace), Int32(0)
    else:
        channel = channels(wire.odometry_topic)[kind]
        topics, sample = [channel.topic], channel.to_ros(EXAMPLES[kind])
    writers = [node.writer(topic, type(sample)) for topic in topics]
    header, body = np.split(np.frombuffer(sample.serialize(use_version_2=False), np.uint8), [4])

    def say(make: Callable[[int], bytes]) -> None:
        data = header.tobytes() + make(len(body))
        sample.serialize = lambda **_: data  # type: ignore[method-assign]
        for writer in writers:
            write(writer, sample)

    return say, node.close
