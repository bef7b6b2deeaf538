import collections
import contextlib
import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lcm_examples import MESSAGES, check_equal, multicast_url
from pydrake.lcm import DrakeLcm

from mirte_drake.errors import UserError
from mirte_drake.hardware.lcm_link import LcmLink, open_lcm
from mirte_drake.hardware.lcm_messages import channel, decode, encode
from mirte_drake.hardware.link import RECEIVES, SENDS, Role
from mirte_drake.hardware.messages import (
    DriveCommand,
    GuardStatus,
    Odometry,
    OperatorRequest,
    PlanView,
    WheelCommand,
)
from mirte_drake.hardware.wire_config import LcmWireConfig, open_link

MEMQ = LcmWireConfig(url="memq://")
PREFIX = LcmWireConfig.prefix


def links(*roles):
    """One end of the same wire for each role, within this process."""
    lcm = DrakeLcm("memq://")
    return [LcmLink(MEMQ, role, lcm) for role in roles]


def test_messages_reach_the_roles_that_receive_them_and_no_other():
    for sender in Role:
        for kind in SENDS[sender]:
            source, *sinks = links(sender, *Role)
            before = time.monotonic()
            source.send(MESSAGES[kind])
            for sink in sinks:
                came = kind in RECEIVES[sink.role]
                assert sink.wait(0.0) == came
                assert sum(map(sink.count, RECEIVES[sink.role])) == came
                if came:
                    check_equal(sink.latest(kind), MESSAGES[kind], arrived_after=before)


def test_messages_are_kept_in_order_until_taken():
    guard, robot = links(Role.GUARD, Role.ROBOT)
    for wheel in range(5):
        guard.send(WheelCommand(np.full(4, float(wheel))))
    assert robot.wait(0.1)
    assert [message.command[0] for message in robot.take(WheelCommand)] == [0, 1, 2, 3, 4]
    assert robot.take(WheelCommand) == []
    assert robot.latest(WheelCommand).command[0] == 4 and robot.count(WheelCommand) == 5


def test_a_guard_hears_wheel_commands_of_others_but_not_its_own():
    guard, second, controller = links(Role.GUARD, Role.GUARD, Role.CONTROLLER)
    guard.send(MESSAGES[WheelCommand])
    assert second.wait(0.0) and second.count(WheelCommand) == 1
    assert not guard.wait(0.01) and guard.count(WheelCommand) == 0
    controller.send(WheelCommand(np.zeros(4)))
    assert guard.wait(0.0) and guard.count(WheelCommand) == 1


def test_what_another_end_waited_for_is_not_waited_for_again():
    controller, guard, robot = links(Role.CONTROLLER, Role.GUARD, Role.ROBOT)
    robot.send(MESSAGES[Odometry])
    assert controller.wait(0.0)
    start = time.monotonic()
    assert guard.wait(5.0)
    assert time.monotonic() - start < 1.0
    assert guard.take(Odometry)
    assert not guard.wait(0.0)


def test_wait_lasts_as_long_as_it_should():
    (guard,) = links(Role.GUARD)
    for timeout in (0.0, 0.0001, 0.05):
        start = time.monotonic()
        assert not guard.wait(timeout)
        assert timeout <= time.monotonic() - start < timeout + 0.5


def test_wait_is_not_ended_by_what_is_of_no_use():
    guard, controller = links(Role.GUARD, Role.CONTROLLER)
    guard.send(MESSAGES[WheelCommand])
    controller.send(MESSAGES[PlanView])
    guard.lcm.Publish(channel(PREFIX, Odometry), b"nonsense")
    start = time.monotonic()
    assert not guard.wait(0.05)
    assert time.monotonic() - start >= 0.05
    assert guard.malformed == 1


def test_prefixes_keep_robots_apart():
    lcm = DrakeLcm("memq://")
    one, other = (
        LcmLink(LcmWireConfig("memq://", prefix), Role.ROBOT, lcm) for prefix in ("A_", "B_")
    )
    LcmLink(LcmWireConfig("memq://", "A_"), Role.GUARD, lcm).send(MESSAGES[WheelCommand])
    assert one.wait(0.0) and not other.wait(0.0)


