"""One end of the wire: what every middleware offers to controller, guard, robot and operator."""

import enum
from abc import ABC, abstractmethod
from collections import deque
from typing import Any, Self, TypeVar

from mirte_drake.hardware.messages import (
    DriveCommand,
    GuardStatus,
    Message,
    Odometry,
    OperatorRequest,
    PlanView,
    WheelCommand,
)

INBOX = 100  # Messages kept until they are taken; older ones are dropped.

M = TypeVar("M")


class Role(enum.Enum):
    """Who is at this end of the wire."""

    CONTROLLER = "controller"
    GUARD = "guard"
    ROBOT = "robot"
    OPERATOR = "operator"


RECEIVES: dict[Role, tuple[type, ...]] = {
    Role.CONTROLLER: (Odometry, GuardStatus),
    # Of wheel commands, those that others sent: on a sound wire there are none but zeros.
    Role.GUARD: (Odometry, DriveCommand, OperatorRequest, WheelCommand),
    Role.ROBOT: (WheelCommand,),
    Role.OPERATOR: (Odometry, GuardStatus),
}
SENDS: dict[Role, tuple[type, ...]] = {
    # Controller and operator send wheel commands of zero only, where the guard is gone.
    Role.CONTROLLER: (DriveCommand, PlanView, WheelCommand),
    Role.GUARD: (WheelCommand, GuardStatus),
    Role.ROBOT: (Odometry,),
    Role.OPERATOR: (OperatorRequest, WheelCommand),
}


class Link(ABC):
    """One end of the wire: messages come in while ``wait`` runs, and are kept until taken.

    Attributes:
        role: Who is at this end; it decides which messages come and may be sent.
        malformed: Messages dropped so far because they could not be decoded.
        exposure: Who beyond this machine can speak here, in words; empty: nobody.
    """

    def __init__(self, role: Role) -> None:
        """Begins with empty inboxes."""
        self.role = role
        self.malformed = 0
        self.exposure = ""
        self._inboxes: dict[type, deque[Any]] = {
            kind: deque(maxlen=INBOX) for kind in RECEIVES[role]
        }
        self._latest: dict[type, Any] = {}
        self._counts = dict.fromkeys(RECEIVES[role], 0)

    @abstractmethod
    def wait(self, timeout: float) -> bool:
        """Returns as soon as something has come, True, or after ``timeout`` [s], False."""

    @abstractmethod
    def send(self, message: Message) -> None:
        """Sends a message; never blocks and never raises because nobody listens."""

    @abstractmethod
    def close(self) -> None:
        """Gives up the middleware's resources."""

    def take(self, kind: type[M]) -> list[M]:
        """Returns the messages of a kind that came since the last call, oldest first."""
        inbox = self._inboxes[kind]
        messages = list(inbox)
        inbox.clear()
        return messages

    def latest(self, kind: type[M]) -> M | None:
        """Returns the last message of a kind, taken or not; None before the first."""
        return self._latest.get(kind)

    def count(self, kind: type) -> int:
        """Returns how many messages of a kind have come so far."""
        return self._counts[kind]

    def _deliver(self, message: Message) -> None:
        kind = type(message)
        self._inboxes[kind].append(message)
        self._latest[kind] = message
        self._counts[kind] += 1

    def __enter__(self) -> Self:
        """Returns itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Closes it."""
        self.close()
