import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from system_ports import feedthrough, port_table

from mirte_drake.angles import rotation
from mirte_drake.control.conformal import AdaptiveConformal, adapt, box_scores, first_calibration
from mirte_drake.model.model_file import load_model
from mirte_drake.systems.coverage_monitor import (
    AddCoverageMonitor,
    CoverageMonitor,
    CoverageMonitorConfig,
)

MODEL = load_model("extended_kinematic")
BOUND, COMMAND = np.array([0.04, 0.03, 0.09]), np.array([10.0, 20.0, 15.0, 12.0])
PORTS = ("prediction_error", "calibrated_bound", "coverage", "coverage_warning")


def make_dut(model=MODEL, **config) -> CoverageMonitor:
    return CoverageMonitor(CoverageMonitorConfig(**config), model, period=0.1)


class Drive:
    """A monitor that is shown a robot which moves as predicted but for given errors."""

    def __init__(self, dut: CoverageMonitor) -> None:
        self.dut, self.simulator = dut, Simulator(dut)
        self.pose, self.samples = np.array([0.1, -0.2, 0.7]), 0
        self._show(self.pose)

    def _show(self, pose) -> None:
        context = self.simulator.get_mutable_context()
        for port in ("pose", "state"):
            self.dut.GetInputPort(port).FixValue(context, pose)
        self.dut.GetInputPort("wheel_command").FixValue(context, COMMAND)
        self.simulator.AdvanceTo(0.1 * self.samples + 0.05)
        self.samples += 1

    def go(self, error) -> None:
        """Shows the next pose, off by an error [m/s, m/s, rad/s] in the body frame."""
        turned = rotation(self.pose[2]) @ np.asarray(error)
        self.pose = MODEL.step(self.pose, COMMAND, 0.1) + 0.1 * turned
        self._show(self.pose)

    def miss_one(self) -> None:
        """Shows a pose that is not finite."""
        self.pose = MODEL.step(self.pose, COMMAND, 0.1)
        self._show(np.full(3, np.nan))

    def read(self, port) -> np.ndarray:
        return self.dut.GetOutputPort(port).Eval(self.simulator.get_context())


def errors(seed, count, size=1.0) -> np.ndarray:
    return size * BOUND * np.random.default_rng(seed).normal(size=(count, 3))


def test_ports():
    inputs, outputs = port_table(make_dut())
    assert inputs == {"pose": 3, "state": 3, "wheel_command": 4}
    assert outputs == dict(zip(PORTS, (3, 3, 2, 2), strict=True))


def test_no_output_has_feedthrough():
    assert feedthrough(make_dut()) == set()


def test_before_the_first_error_the_set_in_use_stands():
    drive = Drive(make_dut())
    np.testing.assert_array_equal(drive.read("calibrated_bound"), BOUND)
    assert np.all(np.isnan(drive.read("prediction_error")))
    assert np.all(np.isnan(drive.read("coverage")))
    np.testing.assert_array_equal(drive.read("coverage_warning"), [0.0, 0.0])


def test_the_error_is_that_of_the_body_frame():
    drive = Drive(make_dut())
    for error in errors(0, 5):
        drive.go(error)
        np.testing.assert_allclose(drive.read("prediction_error"), error, atol=1e-12)


def test_the_set_is_that_of_the_adaptive_conformal_method():
    drive = Drive(make_dut(gain=0.1, window=7, cap=5.0))
    settings = AdaptiveConformal(0.9, 0.1, 7, 5.0)
    calibration = first_calibration(settings)
    for error in errors(1, 30, size=2.0):
        drive.go(error)
        calibration = adapt(settings, calibration, float(box_scores(error, BOUND)))
        np.testing.assert_allclose(drive.read("calibrated_bound"), calibration.scale * BOUND)


def test_coverage_by_hand():
    drive = Drive(make_dut(window=4, target=0.5))
    # Held by both sets; missed by both; after which the calibrated set is twice as large.
    for scale, expected in ((0.5, [1, 1]), (2.0, [0.5, 0.5]), (1.5, [1 / 3, 2 / 3])):
        drive.go(scale * BOUND)
        np.testing.assert_allclose(drive.read("coverage"), expected)


