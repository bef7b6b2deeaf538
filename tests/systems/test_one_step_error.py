import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from system_ports import feedthrough, port_table

from mirte_drake.angles import rotation
from mirte_drake.model.model_file import load_model
from mirte_drake.systems.one_step_error import AddOneStepError, OneStepError

MODEL, COMMAND = load_model("extended_kinematic"), np.array([10.0, 20.0, 15.0, 12.0])
ERRORS = np.array([[0.05, -0.02, 0.1], [0.0, 0.01, -0.3], [-0.04, 0.03, 0.09]])


class Drive:
    """Shows the system a robot which moves as predicted but for given errors."""

    def __init__(self, dut: OneStepError) -> None:
        self.dut, self.simulator = dut, Simulator(dut)
        self.pose, self.samples = np.array([0.1, -0.2, 0.7]), 0
        self.show(self.pose)

    def show(self, state) -> np.ndarray:
        """Returns the error after the sample at which the state is shown."""
        context = self.simulator.get_mutable_context()
        self.dut.GetInputPort("state").FixValue(context, state)
        self.dut.GetInputPort("wheel_command").FixValue(context, COMMAND)
        self.simulator.AdvanceTo(0.1 * self.samples + 0.05)
        self.samples += 1
        return self.dut.GetOutputPort("error").Eval(context)

    def go(self, error) -> np.ndarray:
        """Shows the next pose, off by an error [m/s, m/s, rad/s] in the body frame."""
        turned = rotation(self.pose[2]) @ np.asarray(error)
        self.pose = MODEL.step(self.pose, COMMAND, 0.1) + 0.1 * turned
        return self.show(self.pose)


def make_dut() -> OneStepError:
    return OneStepError(MODEL, period=0.1)


def test_ports():
    assert port_table(make_dut()) == ({"state": 3, "wheel_command": 4}, {"error": 3})
    assert feedthrough(make_dut()) == {("state", "error")}


def test_the_error_is_that_of_the_body_frame():
    drive = Drive(make_dut())
    for error in ERRORS:
        np.testing.assert_allclose(drive.go(error), error, atol=1e-12)


def test_before_a_prediction_and_after_a_missing_state_there_is_none():
    drive = Drive(make_dut())
    assert np.all(np.isnan(drive.dut.GetOutputPort("error").Eval(drive.simulator.get_context())))
    drive.go(ERRORS[0])
    assert np.all(np.isnan(drive.show(np.full(3, np.nan))))
    assert np.all(np.isnan(drive.go(ERRORS[1])))
    np.testing.assert_allclose(drive.go(ERRORS[2]), ERRORS[2], atol=1e-12)


def test_at_the_sample_itself_the_error_is_already_there():
    drive = Drive(make_dut())
    context = drive.simulator.get_mutable_context()
    moved = MODEL.step(drive.pose, COMMAND, 0.1) + np.array([0.0, 0.0, 0.01])
    drive.dut.GetInputPort("state").FixValue(context, moved)
    drive.simulator.AdvanceTo(0.1)  # The update of that instant is not done yet.
    error = drive.dut.GetOutputPort("error").Eval(context)
    np.testing.assert_allclose(error, [0.0, 0.0, 0.1], atol=1e-12)


def test_a_model_with_more_states_predicts_from_them():
    model = load_model("dynamic")
    dut = OneStepError(model, period=0.1)
    simulator, state = Simulator(dut), np.array([0.1, 0.2, 0.3, 0.2, -0.1, 0.4])
    context = simulator.get_mutable_context()
    dut.GetInputPort("wheel_command").FixValue(context, COMMAND)
    for k in range(2):
        dut.GetInputPort("state").FixValue(context, state)
        simulator.AdvanceTo(0.1 * k + 0.05)
        state = model.step(state, COMMAND, 0.1)
    np.testing.assert_allclose(dut.GetOutputPort("error").Eval(context), np.zeros(3), atol=1e-12)


def test_interleaved_simulators_do_not_disturb_each_other():
    dut = make_dut()
    together = Drive(dut), Drive(dut)
    for error in ERRORS:
        np.testing.assert_allclose(together[0].go(error), error, atol=1e-12)
        np.testing.assert_allclose(together[1].go(-error), -error, atol=1e-12)


def test_add_names_and_returns_the_system():
    builder = DiagramBuilder()
    dut = AddOneStepError(builder, MODEL, period=0.1, name="errors")
    assert isinstance(dut, OneStepError)
    assert builder.Build().GetSubsystemByName("errors") is dut
