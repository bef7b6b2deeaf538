"""The wire with a robot or controller on Fast DDS, ROS 2 Humble's own middleware, in C++."""

import shutil
import subprocess
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed")

from ros2_wire import PATIENCE, exchange, own_wire

from mirte_drake.hardware.link import Role
from mirte_drake.hardware.messages import Odometry, WheelCommand
from mirte_drake.hardware.wire_config import open_link
from mirte_drake.vectors import WHEELS

pytestmark = pytest.mark.slow

SOURCE = Path(__file__).with_name("fastdds_peer")
NEEDED = ("g++", "fastddsgen")
HEADER = Path("/usr/include/fastdds/dds/domain/DomainParticipant.hpp")
THINGS = {"Int32": "int32", "SetSpeed": "set-speed"}  # As the peer calls the types.
DRIVING = WheelCommand(np.array([10.0, -20.0, 30.0, -40.0]))


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """The peer, compiled from its source and from the types that fastddsgen makes of the IDL."""
    missing = [tool for tool in NEEDED if not shutil.which(tool)]
    if missing or not HEADER.exists():
        pytest.skip(
            f"needs {', '.join(missing) or HEADER}: apt install g++ libfastrtps-dev fastddsgen"
        )
    folder = tmp_path_factory.mktemp("fastdds_peer")
    run = {"cwd": folder, "check": True, "capture_output": True, "text": True}
    subprocess.run(["fastddsgen", "-replace", "-d", folder, SOURCE / "messages.idl"], **run)
    sources = [*folder.glob("*.cxx"), SOURCE / "peer.cpp"]
    command = ["g++", "-std=c++17", "-I", folder, *sources, "-o", "peer"]
    subprocess.run([*command, "-lfastrtps", "-lfastcdr"], **run)
    return folder / "peer"


@contextmanager
def peer(program, config, *things):
    """Runs the peer; gives what it prints, as lists of words, which grows."""
    command = [program, str(config.domain), *things]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    lines: list[list[str]] = []
    with subprocess.Popen(command, **pipes) as process:
        reading = threading.Thread(target=lambda: lines.extend(x.split() for x in process.stdout))
        reading.start()
        try:
            yield lines
        finally:
            process.stdin.close()  # Which ends it.
            reading.join(PATIENCE)
            process.kill()


def speeds(lines, name) -> list:
    """The newest speed of each wheel that the peer has heard in this type."""
    heard = {words[1]: int(words[2]) for words in lines if words[0] == name}
    return [heard.get(wheel) for wheel in WHEELS]


@pytest.mark.parametrize("name", THINGS)
def test_a_robot_on_fast_dds(program, name):
    config = own_wire()
    with (
        open_link(config, Role.CONTROLLER) as controller,
        open_link(config, Role.GUARD) as guard,
        peer(program, config, "odometry-out", f"{THINGS[name]}-in") as lines,
    ):
        links = [controller, guard]
        exchange(
            links,
            lambda: speeds(lines, name) == DRIVING.command.tolist(),
            lambda: guard.send(DRIVING),
        )
        exchange(links, lambda: controller.count(Odometry) > 3)
        first, *_, last = controller.take(Odometry)
        count = round(last.pose[0] / 0.25)
        assert last.stamp == 1_000_000_000_000 + count * 100_000_000
        np.testing.assert_allclose(last.pose[1:], [-2.0, 2 * np.arctan2(0.6, 0.8)], rtol=1e-15)
        np.testing.assert_array_equal(last.body_velocity, [0.5, -0.25, 1.5])
        assert (
            last.stamp - first.stamp == round((last.pose[0] - first.pose[0]) / 0.25) * 100_000_000
        )
        assert links[0].malformed == links[1].malformed == 0


@pytest.mark.parametrize("name", THINGS)
def test_a_controller_on_fast_dds(program, name):
    config = own_wire(motor_type=name)
    odometry = Odometry(
        1_756_120_957_123_456_789, np.array([1.1, -2.2, 3.0]), np.array([0.1, 0.2, 0.3])
    )
    with (
        open_link(config, Role.ROBOT) as robot,
        open_link(config, Role.GUARD) as guard,
        peer(program, config, "odometry-in", f"{THINGS[name]}-out") as lines,
    ):
        heard = lambda: any(words[0] == "Odometry" for words in lines)  # noqa: E731
        exchange([robot], heard, lambda: robot.send(odometry))
        _, sec, nanosec, frame, child_frame, *numbers = lines[-1]
        assert (sec, nanosec) == ("1756120957", "123456789")
        assert (frame, child_frame) == ("odom", "base_link")
        expected = [1.1, -2.2, np.sin(1.5), np.cos(1.5), 0.1, 0.2, 0.3]
        assert [float(number) for number in numbers] == expected

        for link in (robot, guard):  # To whom the controller is a stranger.
            commands = [[10.0, 20.0, 30.0, 40.0], [-10.0, -20.0, -30.0, -40.0]]
            seen = []

            def both_seen(link=link, seen=seen, commands=commands):
                seen.extend(c.command.tolist() for c in link.take(WheelCommand))
                return all(command in seen for command in commands)

            exchange([link], both_seen)


def test_a_robot_on_fast_dds_that_comes_late_and_again(program):
    """Without multicast it is found by our own announcements, twice a second."""
    config = own_wire()
    with open_link(config, Role.GUARD) as guard:
        for name in ("Int32", "SetSpeed"):
            assert not guard.wait(0.7)
            with peer(program, config, f"{THINGS[name]}-in") as lines:
                start = time.monotonic()
                exchange(
                    [guard],
                    lambda n=name, x=lines: speeds(x, n) == DRIVING.command.tolist(),
                    lambda: guard.send(DRIVING),
                )
                assert time.monotonic() - start < 5.0


def test_bytes_that_are_no_odometry(program, capfd):
    """DDS drops them, says so, and nothing else happens."""
    config = own_wire()
    with (
        open_link(config, Role.CONTROLLER) as controller,
        open_link(config, Role.ROBOT) as robot,
        peer(program, config, "nonsense-out"),
    ):
        reported = []

        def is_reported():
            reported.append(capfd.readouterr().err)
            return "nav_msgs::msg::dds_::Odometry_ failed" in "".join(reported)

        exchange([controller], is_reported)
        assert controller.count(Odometry) == 0
        robot.send(Odometry(1, np.zeros(3), np.zeros(3)))
        exchange([controller], lambda: controller.count(Odometry) == 1)
