import dataclasses as dc

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from system_ports import feedthrough, port_table

from mirte_drake.control.plan import SolveStatus
from mirte_drake.hardware.messages import NOTHING, GuardStatus, Odometry
from mirte_drake.hardware.odometry_check import OdometryLimits
from mirte_drake.model.lagged_model import LaggedModel, LaggedParameters
from mirte_drake.model.model_file import load_model
from mirte_drake.robots.wire_robot import WireRobot

MODEL = load_model("kinematic")
START = np.array([-0.3, -0.2, 0.0])
# Where the odometry says the robot is when the drive begins.
SWITCHED_ON = np.array([2.0, 1.0, np.pi / 2])
FORWARD = np.array([50.0, 50.0, 50.0, 50.0])


def make_dut(**change) -> WireRobot:
    values = dict(start=START, period=0.1, session=7, limits=OdometryLimits())
    return WireRobot(MODEL, **{**values, **change})


def odometry(time, pose, delay=0.0, velocity=(0.1, 0.2, 0.3)) -> Odometry:
    """Measured at a time of the robot's clock, which is 1000 s ahead; arrives ``delay`` later."""
    stamp = round(1e9 * (time + 1000))
    return Odometry(stamp, np.array(pose), np.array(velocity), arrival=time + delay)


def status(command) -> GuardStatus:
    return GuardStatus(7, 0, np.array(command), False, "", 0.0, 0)


class Drive:
    """Takes the adapter from sample to sample."""

    def __init__(self, dut):
        self.dut = dut
        self.simulator = Simulator(dut)
        self.context = self.simulator.get_mutable_context()
        self.sample = 0
        self.set("wheel_command", FORWARD)

    def set(self, port, value):
        self.dut.GetInputPort(port).FixValue(self.context, value)

    def get(self, port):
        return self.dut.GetOutputPort(port).Eval(self.context)

    def to_sample(self, clock, message, command=(0, 0, 0, 0)):
        self.set("clock", [clock])
        self.set("odometry", message)
        self.set("guard_status", status(command))
        self.simulator.AdvanceTo(0.1 * self.sample)
        before = self.get("pose")
        self.simulator.AdvancePendingEvents()
        np.testing.assert_array_equal(self.get("pose"), before)  # The same all through a sample.
        self.sample += 1


def test_ports():
    inputs, outputs = port_table(make_dut())
    assert inputs == {
        "wheel_command": 4,
        "reference": 3,
        "solve_status": 1,
        "plan": "abstract",
        "odometry": "abstract",
        "guard_status": "abstract",
        "clock": 1,
    }
    assert outputs == {
        "pose": 3,
        "body_velocity": 3,
        "odometry_age": 1,
        "drive_command": "abstract",
        "plan_view": "abstract",
    }
    # The controller's command depends on the pose, so the pose must not on the command.
    measured = {"odometry", "guard_status", "clock"}
    assert {i for i, o in feedthrough(make_dut()) if o == "pose"} == measured


def test_before_any_odometry_nothing_is_asked_of_the_guard():
    drive = Drive(make_dut())
    drive.to_sample(5.0, NOTHING)
    np.testing.assert_array_equal(drive.get("pose"), START)
    np.testing.assert_array_equal(drive.get("body_velocity"), np.zeros(3))
    assert drive.get("drive_command") == NOTHING and drive.get("plan_view") == NOTHING


def test_the_path_begins_where_the_robot_is():
    drive = Drive(make_dut())
    drive.to_sample(5.0, odometry(5.0, SWITCHED_ON))
    np.testing.assert_allclose(drive.get("pose"), START, atol=1e-12)
    np.testing.assert_array_equal(drive.get("body_velocity"), [0.1, 0.2, 0.3])
    # The robot looks along +y of the odometry: forward by 0.05 m is there, and left is -x.
    drive.to_sample(5.1, odometry(5.1, SWITCHED_ON + np.array([-0.02, 0.05, 0.1])))
    np.testing.assert_allclose(drive.get("pose"), START + np.array([0.05, 0.02, 0.1]), atol=1e-12)


def test_yaw_is_unwrapped():
    drive = Drive(make_dut(start=np.zeros(3)))
    for k, yaw in enumerate([3.0, 3.1, -3.083185307179586, -2.983185307179586]):
        drive.to_sample(5 + 0.1 * k, odometry(5 + 0.1 * k, [0, 0, yaw]))
        assert drive.get("pose")[2] == pytest.approx(0.1 * k)


def test_an_old_measurement_is_rolled_forward_with_the_commands_that_were_sent():
    drive = Drive(make_dut(start=np.zeros(3)))
    drive.to_sample(5.0, odometry(5.0, np.zeros(3)))
    drive.to_sample(5.1, odometry(5.1, [0.01, 0, 0]), command=(10, 10, 10, 10))
    # Measured at 5.17, it arrives at 5.2: the command of 5.1, which the guard says was 50, acted.
    drive.to_sample(5.2, odometry(5.17, [0.03, 0, 0], delay=0.03), command=FORWARD)
    assert drive.get("odometry_age")[0] == pytest.approx(0.03)
    expected = MODEL.step(np.array([0.03, 0, 0]), FORWARD, 0.03)
    np.testing.assert_allclose(drive.get("pose"), expected, atol=1e-9)
    # Nothing came: 0.12 s later the same measurement is 0.15 s old.
    message = odometry(5.17, [0.03, 0, 0], delay=0.03)
    drive.to_sample(5.32, message, command=(20, 20, 20, 20))
    assert drive.get("odometry_age")[0] == pytest.approx(0.15)
    expected = MODEL.step(expected, np.full(4, 20.0), 0.12)
    np.testing.assert_allclose(drive.get("pose"), expected, atol=1e-9)


