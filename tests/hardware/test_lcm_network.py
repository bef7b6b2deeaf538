"""What LcmLink's docstring says of the network, on a network of two machines made for it.

The machines are network namespaces with a cable between them: this takes root and iproute2.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True, scope="module")
def _namespaces():
    """Skips where this process may not make networks of its own."""
    cable = ["ip", "link", "add", "cable", "type", "veth", "peer", "name", "end"]
    if not shutil.which("unshare") or not shutil.which("ip"):
        pytest.skip("needs unshare and ip, of util-linux and iproute2")
    if subprocess.run(["unshare", "--net", *cable], capture_output=True).returncode:
        pytest.skip("needs root, to make network namespaces")


# Starts the neighbour in a network of its own, ties a cable, and drives a link on this side.
SETUP = """
set -e
ip link set lo up
unshare --net sleep 30 & neighbour=$!
trap 'kill $neighbour' EXIT
sleep 0.3
ip link add cable type veth peer name end
ip link set end netns $neighbour
ip address add 10.9.0.1/24 dev cable
ip link set cable up
nsenter --net --target $neighbour ip address add 10.9.0.2/24 dev end
nsenter --net --target $neighbour ip link set end up
ip route add default via 10.9.0.2
$ROUTE
nsenter --net --target $neighbour "$PYTHON" "$HERE/lcm_neighbour.py" & speaker=$!
"$PYTHON" - <<'END'
import json, time
import numpy as np
from mirte_drake.hardware.lcm_link import LcmLink
from mirte_drake.hardware.link import Role
from mirte_drake.hardware.messages import WheelCommand
from mirte_drake.hardware.wire_config import LcmWireConfig
guard, robot = (LcmLink(LcmWireConfig(), role) for role in (Role.GUARD, Role.ROBOT))
heard = set()
end = time.monotonic() + 2.0
while time.monotonic() < end:
    guard.send(WheelCommand(np.ones(4)))
    for _ in range(10):
        robot.wait(0.005)
        heard |= {float(message.command[0]) for message in robot.take(WheelCommand)}
print(json.dumps({"interfaces": robot.interfaces, "heard": sorted(heard)}))
END
wait $speaker
"""


def drive(route):
    """Returns what the robot's end heard, and what the neighbour heard."""
    done = subprocess.run(
        ["unshare", "--net", "bash", "-c", SETUP.replace("$ROUTE", route)],
        env=os.environ | {"PYTHON": sys.executable, "HERE": str(HERE), "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    answers = [json.loads(line) for line in done.stdout.splitlines()]
    return {name: value for answer in answers for name, value in answer.items()}


def test_without_a_route_the_network_is_let_in_and_nothing_goes_out():
    seen = drive("")
    assert seen["interfaces"] == ["cable"]
    assert seen["heard"] == [1.0, 2.0]  # 2: what the neighbour sent to the group.
    assert seen["neighbour_heard"] == 0


def test_with_a_route_over_loopback_only_this_machine_is_heard():
    seen = drive("ip route add 224.0.0.0/4 dev lo")
    assert seen["interfaces"] == ["lo"]
    assert seen["heard"] == [1.0]
    assert seen["neighbour_heard"] == 0
