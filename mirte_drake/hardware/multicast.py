"""Which network interfaces let a multicast group in, as the operating system says."""

import socket
import sys
from pathlib import Path

MEMBERSHIPS = Path("/proc/net/igmp")  # Of Linux; all processes' together.


def listening_interfaces(group: str, memberships: str | None = None) -> tuple[str, ...]:
    """Returns the names of the interfaces on which somebody on this machine joined a group.

    Args:
        group: IPv4 address of the group.
        memberships: Text of ``MEMBERSHIPS``; None: as it is now, empty where there is none.
    """
    if memberships is None:
        memberships = MEMBERSHIPS.read_text() if MEMBERSHIPS.exists() else ""
    # The kernel prints the address as the number that its four bytes are to this machine.
    wanted = f"{int.from_bytes(socket.inet_aton(group), sys.byteorder):08X}"
    interface, found = "", []
    for line in memberships.splitlines()[1:]:
        words = line.split()
        if not line.startswith("\t"):
            interface = words[1]
        elif words[0] == wanted:
            found.append(interface)
    return tuple(found)
