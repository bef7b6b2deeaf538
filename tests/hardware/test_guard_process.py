import dataclasses as dc
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from lcm_examples import multicast_url
from pydrake.common.yaml import yaml_dump_typed
from ros2_wire import own_wire

from mirte_drake.errors import UserError
from mirte_drake.hardware.governor_config import GovernorConfig
from mirte_drake.hardware.guard_process import LINGER, GuardSetup, start_guard
from mirte_drake.hardware.link import Role
from mirte_drake.hardware.messages import DriveCommand, GuardStatus, Odometry, WheelCommand
from mirte_drake.hardware.wire_config import LcmWireConfig, Ros2WireConfig, open_link
from mirte_drake.typed_yaml import parse_typed

pytestmark = [
    pytest.mark.realtime,
    pytest.mark.xdist_group("wire"),
]  # In real time: one after the other.

PATIENCE = 10.0  # [s] For what takes well under a second, on a busy machine.
BUSY = 0.1  # [s] That a test may be late for what it sees.
BOTH = pytest.mark.parametrize("transport", ["lcm", "ros2"])


def wire_of(transport):
    """A wire that nobody else uses."""
    return LcmWireConfig(url=multicast_url()) if transport == "lcm" else own_wire()


class Ends:
    """The controller's and the robot's end of a wire."""

    def __init__(self, wire):
        self.controller, self.robot = open_link(wire, Role.CONTROLLER), open_link(wire, Role.ROBOT)
        self.sequence = 0
        self.commanded_at = 0.0

    def wait_for(self, condition, send=lambda: None):
        """Waits, and sends at 10 Hz, until what a condition returns is true; returns that."""
        start = sent_at = time.monotonic()
        send()
        while not (result := condition()):
            now = time.monotonic()
            assert now < start + PATIENCE, "what must come did not"
            if now > sent_at + 0.1:
                send()
                sent_at = now
            self.controller.wait(0.001)
            self.robot.wait(0.001)
        return result

    def sample(self):
        """The robot tells where it is, and the controller asks for the same as ever."""
        stamp = time.time_ns()
        self.robot.send(Odometry(stamp, np.array([1e-9 * self.sequence, 0, 0]), np.zeros(3)))
        command = DriveCommand(7, self.sequence, np.full(4, 20.0), np.zeros(3), stamp, False)
        self.controller.send(command)
        self.sequence += 1
        self.commanded_at = time.monotonic()

    def wheels(self):
        """The newest command that came to the robot since the last call, or nothing."""
        commands = self.robot.take(WheelCommand)
        return commands[-1].command.tolist() if commands else None

    def drive(self):
        """Drives until the wheels have turned for some samples."""
        self.wait_for(lambda: self.wheels() == [20.0] * 4, self.sample)
        for _ in range(3):
            self.sample()
            self.robot.wait(0.1)

    def close(self):
        self.controller.close()
        self.robot.close()


@pytest.fixture
def ends():
    """Makes the ends of wires, and closes them."""
    made = []

    def make(wire):
        made.append(Ends(wire))
        return made[-1]

    yield make
    for each in made:
        each.close()


@BOTH
@pytest.mark.slow
def test_a_guard_of_its_own_drives_stops_and_ends(transport, ends):
    wire = wire_of(transport)
    with start_guard(wire, GovernorConfig(), np.zeros(3)) as guard:
        assert guard.alive
        # Its session and so its process group: Ctrl-C does not reach it.
        assert os.getsid(guard.process.pid) == guard.process.pid
        here = ends(wire)
        here.drive()
        zero = here.wait_for(lambda: here.wheels() == [0.0] * 4 and time.monotonic())
        assert zero - here.commanded_at < 0.25 + BUSY
        status = here.wait_for(
            lambda: (s := here.controller.latest(GuardStatus)) is not None and s.stopped and s
        )
        assert "s (limit 0.23 s)" in status.reason
        assert guard.stop()
    assert not guard.alive
    assert guard.process.returncode == 0


