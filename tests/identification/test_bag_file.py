import shutil
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from recordings import moving_run

from mirte_drake.errors import UserError
from mirte_drake.identification.bag_file import load_bag
from mirte_drake.identification.recorded_run import load_recorded_run
from mirte_drake.vectors import WHEELS

rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="rosbags is not installed")
typesys = pytest.importorskip("rosbags.typesys", reason="rosbags is not installed")

ODOMETRY = "/mirte_base_controller/odom"
INT32, SET_SPEED = "std_msgs/msg/Int32", "mirte_msgs/msg/SetSpeed"
START = 1_756_120_957_000_000_000  # [ns]
STORAGE = {"sqlite3": rosbag2.StoragePlugin.SQLITE3, "mcap": rosbag2.StoragePlugin.MCAP}
ROWS = 60


def topic(wheel: str, namespace: str = "/io") -> str:
    return f"{namespace}/motor/{wheel}/speed"


def make_bag(
    path,
    run=None,
    storage="mcap",
    command_type=SET_SPEED,
    namespace="/io",
    odometry=ODOMETRY,
    odometry_type="nav_msgs/msg/Odometry",
    leave_out=(),
    stamped=True,
    first_command=0,
    command_delay=-1_000_000,
):
    """Writes a bag as the robot would: each command once, 4 ms before the odometry of its row."""
    run = run or moving_run(ROWS)
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    store.register(typesys.get_types_from_msg("int32 speed", SET_SPEED))
    types = store.types
    with rosbag2.Writer(path, version=9, storage_plugin=STORAGE[storage]) as writer:

        def connect(name, kind):
            return writer.add_connection(name, kind, typestore=store)

        def send(connection, stamp, message):
            writer.write(connection, stamp, store.serialize_cdr(message, connection.msgtype))

        extra = connect("/battery", "std_msgs/msg/Float64")
        odom = None if odometry in leave_out else connect(odometry, odometry_type)
        motors = {
            wheel: connect(topic(wheel, namespace), command_type)
            for wheel in WHEELS
            if topic(wheel, namespace) not in leave_out
        }
        for k, t in enumerate(run.time):
            stamp = START + round(1e9 * t)
            send(extra, stamp, types["std_msgs/msg/Float64"](12.0))
            for wheel, connection in motors.items():
                command = run.wheel_command[:, WHEELS.index(wheel)]
                if k == first_command or (k > first_command and command[k] != command[k - 1]):
                    send(connection, stamp + command_delay, types[command_type](int(command[k])))
            if odom and odometry_type == "nav_msgs/msg/Odometry":
                send(odom, stamp + 3_000_000, odometry_message(types, run, k, stamp * stamped))
    return path


def odometry_message(types, run, k, stamp):
    def make(name, *args):
        return types[name](*args)

    x, y, yaw = run.pose[k]
    vx, vy, yaw_rate = run.body_velocity[k]
    vector = "geometry_msgs/msg/Vector3"
    header = make(
        "std_msgs/msg/Header",
        make("builtin_interfaces/msg/Time", stamp // 10**9, stamp % 10**9),
        "odom",
    )
    pose = make(
        "geometry_msgs/msg/Pose",
        make("geometry_msgs/msg/Point", x, y, 0.0),
        make("geometry_msgs/msg/Quaternion", 0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)),
    )
    twist = make("geometry_msgs/msg/Twist", make(vector, vx, vy, 0.0), make(vector, 0, 0, yaw_rate))
    covariance = np.zeros(36)
    return make(
        "nav_msgs/msg/Odometry",
        header,
        "base_link",
        make("geometry_msgs/msg/PoseWithCovariance", pose, covariance),
        make("geometry_msgs/msg/TwistWithCovariance", twist, covariance),
    )


