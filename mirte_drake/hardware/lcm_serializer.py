"""Messages on the ports of Drake's LCM systems."""

import time

from pydrake.common.value import AbstractValue
from pydrake.systems.lcm import SerializerInterface

from mirte_drake.hardware.lcm_messages import decode, encode
from mirte_drake.hardware.messages import NOTHING


class MessageSerializer(SerializerInterface):
    """Lets an LcmSubscriberSystem and an LcmPublisherSystem carry one kind of message.

    Their ports then have the class of messages.py itself; ``NOTHING`` before the first message.
        Bytes that are no such message leave the port as it was.
    """

    def __init__(self, kind: type) -> None:
        """Serializes one kind of message.

        Args:
            kind: Its class.
        """
        super().__init__()
        self._kind = kind

    def CreateDefaultValue(self) -> AbstractValue:
        """Returns the port's value before the first message."""
        return AbstractValue.Make(NOTHING)

    def Deserialize(self, message_bytes: bytes, abstract_value: AbstractValue) -> None:
        """Sets the port to the message in the bytes, which came just now."""
        try:
            message: object = decode(self._kind, message_bytes, arrival=time.monotonic())
        except ValueError:
            return
        abstract_value.set_value(message)

    def Serialize(self, abstract_value: AbstractValue) -> bytes:
        """Returns the bytes of the port's message; of NOTHING none, which nobody can decode."""
        message = abstract_value.get_value()
        return b"" if message == NOTHING else encode(message)

    def Clone(self) -> SerializerInterface:
        """Returns another serializer of the same kind."""
        return MessageSerializer(self._kind)