@BOTH
@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_guard_that_is_told_to_end_leaves_the_wheels_still(transport, number, ends):
    wire = wire_of(transport)
    with start_guard(wire, GovernorConfig(), np.zeros(3)) as guard:
        here = ends(wire)
        here.drive()
        here.wheels()
        guard.process.send_signal(number)
        told = time.monotonic()
        assert here.wait_for(lambda: here.wheels() == [0.0] * 4 and time.monotonic()) < told + BUSY
        assert guard.process.wait(PATIENCE) == 0


@BOTH
@pytest.mark.slow
def test_a_guard_whose_controller_is_killed_stops_the_robot_and_ends(transport, ends):
    setup = GuardSetup(wire=wire_of(transport))
    parent = subprocess.Popen(
        [sys.executable, str(Path(__file__).parent / "guard_parent.py")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    parent.stdin.write(yaml_dump_typed(setup))
    parent.stdin.close()
    guard = int(parent.stdout.readline())
    here = ends(setup.wire)
    here.drive()
    parent.kill()
    parent.wait()
    killed = time.monotonic()
    assert (
        here.wait_for(lambda: here.wheels() == [0.0] * 4 and time.monotonic())
        < killed + 0.25 + BUSY
    )
    # It goes on for a while, and then it is gone.
    last = killed
    while time.monotonic() < killed + LINGER + 1.0:
        here.robot.wait(0.01)
        wheels = here.wheels()
        assert wheels in (None, [0.0] * 4)
        last = time.monotonic() if wheels else last
    assert LINGER - 0.1 < last - killed < LINGER + 0.5
    assert not runs(guard)


def runs(pid: int) -> bool:
    """Whether a process that is not ours runs; its own parent may not have noticed its end yet."""
    stat = Path(f"/proc/{pid}/stat")
    return stat.exists() and stat.read_text().rsplit(")", 1)[1].split()[0] != "Z"


@pytest.mark.parametrize("wire", [Ros2WireConfig(domain=5), LcmWireConfig(prefix="A_")])
def test_what_a_guard_is_told_survives_the_way(wire):
    governor = GovernorConfig(max_solve_failures=5, allowed_area=np.array([-1.0, -2, 3, 4]))
    setup = GuardSetup(wire, governor, np.array([0.1, 0.2, 0.3]), parent=99)
    told = parse_typed(GuardSetup, yaml_dump_typed(setup), "guard")
    assert told.wire == wire
    assert told.parent == 99
    assert told.start.tolist() == [0.1, 0.2, 0.3]
    for name in ("allowed_area", "max_tracking_error"):
        assert getattr(told.governor, name).tolist() == getattr(governor, name).tolist()
    rest = {"allowed_area": None, "max_tracking_error": None}
    assert dc.replace(told.governor, **rest) == dc.replace(governor, **rest)


def test_a_guard_that_cannot_start_says_why_in_one_line():
    with pytest.raises(UserError, match=r"^guard: did not start: start: must be within [^\n]*$"):
        start_guard(LcmWireConfig(url="memq://"), GovernorConfig(), np.full(3, 9.0))
    with pytest.raises(UserError, match=r"^guard: did not start: url: [^\n]*$"):
        start_guard(LcmWireConfig(url="nothing"), GovernorConfig(), np.zeros(3))


def executable(path: Path, text: str) -> str:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


def test_a_guard_that_dies_at_once_is_an_error(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "executable", executable(tmp_path / "dies", "exit 3"))
    with pytest.raises(UserError, match=r"^guard: did not start: no answer, exit code"):
        start_guard(LcmWireConfig(), GovernorConfig(), np.zeros(3))


def test_a_guard_that_does_not_answer_is_ended(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "executable", executable(tmp_path / "hangs", "exec sleep 60"))
    with pytest.raises(UserError, match=r"^guard: did not start: no answer, exit code -9$"):
        start_guard(LcmWireConfig(), GovernorConfig(), np.zeros(3), patience=0.2)
