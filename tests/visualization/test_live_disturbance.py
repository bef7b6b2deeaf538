import numpy as np
import pytest
from meshcat_spy import MeshcatSpy
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from system_ports import feedthrough, port_table

from mirte_drake.visualization.live_disturbance import (
    LARGEST_SIZE,
    PUSH,
    PUSH_BUTTON,
    SIZE_SLIDER,
    AddLiveDisturbance,
    LiveDisturbance,
    push_velocity,
)

W = np.array([0.01, -0.02, 0.03])


@pytest.fixture
def meshcat():
    return MeshcatSpy()


@pytest.fixture
def dut(meshcat):
    return LiveDisturbance(meshcat, period=0.1)


def simulate(dut) -> Simulator:
    simulator = Simulator(dut)
    dut.GetInputPort("disturbance").FixValue(simulator.get_mutable_context(), W)
    return simulator


def at(simulator, time) -> np.ndarray:
    simulator.AdvanceTo(time)
    dut = simulator.get_system()
    return dut.GetOutputPort("live_disturbance").Eval(simulator.get_context())


def test_ports(dut):
    assert port_table(dut) == ({"disturbance": 3}, {"live_disturbance": 3})
    assert feedthrough(dut) == {("disturbance", "live_disturbance")}


def test_changes_nothing_while_nobody_does_anything(dut):
    simulator = simulate(dut)
    for time in (0.0, 0.05, 0.1, 1.23):
        np.testing.assert_array_equal(at(simulator, time), W)


def test_the_slider_scales_from_the_next_sample_on(meshcat, dut):
    simulator = simulate(dut)
    at(simulator, 0.05)
    meshcat.SetSliderValue(SIZE_SLIDER, 2.0)
    np.testing.assert_array_equal(at(simulator, 0.09), W)
    np.testing.assert_allclose(at(simulator, 0.15), 2 * W)
    meshcat.SetSliderValue(SIZE_SLIDER, 0.0)
    np.testing.assert_array_equal(at(simulator, 0.25), np.zeros(3))
    meshcat.SetSliderValue(SIZE_SLIDER, 99.0)
    np.testing.assert_allclose(at(simulator, 0.35), LARGEST_SIZE * W)


def test_a_click_pushes_for_one_period(meshcat, dut):
    simulator = simulate(dut)
    at(simulator, 0.05)
    meshcat.click(PUSH_BUTTON)
    np.testing.assert_array_equal(at(simulator, 0.09), W)
    np.testing.assert_allclose(at(simulator, 0.11), W + push_velocity(1, 0.1))
    np.testing.assert_allclose(at(simulator, 0.19), W + push_velocity(1, 0.1))
    np.testing.assert_array_equal(at(simulator, 0.21), W)


def test_two_clicks_in_a_period_are_one_push_and_the_next_one_is_another(meshcat, dut):
    simulator = simulate(dut)
    at(simulator, 0.05)
    meshcat.click(PUSH_BUTTON)
    meshcat.click(PUSH_BUTTON)
    np.testing.assert_allclose(at(simulator, 0.15), W + push_velocity(2, 0.1))
    np.testing.assert_array_equal(at(simulator, 0.25), W)
    meshcat.click(PUSH_BUTTON)
    np.testing.assert_allclose(at(simulator, 0.35), W + push_velocity(3, 0.1))


def test_a_push_moves_the_robot_by_its_length_whatever_the_period():
    np.testing.assert_allclose(push_velocity(1, 0.1), [0, PUSH / 0.1, 0], atol=1e-12)
    for click in range(1, 20):
        for period in (0.02, 0.1):
            x, y, turn = period * push_velocity(click, period)
            assert np.hypot(x, y) == pytest.approx(PUSH) and turn == 0
    directions = np.array([push_velocity(click, 0.1)[:2] for click in range(1, 8)])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    assert np.max(directions @ directions.T - 2 * np.eye(7)) < np.cos(np.deg2rad(30))


def test_a_context_that_begins_later_does_not_push_again(meshcat, dut):
    first = simulate(dut)
    at(first, 0.05)
    meshcat.click(PUSH_BUTTON)
    np.testing.assert_allclose(at(first, 0.15), W + push_velocity(1, 0.1))
    second = simulate(dut)
    np.testing.assert_array_equal(at(second, 0.05), W)
    np.testing.assert_array_equal(at(first, 0.25), W)


def test_add_names_and_returns_the_system(meshcat):
    builder = DiagramBuilder()
    dut = AddLiveDisturbance(builder, meshcat, period=0.1, name="hand")
    assert isinstance(dut, LiveDisturbance)
    assert builder.Build().GetSubsystemByName("hand") is dut
