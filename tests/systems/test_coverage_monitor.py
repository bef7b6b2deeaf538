import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from system_ports import feedthrough, port_table

from mirte_drake.control.conformal import AdaptiveConformal, adapt, box_scores, first_calibration
from mirte_drake.systems.coverage_monitor import (
    AddCoverageMonitor,
    CoverageMonitor,
    CoverageMonitorConfig,
)

BOUND = np.array([0.04, 0.03, 0.09])
PORTS = ("prediction_error", "calibrated_bound", "coverage", "coverage_warning")


def make_dut(bound=BOUND, **config) -> CoverageMonitor:
    return CoverageMonitor(CoverageMonitorConfig(**config), bound, period=0.1)


class Drive:
    """A monitor that is shown given errors [m/s, m/s, rad/s], the first of them not yet one."""

    def __init__(self, dut: CoverageMonitor) -> None:
        self.dut, self.simulator, self.samples = dut, Simulator(dut), 0
        self.go(np.full(3, np.nan))

    def go(self, error) -> None:
        self.dut.GetInputPort("error").FixValue(self.simulator.get_mutable_context(), error)
        self.simulator.AdvanceTo(0.1 * self.samples + 0.05)
        self.samples += 1

    def read(self, port) -> np.ndarray:
        return self.dut.GetOutputPort(port).Eval(self.simulator.get_context())


def errors(seed, count, size=1.0) -> np.ndarray:
    return size * BOUND * np.random.default_rng(seed).normal(size=(count, 3))


def test_ports():
    inputs, outputs = port_table(make_dut())
    assert inputs == {"error": 3}
    assert outputs == dict(zip(PORTS, (3, 3, 2, 2), strict=True))


def test_only_the_bound_has_feedthrough():
    assert feedthrough(make_dut()) == {("error", "calibrated_bound")}


def test_the_bound_reckons_with_an_error_before_its_update_and_once():
    drive, changes = Drive(make_dut()), 0
    for error in errors(5, 4, size=2.0):
        before = drive.read("calibrated_bound")
        drive.dut.GetInputPort("error").FixValue(drive.simulator.get_mutable_context(), error)
        np.testing.assert_array_equal(drive.read("calibrated_bound"), before)  # Not due yet.
        drive.simulator.AdvanceTo(0.1 * drive.samples)  # Without the updates of that instant.
        due = drive.read("calibrated_bound")
        drive.go(error)
        np.testing.assert_array_equal(drive.read("calibrated_bound"), due)
        changes += not np.array_equal(due, before)
    assert changes > 1


def test_before_the_first_error_the_set_in_use_stands():
    drive = Drive(make_dut())
    np.testing.assert_array_equal(drive.read("calibrated_bound"), BOUND)
    assert np.all(np.isnan(drive.read("prediction_error")))
    assert np.all(np.isnan(drive.read("coverage")))
    np.testing.assert_array_equal(drive.read("coverage_warning"), [0.0, 0.0])


def test_the_last_error_is_there_after_its_sample():
    drive = Drive(make_dut())
    for error in errors(0, 5):
        drive.go(error)
        np.testing.assert_array_equal(drive.read("prediction_error"), error)


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
    before = [drive.read(port) for port in PORTS[1:]]
    drive.go([0.1, np.nan, 0.1])
    assert not np.all(np.isfinite(drive.read("prediction_error")))
    for port, value in zip(PORTS[1:], before, strict=True):
        np.testing.assert_array_equal(drive.read(port), value)


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


def test_rejects_a_set_without_extent():
    with pytest.raises(ValueError, match=r"^disturbance_bound: "):
        make_dut(np.array([0.1, 0.0, 0.1]))


def test_add_names_and_returns_the_system():
    builder = DiagramBuilder()
    dut = AddCoverageMonitor(builder, CoverageMonitorConfig(), BOUND, period=0.1, name="watch")
    assert isinstance(dut, CoverageMonitor)
    assert builder.Build().GetSubsystemByName("watch") is dut
