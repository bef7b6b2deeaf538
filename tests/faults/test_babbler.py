import os
import struct
import time

import numpy as np
import pytest

from mirte_drake.faults.babbler import EXAMPLES, join_wire, rtps_data
from mirte_drake.hardware.lcm_messages import encode
from mirte_drake.hardware.link import Role
from mirte_drake.hardware.messages import DriveCommand, Odometry, WheelCommand
from mirte_drake.hardware.wire_config import LcmWireConfig, open_link

KINDS = (Odometry, DriveCommand, WheelCommand)


@pytest.mark.parametrize("kind", KINDS)
def test_on_lcm_nonsense_is_counted_and_sense_gets_through(kind):
    port = 16000 + os.getpid() % 1000  # No two processes of tests meet.
    wire = LcmWireConfig(url=f"udpm://239.255.76.67:{port}?ttl=0")
    with open_link(wire, Role.GUARD) as guard:
        babbler = join_wire(wire, kind)
        rng = np.random.default_rng(0)
        for number in range(1, 21):
            babbler.babble(rng)
            assert hears(guard, lambda number=number: guard.malformed == number)
        assert guard.count(kind) == 0
        babbler.say(encode(EXAMPLES[kind], sender=1) if kind is WheelCommand else sense(kind))
        assert hears(guard, lambda: guard.count(kind) == 1)
        babbler.close()


def sense(kind):
    return encode(EXAMPLES[kind])


def hears(link, condition, patience=5.0):
    end = time.monotonic() + patience
    while not condition():
        if time.monotonic() > end:
            return False
        link.wait(0.01)
    return True


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_on_dds_nonsense_is_dropped_and_sense_gets_through(kind):
    """Past DDS, to another process: only what comes from there passes through its sockets."""
    pytest.importorskip("cyclonedds", reason="cyclonedds is not installed")
    import multiprocessing

    from ros2_wire import own_wire

    context = multiprocessing.get_context("spawn")
    wire, counts = own_wire(), context.RawArray("i", [-1, -1])
    child = context.Process(target=listen, args=(wire, kind, counts), daemon=True)
    child.start()
    try:
        assert waits(lambda: counts[0] == 0)
        babbler = join_wire(wire, kind)
        while not all(writer.get_matched_subscriptions() for writer in babbler._writers):
            time.sleep(0.01)
        time.sleep(0.5)
        rng = np.random.default_rng(0)
        for _ in range(20):
            babbler.babble(rng)
            time.sleep(0.01)
        time.sleep(0.2)
        assert counts[0] == 0
        babbler.say(dds_sense(wire, kind))
        assert waits(lambda: counts[0] > 0)
        assert child.is_alive()
        babbler.close()
    finally:
        child.kill()
        child.join()


def listen(wire, kind, counts):
    """What the guard's process counts."""
    with open_link(wire, Role.GUARD) as guard:
        while True:
            counts[0] = guard.count(kind)
            guard.wait(0.02)


def dds_sense(wire, kind):
    from mirte_drake.hardware.ros2_channels import channels
    from mirte_drake.hardware.ros2_types import Int32

    if kind is WheelCommand:
        sample = Int32(0)
    else:
        sample = channels(wire.odometry_topic)[kind].to_ros(EXAMPLES[kind])
    return sample.serialize(use_version_2=False)[4:]


def waits(condition, patience=20.0):
    end = time.monotonic() + patience
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


def test_a_sample_as_a_datagram():
    guid = bytes(range(16))
    datagram = rtps_data(guid, 3, b"\x00\x01\x00\x00abcd")
    assert datagram[:4] == b"RTPS" and datagram[8:20] == guid[:12]
    kind, flags, length = struct.unpack("<BBH", datagram[20:24])
    assert (kind, flags, length) == (0x15, 5, len(datagram) - 24)
    assert datagram[32:36] == guid[12:]
    assert struct.unpack("<iI", datagram[36:44]) == (0, 3)
    assert datagram[44:] == b"\x00\x01\x00\x00abcd"
