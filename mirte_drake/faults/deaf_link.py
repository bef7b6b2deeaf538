"""The guard's end of a wire, to which the network can be lost."""

from mirte_drake.faults.sabotage import Orders
from mirte_drake.hardware.link import RECEIVES, Link
from mirte_drake.hardware.messages import DriveCommand, Message


class DeafLink(Link):
    """A link that hears no controller any more once that is ordered."""

    def __init__(self, link: Link, orders: Orders) -> None:
        """Wraps the guard's end of the wire."""
        super().__init__(link.role)
        self._link, self._orders = link, orders

    def wait(self, timeout: float) -> bool:
        """Returns as soon as something has come, True, or after ``timeout`` [s], False."""
        came = self._link.wait(timeout)
        for kind in RECEIVES[self.role]:
            messages: list[Message] = self._link.take(kind)
            for message in messages:
                if not (self._orders.deaf and kind is DriveCommand):
                    self._deliver(message)
        return came

    def send(self, message: Message) -> None:
        """Sends a message."""
        self._link.send(message)

    def close(self) -> None:
        """Closes the guard's end of the wire."""
        self._link.close()
