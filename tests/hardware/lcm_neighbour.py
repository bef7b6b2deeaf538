"""Sends wheel commands to a group and to 10.9.0.1 for a while, and counts what it hears itself."""

import json
import socket
import struct
import time

import numpy as np

from mirte_drake.hardware.lcm_messages import channel, encode
from mirte_drake.hardware.messages import WheelCommand

GROUP, PORT, HERE = "239.255.76.67", 7667, "10.9.0.2"
SMALL_MESSAGE = 0x4C433032  # Magic number of LCM's datagrams.


def datagram(number, wheel):
    data = encode(WheelCommand(np.full(4, wheel)))
    name = channel("MIRTE_", WheelCommand).encode()
    return struct.pack(">II", SMALL_MESSAGE, number) + name + b"\0" + data


ear = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
ear.bind((GROUP, PORT))
membership = socket.inet_aton(GROUP) + socket.inet_aton(HERE)
ear.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
ear.settimeout(0.02)
mouth = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
mouth.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(HERE))
mouth.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 0)
heard = 0
end = time.monotonic() + 4.0
for number in range(1000):
    if time.monotonic() > end:
        break
    mouth.sendto(datagram(number, 2.0), (GROUP, PORT))
    mouth.sendto(datagram(number, 3.0), ("10.9.0.1", PORT))
    try:
        ear.recv(2000)
        heard += 1
    except TimeoutError:
        pass
print(json.dumps({"neighbour_heard": heard}))
