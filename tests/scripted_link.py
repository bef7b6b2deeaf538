"""A Link whose messages come at given times of a clock that only waiting moves."""

import dataclasses as dc
import heapq
import itertools

from mirte_drake.hardware.link import Link, Role


class ScriptedLink(Link):
    def __init__(self, role=Role.CONTROLLER):
        super().__init__(role)
        self.now = 100.0
        self.sent = []
        self._script = []
        self._order = itertools.count()

    def clock(self):
        return self.now

    def at(self, time, message):
        """Has a message come at a time, stamped with its arrival."""
        if hasattr(message, "arrival"):
            message = dc.replace(message, arrival=time)
        heapq.heappush(self._script, (time, next(self._order), message))

    def wait(self, timeout):
        until = self.now + timeout
        if self._script and self._script[0][0] <= until:
            self.now = max(self.now, self._script[0][0])
            while self._script and self._script[0][0] <= self.now:
                self._deliver(heapq.heappop(self._script)[2])
            return True
        self.now = until
        return False

    def send(self, message):
        self.sent.append((self.now, message))

    def close(self):
        pass
