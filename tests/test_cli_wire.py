import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from cli_runner import check_wrong_use, run_cli
from wire_processes import WIRES, robot_process

from mirte_drake.hardware.link import Role
from mirte_drake.hardware.messages import GuardStatus
from mirte_drake.hardware.wire_config import LcmWireConfig, open_link
from mirte_drake.identification.bag_file import load_bag
from mirte_drake.identification.csv_file import load_csv
from mirte_drake.run import simulate
from mirte_drake.run_summary import summarise
from mirte_drake.scenario_file import load_scenario

# One after the other: they run in real time, in several processes each.
pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("wire")]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["drive", "rectangle"], ["robot", "simulated", "--transport"]),
        (["robot"], ["--transport"]),
        (["guard"], ["--transport"]),
        (["stop"], ["--transport"]),
        (["setpoint", "0.1", "0", "0"], ["--transport"]),
        (["setpoint", "0.1", "0", "--transport", "lcm"], ["3"]),
        (["drive", "rectangle", "--transport", "ros2", "--wire", "domain=900"], ["domain", "900"]),
        (["drive", "rectangle", "--transport", "ros2", "--wire", "colour=1"], ["colour"]),
        (
            ["drive", "rectangle", "--transport", "ros2", "--wire", "interface=eth99", "--no-bag"],
            ["interface", "eth99"],
        ),
        (
            ["drive", "rectangle", "--transport", "lcm", "--set", "robot.governor.slew_limit=0"],
            ["robot.governor.slew_limit", "0"],
        ),
        (["robot", "--transport", "lcm", "--wire", "url=nonsense"], ["url", "nonsense"]),
        (["simulate", "rectangle", "--set", "robot=!LcmRobotConfig {}"], ["drive", "wire"]),
    ],
)
def test_wrong_use(tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    check_wrong_use(capsys, arguments, words)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def drive(transport, output, *arguments):
    return ["drive", "rectangle", *WIRES[transport], "--no-plots", "--output", output, *arguments]


def summary_of(folder):
    return json.loads((folder / "summary.json").read_text())


@pytest.mark.parametrize("transport", ["ros2", "lcm"])
def test_a_short_drive_and_its_bag(tmp_path, capsys, transport):
    with robot_process(transport) as robot:
        code, out, err = run_cli(capsys, *drive(transport, tmp_path / "run", "--set", "duration=2"))
        robot.end()
    assert code == 0, err
    assert "odometry to command" in out and "from odometry to command" in robot.said
    summary = summary_of(tmp_path / "run")
    assert summary["steps"] == 21 and summary["wire"]["ended"] == ""
    assert summary["true_rmse"] is None
    assert sorted(p.name for p in (tmp_path / "run").iterdir()) == [
        "as_run.scenario.yaml",
        "drive.mcap",
        "log.npz",
        "summary.json",
    ]
    # The bag has what was driven: rows of odometry, and the commands as the wheels got them.
    log = np.load(tmp_path / "run" / "log.npz")
    bag = load_bag(tmp_path / "run" / "drive.mcap")
    assert len(bag.time) >= 21
    commands = {tuple(row) for row in np.round(log["applied_input"]).astype(int)}
    recorded = {tuple(row) for row in bag.wheel_command.astype(int)}
    assert len(commands & recorded) > 15


def test_a_setpoint_may_be_negative_and_ends_with_standing_wheels(tmp_path, capsys):
    with robot_process("lcm", "--set", "disturbance.bound=[0,0,0]") as robot:
        output = ["--output", tmp_path, "--duration", "1.5", "--no-bag"]
        code, _, err = run_cli(capsys, "setpoint", "-0.2", "0", "0", *WIRES["lcm"], *output)
        robot.end()
    assert code == 0, err
    pose = np.load(tmp_path / "log.npz")["pose"]
    assert -0.35 < pose[-1, 0] < -0.15
    x = float(robot.said.split("ended at ")[1].split()[0])
    assert x == pytest.approx(-0.3 + pose[-1, 0], abs=0.06)  # It stands since.


def test_collect_over_the_wire(tmp_path, capsys):
    with robot_process("ros2", "--set", "disturbance.bound=[0,0,0]"):
        file = tmp_path / "drive.csv"
        code, out, err = run_cli(
            capsys, "collect", "rectangle", *WIRES["ros2"], "--duration", "4", "--output", file
        )
    assert code == 0, err
    run = load_csv(file)
    assert len(run.time) == 41 and np.ptp(run.pose[:, 0]) > 0.01
    assert "41 samples" in out


def test_nobody_there(tmp_path, capsys):
    output = tmp_path / "run"
    code, _, err = run_cli(capsys, *drive("lcm", output, "--no-bag"))
    assert code == 1 and "Error: no odometry was heard for 5 s" in err
    assert not (output / "summary.json").exists()


def wait_until_it_drives(patience=40.0):
    """Returns once the guard of the LCM wire passes on commands that move the robot."""
    url = WIRES["lcm"][-1].removeprefix("url=")
    end = time.monotonic() + patience
    with open_link(LcmWireConfig(url=url), Role.OPERATOR) as link:
        while not any(np.any(status.command) for status in link.take(GuardStatus)):
            assert time.monotonic() < end, "nothing was driven"
            link.wait(0.1)


def test_stop_stops_a_drive_and_a_running_guard_goes_on_after_reset(tmp_path, capsys):
    command = [sys.executable, "-m", "mirte_drake"]
    with robot_process("lcm"):
        guard = subprocess.Popen([*command, "guard", *WIRES["lcm"]], stderr=subprocess.DEVNULL)
        try:
            arguments = [*drive("lcm", tmp_path / "run", "--running-guard", "--no-bag")]
            driving = subprocess.Popen(
                [*command, *map(str, arguments)], stderr=subprocess.PIPE, text=True
            )
            wait_until_it_drives()
            code, out, _ = run_cli(capsys, "stop", *WIRES["lcm"])
            assert code == 0 and "the guard has stopped: the operator asked for it" in out
            assert "moves at 0.0" in out
            assert driving.wait(10) == 1
            assert "ended early: the operator asked for it" in driving.stderr.read()
            code, _, err = run_cli(capsys, *arguments)
            assert code == 1 and "the operator asked for it" in err
            code, out, _ = run_cli(capsys, "stop", "--reset", *WIRES["lcm"])
            assert code == 0 and "ready" in out
            code, _, err = run_cli(capsys, *arguments, "--set", "duration=0.5")
            assert code == 0, err
        finally:
            guard.send_signal(signal.SIGINT)
            assert guard.wait(10) == 0
            driving.stderr.close()


@pytest.mark.slow
@pytest.mark.parametrize(("transport", "kind"), [("ros2", "sindyc"), ("lcm", "dynamic")])
def test_the_whole_rectangle_is_as_in_one_process(tmp_path, capsys, transport, kind):
    with robot_process(transport, "rectangle", "--robot", kind) as robot:
        code, _, err = run_cli(capsys, *drive(transport, tmp_path))
        robot.end()
    assert code == 0, err
    summary = summary_of(tmp_path)
    override = f"robot=!{kind.capitalize()}RobotConfig {{}}"
    simulated = summarise(simulate(load_scenario("rectangle", [override]), "rectangle"))
    assert summary["steps"] == 251
    for key, value in summary["rmse"].items():
        # A tenth, or a millimetre where there is hardly an error.
        assert value == pytest.approx(simulated["rmse"][key], rel=0.1, abs=1e-3), key
    print(transport, kind, summary["rmse"], simulated["rmse"], robot.said)
    assert robot.percentile("median") < 20