def test_roles_send_their_own_messages_only():
    (robot,) = links(Role.ROBOT)
    with pytest.raises(ValueError, match="a robot sends no WheelCommand"):
        robot.send(MESSAGES[WheelCommand])


def test_nan_is_not_sent():
    guard, robot = links(Role.GUARD, Role.ROBOT)
    with pytest.raises(ValueError, match="a wheel command must be finite"):
        guard.send(WheelCommand(np.array([0.0, np.nan, 0.0, 0.0])))
    assert not robot.wait(0.0)


def test_nothing_comes_after_close():
    guard, robot = links(Role.GUARD, Role.ROBOT)
    lcm = robot.lcm
    with robot:
        pass
    guard.send(MESSAGES[WheelCommand])
    lcm.HandleSubscriptions(0)
    assert robot.count(WheelCommand) == 0


def own_sockets():
    """Local addresses of this process's sockets, as the operating system writes them."""
    inodes = set()
    for name in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError):
            inodes.add(os.readlink(f"/proc/self/fd/{name}"))
    found = collections.Counter()
    for protocol in ("udp", "udp6", "tcp", "tcp6"):
        for line in Path("/proc/net", protocol).read_text().splitlines()[1:]:
            words = line.split()
            if f"socket:[{words[9]}]" in inodes:
                found[protocol, words[1]] += 1
    return found


def test_what_it_listens_on():
    """Its group and port, and one socket for sending; both are given back."""
    url = multicast_url()
    before = own_sockets()
    link = LcmLink(LcmWireConfig(url=url), Role.GUARD)
    group = f"434CFFEF:{int(url.split(':')[2].split('?')[0]):04X}"  # 239.255.76.67, swapped.
    added = own_sockets() - before
    assert added.pop(("udp", group)) == 1
    ((protocol, sending),) = added.elements()
    assert protocol == "udp" and sending.startswith("00000000:")
    assert set(link.interfaces) <= {name for _, name in socket.if_nameindex()} and link.interfaces
    link.close()
    assert own_sockets() == before


GUARD = links(Role.GUARD)[0]


def mutated(draw):
    data = bytearray(encode(MESSAGES[draw(st.sampled_from(RECEIVES[Role.GUARD]))], sender=1))
    for _ in range(draw(st.integers(0, 4))):
        data[draw(st.integers(0, len(data) - 1))] = draw(st.integers(0, 255))
    start, stop = draw(st.integers(0, 8)), draw(st.integers(0, 8))
    return bytes(data[start : len(data) - stop]) if draw(st.booleans()) else bytes(data)


@settings(max_examples=500)
@given(
    st.sampled_from(RECEIVES[Role.GUARD]),
    st.one_of(st.binary(max_size=300), st.composite(mutated)()),
)
def test_malformed_bytes_are_counted_and_never_raise(kind, data):
    malformed, count = GUARD.malformed, GUARD.count(kind)
    GUARD.lcm.Publish(channel(PREFIX, kind), data)
    came = GUARD.wait(0.0)
    assert GUARD.malformed - malformed == (not came)
    assert GUARD.count(kind) - count == came


@pytest.mark.parametrize(
    "url", ["udpm://127.0.0.1:7667", "udpm://300.1.1.1:7667", "udpm://239.255.76.67:99999?ttl=0"]
)
def test_a_wire_that_nobody_hears(url):
    """DrakeLcm takes each of these URLs, and then reaches only itself."""
    alone, heard = DrakeLcm(url), []
    alone.Subscribe("A", heard.append)
    alone.Publish("A", b"something")
    assert alone.HandleSubscriptions(100) == 1 and alone.get_lcm_url() == url
    with pytest.raises(UserError) as caught:
        LcmLink(LcmWireConfig(url=url), Role.GUARD)
    message = str(caught.value)
    assert message.startswith(f"url: no other process hears '{url}': ") and "\n" not in message
    assert "ip route add" in message


