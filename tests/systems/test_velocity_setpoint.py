import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from system_ports import feedthrough, port_table

from mirte_drake.systems.velocity_setpoint import (
    AddVelocitySetpointSource,
    VelocitySetpointConfig,
    VelocitySetpointSource,
)


def make_dut(*, horizon=3, **config) -> VelocitySetpointSource:
    return VelocitySetpointSource(VelocitySetpointConfig(**config), period=0.1, horizon=horizon)


def simulate(dut, setpoint=None) -> Simulator:
    simulator = Simulator(dut)
    if setpoint is not None:
        set_velocity(simulator, setpoint)
    return simulator


def set_velocity(simulator, setpoint) -> None:
    port = simulator.get_system().GetInputPort("velocity_setpoint")
    port.FixValue(simulator.get_mutable_context(), np.asarray(setpoint, dtype=float))


def reference(simulator) -> np.ndarray:
    return simulator.get_system().GetOutputPort("reference").Eval(simulator.get_context())


def window(simulator) -> np.ndarray:
    port = simulator.get_system().GetOutputPort("reference_window")
    return port.Eval(simulator.get_context()).reshape(-1, 3)


def references(simulator, samples, first=0) -> np.ndarray:
    """Returns the reference after each of the updates number ``first``, ``first`` + 1, ..."""
    rows = []
    for k in range(first, first + samples):
        simulator.AdvanceTo(0.1 * k + 0.05)
        rows.append(reference(simulator))
    return np.array(rows)


def test_ports():
    inputs, outputs = port_table(make_dut(horizon=10))
    assert inputs == {"velocity_setpoint": 3}
    assert outputs == {"reference": 3, "reference_window": 33}


def test_only_the_window_depends_on_the_setpoint_at_once():
    assert feedthrough(make_dut()) == {("velocity_setpoint", "reference_window")}


def test_velocity_rises_within_the_acceleration_limit():
    simulator = simulate(make_dut(), [0.25, 0.0, 0.0])  # At 1 m/s^2: 0.1, 0.2, 0.25 m/s.
    x = references(simulator, 5)[:, 0]
    np.testing.assert_allclose(x, [0.01, 0.03, 0.055, 0.08, 0.105], atol=1e-15)


def test_reference_begins_at_the_start():
    start = np.array([1.0, -2.0, 0.5])
    np.testing.assert_array_equal(reference(simulate(make_dut(start=start))), start)


def test_window_holds_the_setpoint_over_the_horizon():
    simulator = simulate(make_dut(), [0.25, 0.0, 0.0])
    np.testing.assert_allclose(window(simulator)[:, 0], [0.0, 0.01, 0.03, 0.055], atol=1e-15)


def test_second_row_of_the_window_is_the_next_reference():
    simulator = simulate(make_dut(start=np.array([0.3, 0.2, 3.0])), [0.4, -0.3, 1.2])
    for k in range(20):
        preview = window(simulator)
        np.testing.assert_array_equal(preview[0], reference(simulator))
        np.testing.assert_allclose(references(simulator, 1, k)[0], preview[1], atol=1e-15)


def test_turning_setpoint_draws_an_arc():
    dut = make_dut(acceleration_limit=np.full(3, 100.0))
    simulator = simulate(dut, [0.2, 0.0, 1.0])
    time = 0.1 * np.arange(1, 31)
    arc = np.column_stack([0.2 * np.sin(time), 0.2 * (1 - np.cos(time)), time])
    np.testing.assert_allclose(references(simulator, 30), arc, atol=1e-12)


def test_yaw_is_not_wrapped():
    simulator = simulate(make_dut(), [0.0, 0.0, 2.0])
    simulator.AdvanceTo(10.0)
    assert reference(simulator)[2] > 19.0


def test_open_port_takes_the_setpoint_of_the_config():
    setpoint = np.array([0.05, 0.02, 0.1])
    simulator = simulate(make_dut(setpoint=setpoint))
    expected = references(simulate(make_dut(), setpoint), 10)
    np.testing.assert_array_equal(references(simulator, 10), expected)


def test_port_goes_before_the_config():
    simulator = simulate(make_dut(setpoint=np.ones(3)), np.zeros(3))
    np.testing.assert_array_equal(references(simulator, 5), np.zeros((5, 3)))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_setpoint_that_is_not_finite_decelerates_to_rest(bad):
    simulator = simulate(make_dut(), [0.2, 0.0, 0.0])
    references(simulator, 3)  # 0.01, 0.03, 0.05 m.
    set_velocity(simulator, [0.2, bad, 0.0])
    assert np.all(np.isfinite(window(simulator)))
    after = references(simulator, 4, first=3)
    expected = np.column_stack([[0.06, 0.06, 0.06, 0.06], np.zeros((4, 2))])
    np.testing.assert_allclose(after, expected, atol=1e-15)


def test_velocity_never_changes_faster_than_the_limit():
    limit = np.array([0.5, 1.0, 0.0])
    simulator = simulate(make_dut(acceleration_limit=limit))
    random = np.random.default_rng(1)
    poses = [np.zeros(3)]
    for k in range(50):
        set_velocity(simulator, random.uniform(-1, 1, 3))
        poses.append(references(simulator, 1, k)[0])
    velocity = np.diff(poses, axis=0, prepend=[np.zeros(3)]) / 0.1
    change = np.abs(np.diff(velocity, axis=0))
    assert np.all(change <= 0.1 * limit + 1e-12)
    assert np.any(change[:, 0] > 0.049)


def test_interleaved_simulators_do_not_disturb_each_other():
    dut = make_dut()
    setpoints = ([0.3, 0.0, 0.5], [-0.2, 0.1, 0.0])
    alone = [references(simulate(make_dut(), s), 8) for s in setpoints]
    simulators = [simulate(dut, s) for s in setpoints]
    for k in range(8):
        for simulator, expected in zip(simulators, alone, strict=True):
            np.testing.assert_array_equal(references(simulator, 1, k)[0], expected[k])


@pytest.mark.parametrize("field", ["setpoint", "acceleration_limit", "start"])
@pytest.mark.parametrize("value", [np.zeros(2), np.array([0.0, np.nan, 0.0])])
def test_rejects_bad_config(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        make_dut(**{field: value})


def test_rejects_negative_acceleration_limit():
    with pytest.raises(ValueError, match=r"^acceleration_limit: "):
        make_dut(acceleration_limit=np.array([1.0, -1.0, 1.0]))


def test_add_names_and_returns_the_system():
    builder = DiagramBuilder()
    config = VelocitySetpointConfig()
    dut = AddVelocitySetpointSource(builder, config, period=0.1, horizon=4, name="joystick")
    assert isinstance(dut, VelocitySetpointSource)
    assert builder.Build().GetSubsystemByName("joystick") is dut
