import importlib
import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from lcm_examples import MESSAGES

from mirte_drake.angles import rotation, wrap_angle
from mirte_drake.cli import main
from mirte_drake.errors import UserError
from mirte_drake.geometry import body_velocity, pwm_to_wheel_speed
from mirte_drake.hardware.bag_recorder import BagRecorder
from mirte_drake.hardware.messages import (
    DriveCommand,
    GuardStatus,
    Odometry,
    PlanView,
    WheelCommand,
)
from mirte_drake.hardware.ros2_messages import NOMINAL_PATH_TOPIC, TUBE_TOPIC, Ros2Messages
from mirte_drake.identification.bag_file import load_bag
from mirte_drake.identification.fit_sindyc import identify
from mirte_drake.identification.recorded_run import RecordedRun
from mirte_drake.model.model_file import load_model_file

mcap = pytest.importorskip("mcap", reason="mcap is not installed")
decoder = pytest.importorskip("mcap_ros2.decoder", reason="mcap-ros2-support is not installed")
pytest.importorskip("rosbags", reason="rosbags is not installed")
for module in ("exceptions", "reader", "records", "stream_reader"):
    importlib.import_module(f"mcap.{module}")

START = 1_756_120_957_000_000_000  # [ns]


def moving_run(rows):
    """Odometry of an ideal robot that drives, slides and turns by several turns."""
    rng = np.random.default_rng(1)
    command = np.repeat(rng.integers(-80, 81, (rows // 3 + 1, 4)), 3, axis=0)[:rows]
    command = command + np.array([-10.0, 10.0, 10.0, -10.0])  # Turns left.
    velocity = np.vstack([np.zeros(3), body_velocity(pwm_to_wheel_speed(command[:-1]))])
    pose = np.empty((rows, 3))
    pose[:, 2] = 0.1 * np.cumsum(velocity[:, 2])
    turned = np.einsum("nij,nj->ni", rotation(pose[:, 2]), velocity)
    pose[:, :2] = 0.1 * np.cumsum(turned[:, :2], axis=0)
    return RecordedRun(0.1 * np.arange(rows), pose, velocity, command)


@pytest.fixture(scope="module")
def run():
    return moving_run(300)


def drive(run):
    """The messages of a drive with their times [ns], as a controller has them."""
    for k, time in enumerate(run.time):
        stamp = START + round(1e9 * time)
        pose = run.pose[k].copy()
        pose[2] = wrap_angle(pose[2])
        yield Odometry(stamp - 5_000_000, pose, run.body_velocity[k]), stamp
        yield MESSAGES[PlanView], stamp + 8_000_000
        yield MESSAGES[DriveCommand], stamp + 8_000_000
        yield WheelCommand(run.wheel_command[k]), stamp + 9_000_000
        yield MESSAGES[GuardStatus], stamp + 9_000_000


def record(path, run, **options):
    messages = Ros2Messages(**options)
    with BagRecorder(path, messages) as recorder:
        for message, time in drive(run):
            recorder.write(messages.encode(message, time))
    return path


def check_run(loaded, run, rows=None):
    rows = len(run.time) if rows is None else rows
    np.testing.assert_allclose(loaded.time, run.time[:rows], rtol=0, atol=1e-9)
    np.testing.assert_allclose(loaded.pose, run.pose[:rows], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(loaded.body_velocity, run.body_velocity[:rows])
    np.testing.assert_array_equal(loaded.wheel_command, run.wheel_command[:rows])


@pytest.mark.parametrize("motor_type", ["Int32", "SetSpeed"])
def test_identification_reads_the_same_numbers(tmp_path, run, motor_type):
    loaded = load_bag(record(tmp_path / "drive.mcap", run, motor_type=motor_type))
    check_run(loaded, run)
    assert "unwrapped" in loaded.repairs[0]
    assert [path.name for path in tmp_path.iterdir()] == ["drive.mcap"]


def test_other_names(tmp_path, run):
    names = {"namespace": "/robot/io", "odometry_topic": "/robot/odom"}
    bag = record(tmp_path / "drive.mcap", run, **names)
    check_run(load_bag(bag, **names), run)


def test_the_identify_command_finds_the_same_model(tmp_path, run):
    bag = record(tmp_path / "drive.mcap", run)
    main(["identify", "--data", str(bag), "--output", str(tmp_path / "model.yaml")])
    found = load_model_file(tmp_path / "model.yaml").derivatives
    expected = identify(run, "extended_kinematic", "converged", date="2025-01-01").derivatives
    assert found.keys() == expected.keys()
    for state, terms in expected.items():
        assert found[state] == pytest.approx(terms, rel=1e-6)


def test_another_reader_finds_every_message(tmp_path, run):
    bag = record(tmp_path / "drive.mcap", run)
    counts, last = {}, {}
    with bag.open("rb") as file:
        bag_reader = mcap.reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        assert bag_reader.get_header().profile == "ros2"
        for _, channel, message, decoded in bag_reader.iter_decoded_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            last[channel.topic] = decoded
            assert message.log_time == message.publish_time >= START
        statistics = bag_reader.get_summary().statistics
    assert set(counts.values()) == {len(run.time)} and len(counts) == 12
    assert statistics.message_count == 12 * len(run.time)
    assert len(last[NOMINAL_PATH_TOPIC].poses) == len(MESSAGES[PlanView].nominal)
    assert last["/guard_status"].reason == MESSAGES[GuardStatus].reason
    assert last[TUBE_TOPIC].markers[0].ns == "tube"
    assert last["/drive_command"].sequence == MESSAGES[DriveCommand].sequence


def test_an_error_during_the_drive_leaves_a_whole_bag(tmp_path, run):
    messages = Ros2Messages()
    with pytest.raises(RuntimeError), BagRecorder(tmp_path / "drive.mcap", messages) as recorder:
        for message, time in drive(run):
            recorder.write(messages.encode(message, time))
        raise RuntimeError
    check_run(load_bag(tmp_path / "drive.mcap"), run)


def test_the_name_is_given_at_the_end(tmp_path):
    recorder = BagRecorder(tmp_path / "new" / "drive.mcap", Ros2Messages())
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["drive.partial.mcap"]
    recorder.close()
    recorder.close()
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["drive.mcap"]


KILLED = f"""
import os, signal, sys
from pathlib import Path
import numpy as np
from mirte_drake.hardware.bag_recorder import BagRecorder
from mirte_drake.hardware.messages import Odometry, PlanView
from mirte_drake.hardware.ros2_messages import Ros2Messages
messages = Ros2Messages()
recorder = BagRecorder(Path(sys.argv[1]), messages)
for k in range(100):
    time = {START} + k * 100_000_000
    recorder.write(messages.encode(Odometry(time, np.zeros(3), np.zeros(3)), time))
    plan = PlanView(np.zeros((11, 3)), np.zeros((11, 3)), np.zeros(3))
    recorder.write(messages.encode(plan, time))
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_killed_process_loses_a_sample_or_two(tmp_path):
    """What any tool can recover, since all of it lies in whole chunks."""
    path = tmp_path / "drive.mcap"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, "-c", KILLED, path], env=environment)
    assert done.returncode == -signal.SIGKILL
    partial, rows = tmp_path / "drive.partial.mcap", set()
    with partial.open("rb") as file, pytest.raises(mcap.exceptions.EndOfFile):
        for item in mcap.stream_reader.StreamReader(file, validate_crcs=True).records:
            if isinstance(item, mcap.records.Message):
                rows.add((item.log_time - START) // 100_000_000)
    assert rows == set(range(len(rows))) and len(rows) >= 98
    with pytest.raises(UserError, match="mcap recover"):
        load_bag(partial)


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match=r"drive\.mcap: cannot be written: "):
        BagRecorder(tmp_path / "file" / "drive.mcap", Ros2Messages())


def test_mcap_is_not_installed(tmp_path, monkeypatch):
    messages = Ros2Messages()
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    with pytest.raises(UserError, match=r"mcap: pip install mirte-drake\[bags\]"):
        BagRecorder(tmp_path / "drive.mcap", messages)
