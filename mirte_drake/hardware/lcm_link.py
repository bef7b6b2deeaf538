"""One end of the wire over LCM, on pydrake's DrakeLcm."""

import math
import re
import secrets
import time
from functools import partial

from pydrake.lcm import DrakeLcm

from mirte_drake.errors import UserError
from mirte_drake.hardware.lcm_messages import channel, decode, encode, sender_of
from mirte_drake.hardware.link import RECEIVES, SENDS, Link, Role
from mirte_drake.hardware.messages import Message, WheelCommand
from mirte_drake.hardware.multicast import listening_interfaces
from mirte_drake.hardware.wire_config import LcmWireConfig

MULTICAST_URL = re.compile(r"udpm://([\d.]+):\d+(\?.*)?")
MEMORY_URL = "memq://"  # Within one DrakeLcm.
SELF_TEST_CHANNEL = "MIRTE_SELF_TEST"
SELF_TESTS = 5  # A datagram may be lost, or another process may test itself just then.
SELF_TEST_PATIENCE = 0.1  # [s] for each.


def open_lcm(url: str) -> DrakeLcm:
    """Returns a DrakeLcm that is heard by others on the same URL.

    Where a URL is of no use or no multicast route is there, DrakeLcm says so on stderr, keeps the
    URL, and from then on reaches only itself; so a second instance must hear the first.

    Args:
        url: udpm://GROUP:PORT?ttl=TTL, or memq:// that stays in one object and is not tested.

    Raises:
        UserError: when nobody hears it.
    """
    if url != MEMORY_URL and not MULTICAST_URL.fullmatch(url):
        raise UserError(f"url: must be udpm://GROUP:PORT?ttl=TTL or memq://, got {url!r}")
    try:
        lcm = DrakeLcm(url)
        if url == MEMORY_URL or _is_heard(lcm, DrakeLcm(url)):
            return lcm
    except RuntimeError as error:  # Where the environment forbids it.
        raise UserError(f"url: cannot be used: {' '.join(str(error).split())}") from None
    raise UserError(
        f"url: no other process hears {url!r}: it needs a multicast address, a free port and a "
        "multicast route; `ip route add 224.0.0.0/4 dev lo` makes one on this machine"
    )


def _is_heard(lcm: DrakeLcm, other: DrakeLcm) -> bool:
    heard: list[bytes] = []
    token = secrets.token_bytes(16)
    other.Subscribe(SELF_TEST_CHANNEL, heard.append)
    for _ in range(SELF_TESTS):
        lcm.Publish(SELF_TEST_CHANNEL, token)
        other.HandleSubscriptions(_milliseconds(SELF_TEST_PATIENCE))
        if token in heard:
            return True
    return False


class LcmLink(Link):
    """One end of the wire over LCM.

    Several links, and Drake systems, may share one DrakeLcm: what one of them waits for, all get.
    So with memq:// controller, guard and robot run in one process.

    What LCM does, each point measured with drake 1.51.1 and 1.58 on Linux:

    - ``ttl=0`` in the URL keeps what is sent on this machine.
    - **It lets messages in from the network.** The receiving socket is bound to the group's
      address and port, and joins the group on the interface of the multicast route, which is the
      network card where no route says otherwise: a machine beside this one that sends to the group
      is heard, wheel commands included. Datagrams to this machine's own address are not. Nothing
      in the URL changes that; ``ip route add 224.0.0.0/4 dev lo`` before the start does, for every
      LCM process on the machine: then only this machine is heard. ``interfaces`` tells. With
      DrakeLcm there is also a sending socket, on a port of its own on all addresses, which is
      never read.
    - Over udpm, of several messages on one channel that come between two calls of ``wait`` **only
      the first is kept**, so wait often, and repeat what must arrive; memq:// keeps all.
    - While ``wait`` waits, no other thread of Python runs; a signal ends it as usual.

    Attributes:
        lcm: The DrakeLcm, for Drake systems on the same wire.
        interfaces: Network interfaces that let messages in, by name; empty for memq://.
    """

    def __init__(self, config: LcmWireConfig, role: Role, lcm: DrakeLcm | None = None) -> None:
        """Opens the wire.

        Args:
            config: The config.
            role: Who is at this end.
            lcm: The DrakeLcm to share; None: a new one for the config's URL, tested at once.

        Raises:
            UserError: when the URL cannot be used.
            ValueError: when ``config`` is out of range.
        """
        super().__init__(role)
        config.validate()
        self.lcm = open_lcm(config.url) if lcm is None else lcm
        group = MULTICAST_URL.fullmatch(self.lcm.get_lcm_url())
        self.interfaces = listening_interfaces(group[1]) if group else ()
        if beyond := [name for name in self.interfaces if name != "lo"]:
            self.exposure = (
                f"LCM lets in whoever is on the network of {', '.join(beyond)}; "
                "`ip route add 224.0.0.0/4 dev lo` keeps it to this machine"
            )
        self._prefix = config.prefix
        self._sender = secrets.randbits(63)
        self._open = True
        self._told = 0  # Messages that `wait` has reported.
        for kind in RECEIVES[role]:
            self.lcm.Subscribe(channel(config.prefix, kind), partial(self._receive, kind))

    def wait(self, timeout: float) -> bool:
        """Returns as soon as something has come, True, or after ``timeout`` [s], False.

        It waits in whole milliseconds, rounded up.
        """
        deadline = time.monotonic() + timeout
        self.lcm.HandleSubscriptions(0)
        while (came := sum(self._counts.values())) == self._told:
            left = deadline - time.monotonic()
            if left <= 0:
                return False
            self.lcm.HandleSubscriptions(_milliseconds(left))
        self._told = came
        return True

    def send(self, message: Message) -> None:
        """Sends a message; never blocks and never raises because nobody listens.

        Raises:
            ValueError: when a wheel command is not finite or the role does not send such messages.
        """
        kind = type(message)
        if kind not in SENDS[self.role]:
            raise ValueError(f"a {self.role.value} sends no {kind.__name__}")
        self.lcm.Publish(channel(self._prefix, kind), encode(message, sender=self._sender))

    def close(self) -> None:
        """Gives up the DrakeLcm, which ends when nobody else shares it."""
        self._open = False
        del self.lcm

    def _receive(self, kind: type, data: bytes) -> None:
        if not self._open:
            return
        try:
            # Its own wheel commands come back; a guard must tell them from those of others.
            if kind is WheelCommand and sender_of(data) == self._sender:
                return
            self._deliver(decode(kind, data, arrival=time.monotonic()))
        except ValueError:
            self.malformed += 1


def _milliseconds(seconds: float) -> int:
    return math.ceil(1e3 * seconds)