def check_run(run, expected=None):
    expected = expected or moving_run(ROWS)
    turns = run.pose - expected.pose
    turns[:, 2] = np.sin(turns[:, 2] / 2)
    np.testing.assert_allclose(turns, 0.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.time, expected.time, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(run.body_velocity, expected.body_velocity)
    np.testing.assert_array_equal(run.wheel_command, expected.wheel_command)


def bag_error(path, **options) -> str:
    with pytest.raises(UserError) as caught:
        load_bag(path, **options)
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and "\n" not in message
    return message


@pytest.mark.parametrize("command_type", [INT32, SET_SPEED])
@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_both_storages_and_both_command_types(tmp_path, storage, command_type):
    path = make_bag(tmp_path / "drive", storage=storage, command_type=command_type)
    run = load_recorded_run(path)
    check_run(run)
    assert run.source == "drive" and len(run.sha256) == 64
    assert run.repairs == ("yaw: 1 jump of a turn unwrapped",)


@pytest.mark.parametrize(("storage", "suffix"), [("sqlite3", ".db3"), ("mcap", ".mcap")])
def test_the_file_of_a_bag_alone(tmp_path, storage, suffix):
    folder = make_bag(tmp_path / "drive", storage=storage)
    file = shutil.copy(next(folder.glob(f"*{suffix}")), tmp_path / f"alone{suffix}")
    check_run(load_recorded_run(str(file)))


def test_a_bag_without_definitions_in_it(tmp_path, monkeypatch):
    """As sqlite3 bags of ROS 2 Humble are."""
    import sqlite3

    path = make_bag(tmp_path / "drive", storage="sqlite3")
    with sqlite3.connect(next(path.glob("*.db3"))) as database:
        database.execute("DROP TABLE message_definitions")
        database.execute("UPDATE schema SET schema_version = 3")
    check_run(load_recorded_run(path))


def test_other_names(tmp_path):
    path = make_bag(tmp_path / "drive", namespace="/robot_2/io", odometry="/robot_2/odom")
    check_run(load_bag(path, odometry_topic="/robot_2/odom", namespace="/robot_2/io/"))
    assert "topics missing" in bag_error(path)


@pytest.mark.parametrize("milliseconds", [-20, 5, 40])
def test_a_command_belongs_to_the_sample_that_it_drives(tmp_path, milliseconds):
    """A controller answers odometry a little later; that answer drives the sample that follows."""
    bag = make_bag(tmp_path / "drive", command_delay=milliseconds * 1_000_000)
    np.testing.assert_array_equal(load_bag(bag).wheel_command, moving_run(ROWS).wheel_command)


def test_commands_are_zero_before_the_first(tmp_path):
    run = load_bag(make_bag(tmp_path / "drive", first_command=4))
    np.testing.assert_array_equal(run.wheel_command[:4], 0.0)
    np.testing.assert_array_equal(run.wheel_command[4:], moving_run(ROWS).wheel_command[4:])
    assert "front_left: zero in 4 rows before its first command" in run.repairs


def test_odometry_without_stamps(tmp_path):
    run = load_bag(make_bag(tmp_path / "drive", stamped=False))
    check_run(run)
    assert "time: the odometry has no stamps; rebuilt from the times of reception" in run.repairs


def test_missing_topics_are_named(tmp_path):
    left_out = [topic("rear_left"), topic("front_right")]
    message = bag_error(make_bag(tmp_path / "drive", leave_out=left_out))
    assert f"topics missing: {left_out[1]}, {left_out[0]}; the bag has" in message
    there = ["/battery", topic("front_left"), topic("rear_right"), ODOMETRY]
    assert message.endswith("; the bag has " + ", ".join(there))


def test_missing_odometry(tmp_path):
    message = bag_error(make_bag(tmp_path / "drive", leave_out=[ODOMETRY]))
    assert f"topics missing: {ODOMETRY}; the bag has" in message


def test_topics_of_another_type(tmp_path):
    message = bag_error(make_bag(tmp_path / "a", command_type="std_msgs/msg/Float64"))
    assert (
        f"{topic('front_left')} is std_msgs/msg/Float64: must be {INT32} or {SET_SPEED}" in message
    )
    message = bag_error(make_bag(tmp_path / "b", odometry_type="geometry_msgs/msg/Pose"))
    assert f"{ODOMETRY} is geometry_msgs/msg/Pose: must be nav_msgs/msg/Odometry" in message


def test_too_few_messages(tmp_path):
    path = make_bag(tmp_path / "drive", moving_run(5))
    assert "has 5 rows: at least 20" in bag_error(path)


def test_samples_of_no_use_are_named_by_message(tmp_path):
    run = moving_run(ROWS)
    run.pose[7, 2] = np.nan
    message = bag_error(make_bag(tmp_path / "drive", run))
    assert f"{ODOMETRY}, message 8: yaw is nan" in message


def test_rosbags_is_not_installed(tmp_path, monkeypatch):
    path = make_bag(tmp_path / "drive")
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    message = bag_error(path)
    assert message == f"{path}: needs the package rosbags: pip install mirte-drake[bags]"


def test_paths_that_are_no_bags(tmp_path):
    assert "no such file or folder" in bag_error(tmp_path / "nothing")
    assert "folder without metadata.yaml" in bag_error(tmp_path)
    for name in ("a.mcap", "a.db3"):
        (tmp_path / name).write_bytes(b"nonsense")
        assert "cannot be read as a ROS 2 bag" in bag_error(tmp_path / name)
    (tmp_path / "metadata.yaml").write_text("a: [")
    assert "cannot be read as a ROS 2 bag" in bag_error(tmp_path)


@pytest.fixture(scope="module", params=["a.db3", "a.mcap"])
def good_file(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    storage = {"a.db3": "sqlite3", "a.mcap": "mcap"}[request.param]
    bag = make_bag(folder / "drive", moving_run(20), storage)
    file = next(f for f in bag.iterdir() if f.suffix in (".db3", ".mcap"))
    return shutil.copy(file, folder / f"good_{request.param}")


@settings(
    max_examples=60,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(st.binary(max_size=30), st.integers(0, 10**6), st.booleans())
def test_broken_files(good_file, patch, start, cut):
    """A run with finite samples or one line, whatever the bytes."""
    good = good_file.read_bytes()
    path = good_file.with_name(f"broken{good_file.suffix}")
    start %= len(good)
    path.write_bytes(good[:start] + patch + (b"" if cut else good[start + len(patch) :]))
    try:
        run = load_recorded_run(path)
    except UserError as error:
        assert "\n" not in str(error)
        return
    for array in (run.time, run.pose, run.body_velocity, run.wheel_command):
        assert np.all(np.isfinite(array))
