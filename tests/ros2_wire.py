"""Wires of their own for tests: a domain that nobody else uses, and waiting for what must come."""

import itertools
import os
import socket
import time

from mirte_drake.hardware.wire_config import Ros2WireConfig

PATIENCE = 10.0  # [s] For what takes well under a second, on a busy machine.
# Above 101 the ports lie among those that the operating system gives to others.
_numbers = itertools.cycle(range(1, 102))
for _ in range(os.getpid() % 101):  # Other test runs on this machine begin elsewhere.
    next(_numbers)


def free_domain() -> int:
    """A domain whose first participant's port is free, and which no test has had."""
    while True:
        number = next(_numbers)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", 7400 + 250 * number + 10))
            except OSError:
                continue
        return number


def own_wire(**config) -> Ros2WireConfig:
    return Ros2WireConfig(domain=free_domain(), **config)


def exchange(links, condition, send=lambda: None) -> None:
    """Sends, and lets the links receive, again and again until the condition holds."""
    start = time.monotonic()
    while not condition():
        assert time.monotonic() < start + PATIENCE, "what was sent did not come"
        send()
        for link in links:
            link.wait(0.01)
