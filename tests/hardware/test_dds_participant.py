"""Which addresses the wire uses, as the operating system sees it, and what it refuses."""

import os
import socket
import sys
from pathlib import Path

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed")

from ros2_wire import own_wire

from mirte_drake.errors import UserError
from mirte_drake.hardware.dds_participant import domain_settings, join_domain
from mirte_drake.hardware.link import Role
from mirte_drake.hardware.wire_config import MAX_DOMAIN, Ros2WireConfig, open_link


def open_sockets() -> dict[str, int]:
    """The sockets of this process: inode and descriptor."""
    found = {}
    for entry in Path("/proc/self/fd").iterdir():
        try:
            target = os.readlink(entry)
        except FileNotFoundError:  # The listing's own.
            continue
        if target.startswith("socket:["):
            found[target[len("socket:[") : -1]] = int(entry.name)
    return found


def local_addresses() -> dict[str, str]:
    """The address of every Internet socket on this machine, by inode."""
    found = {}
    for protocol in ("udp", "udp6", "tcp", "tcp6", "raw", "raw6"):
        for line in Path(f"/proc/self/net/{protocol}").read_text().splitlines()[1:]:
            columns = line.split()
            number = bytes.fromhex(columns[1].split(":")[0])
            family = socket.AF_INET6 if protocol.endswith("6") else socket.AF_INET
            found[columns[9]] = socket.inet_ntop(
                family, number[::-1] if len(number) == 4 else number
            )
    return found


def device(descriptor: int) -> str:
    """The device that a socket is bound to; empty when it hears all."""
    with socket.socket(fileno=os.dup(descriptor)) as same:
        return same.getsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, 16).rstrip(b"\0").decode()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads Linux's socket list")
@pytest.mark.parametrize("interface", ["lo", "127.0.0.1"])
def test_nothing_but_loopback_is_heard_by_default(interface):
    before = open_sockets()
    with open_link(own_wire(interface=interface), Role.GUARD):
        sockets = {inode: fd for inode, fd in open_sockets().items() if inode not in before}
        addresses = local_addresses()
        internet = {inode: fd for inode, fd in sockets.items() if inode in addresses}
        assert len(internet) >= 3  # Discovery, data, and one to send.
        for inode, descriptor in internet.items():
            loopback = addresses[inode] == "127.0.0.1"
            assert loopback or (addresses[inode], device(descriptor)) == ("0.0.0.0", "lo")
        # One could hear it from elsewhere, had it not been bound to the device.
        assert "0.0.0.0" in addresses.values()
    assert not open_sockets().keys() - before.keys()


def test_the_last_link_of_a_process_closes_the_domain():
    config = own_wire()
    with open_link(config, Role.GUARD) as guard:
        with open_link(config, Role.ROBOT) as robot:
            assert not robot.wait(0.0)
        assert not guard.wait(0.0)
        with pytest.raises(UserError, match=f"already in {config.domain} with another interface"):
            join_domain(Ros2WireConfig(domain=config.domain, interface="127.0.0.1"))
    open_link(Ros2WireConfig(domain=config.domain, interface="127.0.0.1"), Role.ROBOT).close()


def test_a_link_may_be_closed_twice():
    with open_link(own_wire(), Role.GUARD) as link:
        link.close()


def test_the_environment_changes_nothing(monkeypatch):
    monkeypatch.setenv("CYCLONEDDS_URI", "<no XML")
    monkeypatch.setenv("ROS_DOMAIN_ID", "300")
    config = own_wire()
    with open_link(config, Role.GUARD) as link:
        assert link._node.participant.domain_id == config.domain


def test_multicast_only_where_the_interface_is_named():
    assert "<AllowMulticast>false<" in domain_settings(Ros2WireConfig())
    assert 'multicast="false"' in domain_settings(Ros2WireConfig(interface="127.0.0.1"))
    settings = domain_settings(Ros2WireConfig(interface="wlan0", peers=["192.168.1.5"]))
    assert 'name="wlan0"' in settings and 'address="192.168.1.5"' in settings
    assert "<AllowMulticast>spdp<" in settings and 'multicast="false"' not in settings


def test_ports_of_the_last_domain_are_ports(capfd):
    with open_link(Ros2WireConfig(domain=MAX_DOMAIN), Role.GUARD) as link:
        assert not link.wait(0.1)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("interface", "wlan77", "interface: there is no 'wlan77' on this machine: name one of lo"),
        ("interface", "203.0.113.1", "interface: 203.0.113.1 is no address of this machine"),
        ("peers", ["nowhere.invalid"], "peers: 'nowhere.invalid' cannot be found"),
        ("peers", ["203.0.113.1"], "peers: 203.0.113.1 is not to be reached through lo"),
    ],
)
def test_addresses_that_are_of_no_use(field, value, message, capfd):
    with pytest.raises(UserError) as caught:
        open_link(own_wire(**{field: value}), Role.GUARD)
    assert str(caught.value).startswith(message) and "\n" not in str(caught.value)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("domain", -1),
        ("domain", 233),
        ("motor_type", "Int16"),
        ("namespace", "io"),
        ("interface", ""),
    ],
)
def test_values_out_of_range(field, value):
    with pytest.raises(ValueError, match=field):
        open_link(Ros2WireConfig(**{field: value}), Role.GUARD)


def test_cyclonedds_is_not_installed(monkeypatch):
    monkeypatch.setitem(sys.modules, "cyclonedds", None)
    with pytest.raises(UserError) as caught:
        open_link(Ros2WireConfig(), Role.GUARD)
    assert str(caught.value) == "needs the package cyclonedds: pip install mirte-drake[ros2]"