@pytest.mark.parametrize(
    "url", ["file:///tmp/x", "tcpq://127.0.0.1:7700", "udpm://", "udpm://a:1", "memq://x", ""]
)
def test_urls_of_another_kind(url):
    with pytest.raises(
        UserError, match=r"^url: must be udpm://GROUP:PORT\?ttl=TTL or memq://, got "
    ):
        open_lcm(url)


def test_a_network_that_the_environment_forbids(monkeypatch):
    monkeypatch.setenv("DRAKE_ALLOW_NETWORK", "none")
    with pytest.raises(UserError, match=r"^url: cannot be used: .*DRAKE_ALLOW_NETWORK"):
        open_lcm(LcmWireConfig.url)
    assert open_lcm("memq://")


def test_open_link_opens_it():
    with open_link(MEMQ, Role.OPERATOR) as link:
        assert isinstance(link, LcmLink) and link.role is Role.OPERATOR and link.interfaces == ()


# One subscription for each channel, since a subscription keeps one message.
ECHO = """
import sys
from functools import partial
from pydrake.lcm import DrakeLcm
url, *channels = sys.argv[1:]
lcm = DrakeLcm(url)
for channel in channels:
    lcm.Subscribe("A_" + channel, partial(lcm.Publish, "B_" + channel))
print("ready", flush=True)
while True:
    lcm.HandleSubscriptions(1000)
"""


@pytest.fixture
def echo():
    """A URL on which another process sends what comes on A_ channels back on B_ channels."""
    url = multicast_url()
    arguments = [sys.executable, "-c", ECHO, url, *(channel("", kind) for kind in MESSAGES)]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE)
    try:
        assert process.stdout.readline() == b"ready\n"
        yield url
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


@pytest.mark.parametrize(
    ("sender", "kind", "receiver"),
    [
        (Role.ROBOT, Odometry, Role.CONTROLLER),
        (Role.GUARD, WheelCommand, Role.ROBOT),
        (Role.CONTROLLER, WheelCommand, Role.GUARD),
        (Role.CONTROLLER, DriveCommand, Role.GUARD),
        (Role.GUARD, GuardStatus, Role.OPERATOR),
        (Role.OPERATOR, OperatorRequest, Role.GUARD),
    ],
)
def test_messages_cross_between_processes(echo, sender, kind, receiver):
    with (
        LcmLink(LcmWireConfig(echo, "A_"), sender) as there,
        LcmLink(LcmWireConfig(echo, "B_"), receiver) as back,
    ):
        before = time.monotonic()
        there.send(MESSAGES[kind])
        assert back.wait(5.0)
        assert time.monotonic() - before < 2.0  # At once, not at the end of the wait.
        check_equal(back.latest(kind), MESSAGES[kind], arrived_after=before)
        assert back.malformed == 0


def test_the_plan_crosses_between_processes(echo):
    with LcmLink(LcmWireConfig(echo, "A_"), Role.CONTROLLER) as link:
        heard = []
        link.lcm.Subscribe(channel("B_", PlanView), heard.append)
        link.send(MESSAGES[PlanView])
        link.lcm.HandleSubscriptions(5000)
        check_equal(decode(PlanView, heard[0], arrival=0.0), MESSAGES[PlanView])


def test_udpm_keeps_the_first_of_several_messages():
    """A limit of DrakeLcm that the docstring tells."""
    config = LcmWireConfig(url=multicast_url())
    with LcmLink(config, Role.GUARD) as guard, LcmLink(config, Role.ROBOT) as robot:
        for wheel in range(5):
            guard.send(WheelCommand(np.full(4, float(wheel))))
        time.sleep(0.1)
        assert robot.wait(1.0)
        assert [message.command[0] for message in robot.take(WheelCommand)] == [0.0]
