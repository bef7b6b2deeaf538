"""A wire in memory, on which a test lets time pass and sees all that was sent."""

import dataclasses as dc
import math

from mirte_drake.hardware.link import RECEIVES, SENDS, Link, Role


class MemoryWire:
    """Time [s], what happens at which time, and all that was sent: (time, role, message)."""

    def __init__(self):
        self.now = 100.0
        self.links = []
        self.sent = []
        self.plan = []  # (time, what to call)

    def clock(self):
        return self.now

    def at(self, time, happens):
        """Lets something happen at a time, in order."""
        self.plan.append((time, happens))
        self.plan.sort(key=lambda entry: entry[0])

    def send(self, role, message):
        """Sends a message as somebody with a role, who need not have a link."""
        self.sent.append((self.now, role, message))
        for link in self.links:
            if link.role is not role and type(message) in RECEIVES[link.role]:
                link.pending.append(message)

    def sent_by(self, role, kind):
        """Messages of a kind that a role has sent, with their times."""
        return [(t, m) for t, r, m in self.sent if r is role and isinstance(m, kind)]


class MemoryLink(Link):
    """One end of it. While it waits, time passes."""

    def __init__(self, wire, role):
        super().__init__(role)
        self.wire, self.pending = wire, []
        wire.links.append(self)

    def wait(self, timeout):
        until = self.wire.now + timeout
        while not self.pending:
            due = self.wire.plan[0][0] if self.wire.plan else math.inf
            if due > until:
                self.wire.now = until
                return False
            self.wire.now = max(self.wire.now, due)
            self.wire.plan.pop(0)[1]()
        for message in self.pending:
            if "arrival" in {field.name for field in dc.fields(message)}:
                message = dc.replace(message, arrival=self.wire.now)
            self._deliver(message)
        self.pending.clear()
        return True

    def send(self, message):
        assert type(message) in SENDS[self.role]
        self.wire.send(self.role, message)

    def close(self):
        self.wire.links.remove(self)


__all__ = ["MemoryLink", "MemoryWire", "Role"]
