import json
import struct
import sys
import time
from pathlib import Path

import pytest
from lcm_examples import MESSAGES

from mirte_drake.errors import UserError
from mirte_drake.hardware.foxglove_live import HOST, PORT, FoxgloveLive
from mirte_drake.hardware.messages import Odometry, PlanView
from mirte_drake.hardware.ros2_messages import TUBE_TOPIC, Ros2Messages

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed")
pytest.importorskip("rosbags", reason="rosbags is not installed")
client = pytest.importorskip("websockets.sync.client", reason="websockets is not installed")

PROTOCOL = "foxglove.sdk.v1"
MESSAGE_DATA = 1


@pytest.fixture(scope="module")
def messages():
    return Ros2Messages()


@pytest.fixture
def live(messages):
    with FoxgloveLive(messages, port=0) as server:
        yield server


def connect(server):
    return client.connect(f"ws://127.0.0.1:{server.port}", subprotocols=[PROTOCOL])


def receive_json(socket, operation):
    while (answer := json.loads(socket.recv(timeout=5)))["op"] != operation:
        pass
    return answer


def advertised(socket, topics):
    found = {}
    while len(found) < topics:
        answer = receive_json(socket, "advertise")
        found |= {channel["topic"]: channel for channel in answer["channels"]}
    return found


def test_channels_are_advertised(live, messages):
    with connect(live) as socket:
        channels = advertised(socket, len(messages.topics))
    assert {topic: channel["schemaName"] for topic, channel in channels.items()} == messages.topics
    for topic, channel in channels.items():
        assert channel["encoding"] == "cdr" and channel["schemaEncoding"] == "ros2msg"
        assert channel["schema"] == messages.definition(messages.topics[topic])


def test_data_arrive(live, messages):
    with connect(live) as socket:
        channels = advertised(socket, len(messages.topics))
        subscription = {"id": 7, "channelId": channels[TUBE_TOPIC]["id"]}
        socket.send(json.dumps({"op": "subscribe", "subscriptions": [subscription]}))
        encoded = messages.encode(MESSAGES[PlanView], 12_345)
        data = None
        end = time.monotonic() + 5.0
        while data is None and time.monotonic() < end:  # Until the subscription has come through.
            live.write(messages.encode(MESSAGES[Odometry], 1))
            live.write(encoded)
            try:
                data = socket.recv(timeout=0.1)
            except TimeoutError:
                pass
    assert struct.unpack("<BIQ", data[:13]) == (MESSAGE_DATA, 7, 12_345)
    assert data[13:] == next(item.data for item in encoded if item.topic == TUBE_TOPIC)


def test_nobody_looks_on(live, messages):
    for message in MESSAGES.values():
        live.write(messages.encode(message, 1))


def test_it_listens_on_loopback_only(live):
    listening = [line.split()[1] for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    assert [address for address in listening if address.endswith(f":{live.port:04X}")] == [
        f"0100007F:{live.port:04X}"
    ]
    assert (HOST, PORT) == ("127.0.0.1", 8765)


def test_two_servers_do_not_share_channels(live, messages):
    with FoxgloveLive(Ros2Messages(odometry_topic="/other"), port=0) as other, connect(other) as ws:
        assert "/other" in advertised(ws, len(messages.topics))
    with connect(live) as socket:
        assert "/other" not in advertised(socket, len(messages.topics))


def test_a_port_that_is_taken(live, messages):
    with pytest.raises(UserError, match=f"^127.0.0.1:{live.port}: nothing can listen there: "):
        FoxgloveLive(messages, port=live.port)


def test_close_frees_the_port(messages):
    with FoxgloveLive(messages, port=0) as server:
        pass
    server.close()
    for patience in (0.05, 0.2, 1.0, 5.0):  # Its threads may take a moment to end.
        try:
            FoxgloveLive(messages, port=server.port).close()
            return
        except UserError:
            time.sleep(patience)
    FoxgloveLive(messages, port=server.port).close()


def test_foxglove_is_not_installed(messages, monkeypatch):
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(UserError, match=r"foxglove-sdk: pip install mirte-drake\[foxglove\]"):
        FoxgloveLive(messages)