def test_coverage_runs_over_the_window():
    drive = Drive(make_dut(window=3))
    for scale in (9.0, 0.1, 0.1, 0.1):
        drive.go(scale * BOUND)
    assert drive.read("coverage")[0] == 1.0


def test_warnings_begin_when_the_window_is_full():
    drive = Drive(make_dut(window=10))
    for k in range(10):
        np.testing.assert_array_equal(drive.read("coverage_warning"), [0.0, 0.0])
        drive.go((1.1 if k % 2 else 0.9) * BOUND)
    # Half of the errors are outside the set in use.
    assert drive.read("coverage_warning")[0] == 1.0


def test_a_set_in_use_that_holds_everything_gives_no_warning():
    drive = Drive(make_dut(window=10))
    for _ in range(15):
        drive.go(0.1 * BOUND)
    assert drive.read("coverage")[0] == 1.0
    assert drive.read("coverage_warning")[0] == 0.0


def test_a_calibrated_set_that_holds_too_much_gives_one():
    # Errors that shrink are always within the quantile of those before.
    drive = Drive(make_dut(window=10, gain=1e-6))
    for k in range(15):
        drive.go(0.9**k * BOUND)
    np.testing.assert_array_equal(drive.read("coverage"), [1.0, 1.0])
    assert drive.read("coverage_warning")[1] == 1.0


def test_a_missing_measurement_counts_for_nothing():
    drive = Drive(make_dut(window=5))
    for error in errors(2, 3):
        drive.go(error)
    before = [drive.read(port) for port in PORTS]
    drive.miss_one()
    drive.go(9 * BOUND)  # Nothing was predicted from the missing pose.
    for port, value in zip(PORTS, before, strict=True):
        np.testing.assert_array_equal(drive.read(port), value)
    drive.go(0.5 * BOUND)
    np.testing.assert_allclose(drive.read("prediction_error"), 0.5 * BOUND, atol=1e-12)


def test_a_model_with_more_states_predicts_from_them():
    model = load_model("dynamic")
    dut = make_dut(model)
    simulator = Simulator(dut)
    context = simulator.get_mutable_context()
    state = np.array([0.1, 0.2, 0.3, 0.2, -0.1, 0.4])
    for k, pose in enumerate((state[:3], model.step(state, COMMAND, 0.1)[:3])):
        dut.GetInputPort("pose").FixValue(context, pose)
        dut.GetInputPort("state").FixValue(context, state)
        dut.GetInputPort("wheel_command").FixValue(context, COMMAND)
        simulator.AdvanceTo(0.1 * k + 0.05)
    error = dut.GetOutputPort("prediction_error").Eval(context)
    np.testing.assert_allclose(error, np.zeros(3), atol=1e-12)


def test_interleaved_simulators_do_not_disturb_each_other():
    dut = make_dut(window=5)
    together = [Drive(dut), Drive(dut)]
    alone = [Drive(make_dut(window=5)), Drive(make_dut(window=5))]
    for small, large in zip(errors(3, 8), errors(4, 8, size=3.0), strict=True):
        for drives in (together, alone):
            drives[0].go(small)
            drives[1].go(large)
    for port in PORTS:
        for shared, own in zip(together, alone, strict=True):
            np.testing.assert_array_equal(shared.read(port), own.read(port))
    bounds = [drive.read("calibrated_bound") for drive in together]
    assert np.all(bounds[1] > bounds[0])


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("disturbance_bound", np.array([0.1, 0.0, 0.1])),
        ("disturbance_bound", np.ones(2)),
        ("target", 1.0),
        ("gain", 0.0),
        ("window", 0),
        ("cap", -1.0),
        ("band", 1.5),
    ],
)
def test_rejects_bad_config(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        make_dut(**{field: value})


def test_add_names_and_returns_the_system():
    builder = DiagramBuilder()
    dut = AddCoverageMonitor(builder, CoverageMonitorConfig(), MODEL, period=0.1, name="watch")
    assert isinstance(dut, CoverageMonitor)
    assert builder.Build().GetSubsystemByName("watch") is dut
