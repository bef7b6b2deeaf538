"""A wire for a trial that nobody else on this machine is on."""

import socket
from collections.abc import Callable

from mirte_drake.errors import UserError

DOMAINS = range(1, 101)  # Of DDS. Those above have ports that are given to others.
PORTS = range(17_000, 19_000)  # Of LCM.
GROUP = "239.255.76.67"


def free_domain(number: int) -> str:
    """Returns the override of a scenario that names a DDS domain without participants.

    Args:
        number: Of the trial, where the search begins: so those that run at once do not meet.

    Raises:
        UserError: when there is none.
    """
    for domain in _from(DOMAINS, number):
        if is_free(7400 + 250 * domain + 10):
            return f"robot.wire.domain={domain}"
    raise UserError(f"domain: none of {DOMAINS[0]} to {DOMAINS[-1]} is free on this machine")


def free_port(number: int) -> str:
    """Returns the override of a scenario that names an LCM port without listeners.

    Args:
        number: Of the trial, where the search begins.

    Raises:
        UserError: when there is none.
    """
    for port in _from(PORTS, number):
        if is_free(port):
            return f"robot.wire.url='udpm://{GROUP}:{port}?ttl=0'"
    raise UserError(f"port: none of {PORTS[0]} to {PORTS[-1]} is free on this machine")


def is_free(port: int) -> bool:
    """Whether no socket of this machine has a UDP port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", port))
        except OSError:
            return False
    return True


def _from(numbers: range, start: int) -> list[int]:
    """Returns the numbers, beginning somewhere among them."""
    start %= len(numbers)
    return [*numbers[start:], *numbers[:start]]


FREE_WIRES: dict[str, Callable[[int], str]] = {"ros2": free_domain, "lcm": free_port}
