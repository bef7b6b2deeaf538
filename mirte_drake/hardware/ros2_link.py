"""One end of the wire of a robot on ROS 2, over DDS; needs no ROS installation."""

import time
from collections.abc import Callable
from typing import Any

from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader

from mirte_drake.hardware.dds_node import DdsNode, take, write
from mirte_drake.hardware.dds_participant import LOOPBACK
from mirte_drake.hardware.link import RECEIVES, SENDS, Link, Role
from mirte_drake.hardware.messages import Message, PlanView, WheelCommand
from mirte_drake.hardware.ros2_channels import VIEWS, channels
from mirte_drake.hardware.ros2_motors import (
    ONLOOKER_QOS,
    MotorUsers,
    WheelCommandReader,
    WheelCommandWriter,
)
from mirte_drake.hardware.wire_config import Ros2WireConfig

ROBOT_TYPE = "Int32"  # That a robot of ours subscribes to with "auto".


class Ros2Link(Link):
    """One end of the wire over DDS.

    Every topic is reliable, volatile and keeps the last 10 samples, as ROS 2 does by default. A
    wheel command goes out in the type that is configured or, with "auto", in each that somebody
    subscribes to: what is sent in the milliseconds in which DDS makes the acquaintance of a robot
    that has just appeared is lost. Where DDS itself finds out that bytes are no sample, it drops
    them and prints a line; `malformed` counts those that it lets through.
    """

    def __init__(self, config: Ros2WireConfig, role: Role) -> None:
        """Joins the domain.

        Raises:
            UserError: when an interface or peer is not there, or when this process is in the
                domain with other settings.
            ValueError: when ``config`` is out of range.
        """
        config.validate()
        super().__init__(role)
        if config.interface != LOOPBACK:
            self.exposure = f"whoever is on the network of {config.interface} can speak here"
        self._node = DdsNode(config)
        self._users = MotorUsers(self._node, config.namespace)
        self._wheel_writer = WheelCommandWriter(self._node, config.namespace)
        self._wheel_reader = WheelCommandReader(self._node, config.namespace)
        self._motor_type = config.motor_type
        self._channels = channels(config.odometry_topic)
        self._readers: list[tuple[DataReader, Callable[[Any, float], Any]]] = [
            (self._node.reader(channel.topic, channel.kind), channel.from_ros)
            for kind, channel in self._channels.items()
            if kind in RECEIVES[role]
        ]
        self._writers: dict[type, DataWriter] = {
            kind: self._node.writer(channel.topic, channel.kind)
            for kind, channel in self._channels.items()
            if kind in SENDS[role]
        }
        self._view_writers: list[DataWriter] = [
            self._node.writer(topic, kind) for topic, kind, _ in VIEWS if PlanView in SENDS[role]
        ]
        self._follow_motor_users()

    def wait(self, timeout: float) -> bool:
        """Returns as soon as something has come, True, or after ``timeout`` [s], False."""
        until = time.monotonic() + timeout
        while True:
            if self._node.wait(until):
                self._follow_motor_users()
                if self._drain():
                    return True
            # Discovered robots and malformed samples end the node's wait, but not this one.
            if time.monotonic() >= until:
                return False

    def send(self, message: Message) -> None:
        """Sends a message; never blocks and never raises because nobody listens.

        Raises:
            ValueError: when it is not for this role to send, or a wheel command is no number.
        """
        kind = type(message)
        if kind not in SENDS[self.role]:
            raise ValueError(f"a {kind.__name__} is not for the {self.role.value} to send")
        if isinstance(message, WheelCommand):
            self._wheel_writer.write(message)
        elif isinstance(message, PlanView):
            for writer, (_, _, content) in zip(self._view_writers, VIEWS, strict=True):
                if writer.get_matched_subscriptions():  # Each costs some time to make.
                    write(writer, content(message))
        else:
            write(self._writers[kind], self._channels[kind].to_ros(message))

    def robot_present(self) -> bool:
        """Whether somebody subscribes to wheel commands, as far as known by the last ``wait``.

        A robot that is gone without a farewell is missed after 10 s, the lease of DDS.
        """
        return bool(self._users.subscribed())

    def close(self) -> None:
        """Leaves the domain."""
        self._node.close()

    def _follow_motor_users(self) -> None:
        """Opens the motor topics in the types that are of use now."""
        self._users.update()
        fixed = {self._motor_type} - {"auto"}
        if WheelCommand in SENDS[self.role]:
            self._wheel_writer.open(fixed or self._users.subscribed())
        if self.role is Role.ROBOT:
            self._wheel_reader.open(fixed or {ROBOT_TYPE})
        elif WheelCommand in RECEIVES[self.role]:
            # What no robot and no writer has is of no interest, and a second type on a topic
            # would keep `ros2 topic echo` from working.
            types = self._users.subscribed() | self._users.published()
            self._wheel_reader.open(types, ONLOOKER_QOS)

    def _drain(self) -> bool:
        """Delivers what has come; whether there was any."""
        delivered = False
        for reader, from_ros in self._readers:
            delivered |= self._deliver_all(*take(reader, from_ros))
        return delivered | self._deliver_all(*self._wheel_reader.take())

    def _deliver_all(self, messages: list[Any], malformed: int) -> bool:
        self.malformed += malformed
        for message in messages:
            self._deliver(message)
        return bool(messages)
