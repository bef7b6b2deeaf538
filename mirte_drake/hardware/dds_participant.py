"""Joins a DDS domain with settings that are all our own, whatever the environment says."""

import contextlib
import ipaddress
import os
import socket
import sys
import warnings
from weakref import WeakValueDictionary
from xml.sax.saxutils import quoteattr

from cyclonedds.core import DDSException
from cyclonedds.domain import Domain, DomainParticipant

from mirte_drake.errors import UserError
from mirte_drake.hardware.wire_config import Ros2WireConfig

LOOPBACK = "lo"
# Processes of one machine that find each other without multicast: each costs a datagram per
# announcement. In domain d the ports of number i are 7410 + 250 d + 2 i and the next.
MAX_PARTICIPANT_INDEX = 99
LAST_PORT = 65535
# How often a process announces itself. Without multicast a robot on Fast DDS that starts later is
# found by this alone: at the default of Cyclone DDS, not within 10 s.
ANNOUNCE_PERIOD = "500ms"
# How long each writer stays, when it is closed, to repeat what has been lost on the way. The
# default of one second would make four for the wheels of a robot that is gone.
LINGER = "100ms"

_SETTINGS = """
<CycloneDDS><Domain id="any">
  <General>
    <Interfaces><NetworkInterface {interface}/></Interfaces>
    <AllowMulticast>{multicast}</AllowMulticast>
  </General>
  <Discovery>
    <ParticipantIndex>auto</ParticipantIndex>
    <MaxAutoParticipantIndex>{last_index}</MaxAutoParticipantIndex>
    <SPDPInterval>{announce_period}</SPDPInterval>
    <Peers AddLocalhost="true">{peers}</Peers>
  </Discovery>
  <Internal><WriterLingerDuration>{linger}</WriterLingerDuration></Internal>
</Domain></CycloneDDS>
"""


class OpenDomain(Domain):
    """A domain of this process; its links share it and the last one closes it.

    On loopback it hears nothing from elsewhere. Cyclone DDS binds the sockets that receive to all
    addresses, whatever its settings (its issue 2090), so we bind them to the device; datagrams
    from other machines are then refused by the operating system. This takes Linux, and its version
    5.7 for users other than root. On other interfaces sockets remain open to all of the machine's
    addresses, since its own processes come in through loopback: there it takes a firewall.
    """

    def __init__(self, number: int, settings: str, loopback: bool) -> None:
        """Opens the domain's sockets.

        Raises:
            UserError: when DDS refuses the settings; it prints the reason.
        """
        self.settings = settings
        confined = loopback and sys.platform == "linux"
        before = _open_sockets() if confined else set()
        try:
            super().__init__(number, settings)
        except DDSException:
            raise UserError(
                f"domain {number}: DDS cannot use it with these interfaces and peers; see above"
            ) from None
        if confined:
            for descriptor in _open_sockets() - before:
                _bind_to_loopback(descriptor)


_open_domains: WeakValueDictionary[int, OpenDomain] = WeakValueDictionary()


def join_domain(config: Ros2WireConfig) -> tuple[OpenDomain, DomainParticipant]:
    """Returns a new participant, and its domain, which must be kept as long.

    Raises:
        UserError: when an interface or peer is not there, or when this process is in the domain
            with other settings.
    """
    _check_addresses(config)
    settings = domain_settings(config)
    domain = _open_domains.get(config.domain)
    if domain is None:
        domain = OpenDomain(config.domain, settings, _is_loopback(config.interface))
        _open_domains[config.domain] = domain
    elif domain.settings != settings:
        raise UserError(
            f"domain: this process is already in {config.domain} with another interface or other "
            "peers: use the same"
        )
    return domain, DomainParticipant(config.domain)


def domain_settings(config: Ros2WireConfig) -> str:
    """Returns the settings of Cyclone DDS, XML.

    On loopback there is no multicast; on other interfaces it serves to find others, as in ROS 2,
    while data go to each by itself, since wireless networks carry multicast badly.
    """
    loopback = _is_loopback(config.interface)
    kind = "address" if _is_address(config.interface) else "name"
    multicast = 'multicast="false"' if loopback else ""
    return _SETTINGS.format(
        interface=f"{kind}={quoteattr(config.interface)} {multicast}",
        multicast="false" if loopback else "spdp",
        last_index=min(MAX_PARTICIPANT_INDEX, (LAST_PORT - 7411 - 250 * config.domain) // 2),
        announce_period=ANNOUNCE_PERIOD,
        linger=LINGER,
        peers="".join(f"<Peer address={quoteattr(peer)}/>" for peer in config.peers),
    )


def _check_addresses(config: Ros2WireConfig) -> None:
    names = [name for _, name in socket.if_nameindex()]
    if _is_address(config.interface):
        try:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                probe.bind((config.interface, 0))
        except OSError:
            raise UserError(
                f"interface: {config.interface} is no address of this machine: name one of "
                f"{', '.join(names)}, or an IPv4 address of one"
            ) from None
    elif config.interface not in names:
        raise UserError(
            f"interface: there is no {config.interface!r} on this machine: name one of "
            f"{', '.join(names)}, or an IPv4 address of one"
        )
    for peer in config.peers:
        try:
            address = socket.gethostbyname(peer)
        except OSError:
            raise UserError(
                f"peers: {peer!r} cannot be found: give the IPv4 address of the robot"
            ) from None
        if _is_loopback(config.interface) and not _is_loopback(address):
            raise UserError(
                f"peers: {peer} is not to be reached through {config.interface}: name the "
                "interface that leads there"
            )


def _is_address(interface: str) -> bool:
    try:
        ipaddress.ip_address(interface)
    except ValueError:
        return False
    return True


def _is_loopback(interface: str) -> bool:
    if _is_address(interface):
        return ipaddress.ip_address(interface).is_loopback
    return interface == LOOPBACK


def _open_sockets() -> set[int]:
    """File descriptors of this process's sockets."""
    found = set()
    for entry in os.scandir("/proc/self/fd"):
        with contextlib.suppress(FileNotFoundError):  # Closed since, as the scan's own.
            if os.readlink(entry.path).startswith("socket:"):
                found.add(int(entry.name))
    return found


def _bind_to_loopback(descriptor: int) -> None:
    with socket.socket(fileno=os.dup(descriptor)) as same:
        if same.type != socket.SOCK_DGRAM or same.getsockname()[0] != "0.0.0.0":
            return
        try:
            same.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, LOOPBACK.encode())
        except PermissionError:  # Linux before 5.7.
            warnings.warn("DDS can be reached from other machines: use a firewall", stacklevel=2)