def test_a_lagged_model_is_rolled_forward_from_the_measured_velocity_with_late_commands():
    parameters = LaggedParameters(lag=np.full(3, 0.2), delay=1)
    model = LaggedModel("late", parameters)
    dut = WireRobot(model, start=np.zeros(3), period=0.1, session=7, limits=OdometryLimits())
    drive = Drive(dut)
    drive.to_sample(5.0, odometry(5.0, np.zeros(3)))
    drive.to_sample(5.1, odometry(5.1, [0.01, 0, 0]), command=(10, 10, 10, 10))
    message = odometry(5.17, [0.03, 0, 0], delay=0.03, velocity=(0.1, 0.0, 0.0))
    drive.to_sample(5.2, message, command=FORWARD)
    # What was sent at 5.0 acts from 5.1 to 5.2.
    expected = model.step(np.array([0.03, 0, 0, 0.1, 0, 0]), np.full(4, 10.0), 0.03)
    np.testing.assert_allclose(drive.get("pose"), expected[:3], atol=1e-9)


def test_the_model_is_compiled_before_the_drive_begins(monkeypatch):
    stepped = []
    monkeypatch.setattr(type(MODEL), "step", lambda model, x, u, dt: stepped.append(dt))
    make_dut(start=np.zeros(3))
    assert stepped == [0.1]


def test_rolling_forward_can_be_switched_off():
    drive = Drive(make_dut(start=np.zeros(3), roll_forward=False))
    drive.to_sample(5.0, odometry(5.0, np.zeros(3)))
    drive.to_sample(5.12, odometry(5.1, [0.02, 0, 0], delay=0.02), command=FORWARD)
    np.testing.assert_allclose(drive.get("pose"), [0.02, 0, 0], atol=1e-12)
    assert drive.get("odometry_age")[0] == pytest.approx(0.02)


@pytest.mark.parametrize(
    "bad", [[np.nan, 0, 0], [np.inf, 0, 0], [5.0, 0, 0]], ids=["nan", "inf", "jump"]
)
def test_bad_odometry_leaves_the_last_good_one_in_force(bad):
    drive = Drive(make_dut(start=np.zeros(3)))
    drive.to_sample(5.0, odometry(5.0, np.zeros(3)))
    drive.to_sample(5.1, odometry(5.1, bad))
    np.testing.assert_allclose(drive.get("pose"), np.zeros(3), atol=1e-12)
    assert drive.get("odometry_age")[0] == pytest.approx(0.1)
    drive.to_sample(5.2, odometry(5.2, [0.01, 0, 0]))
    np.testing.assert_allclose(drive.get("pose"), [0.01, 0, 0], atol=1e-12)


def test_what_is_asked_of_the_guard():
    drive = Drive(make_dut())
    drive.to_sample(5.0, odometry(5.0, SWITCHED_ON))
    drive.set("reference", START + np.array([0.1, 0, 0]))
    drive.set("solve_status", [float(SolveStatus.SHIFTED)])
    command = drive.get("drive_command")
    assert (command.session, command.sequence, command.done) == (7, 0, False)
    assert command.odometry_stamp == round(1e9 * 1005)
    assert command.solve_failed
    np.testing.assert_array_equal(command.command, FORWARD)
    np.testing.assert_allclose(command.reference, SWITCHED_ON + np.array([0, 0.1, 0]), atol=1e-12)
    drive.to_sample(5.1, odometry(5.1, SWITCHED_ON))
    drive.set("solve_status", [float(SolveStatus.RELAXED)])
    command = drive.get("drive_command")
    assert command.sequence == 1 and not command.solve_failed


def test_without_a_reference_no_error_is_reported():
    drive = Drive(make_dut())
    moved = SWITCHED_ON + np.array([0, 0.05, 0])
    drive.to_sample(5.0, odometry(5.0, SWITCHED_ON))
    drive.to_sample(5.1, odometry(5.1, moved))
    np.testing.assert_allclose(drive.get("drive_command").reference, moved, atol=1e-12)


def test_contexts_are_independent():
    dut = make_dut()
    one, other = Drive(dut), Drive(dut)
    one.to_sample(5.0, odometry(5.0, SWITCHED_ON))
    other.to_sample(5.0, odometry(5.0, np.zeros(3)))
    one.to_sample(5.1, odometry(5.1, SWITCHED_ON + np.array([0, 0.1, 0])))
    other.to_sample(5.1, odometry(5.1, np.zeros(3)))
    np.testing.assert_allclose(one.get("pose"), START + np.array([0.1, 0, 0]), atol=1e-12)
    np.testing.assert_allclose(other.get("pose"), START, atol=1e-12)
    assert dc.is_dataclass(one.get("drive_command"))
