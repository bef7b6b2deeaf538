import dataclasses as dc

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from system_ports import feedthrough, port_table

from mirte_drake.control.lagged_axis import feedback_gains, observer_gains
from mirte_drake.control.lagged_tube import (
    EllipsoidTube,
    ModeTube,
    box_of_state,
    input_room,
    lagged_loop,
)
from mirte_drake.control.plan import idle_plan
from mirte_drake.model.lagged_model import LaggedModel, LaggedParameters
from mirte_drake.systems.lagged_tube_updater import (
    AddLaggedTubeUpdater,
    LaggedTubeConfig,
    LaggedTubeUpdater,
)
from mirte_drake.systems.nominal_nmpc import NominalNmpcConfig, make_tracking_problem

LAG = np.array([0.3, 0.15, 0.2])
MODEL = LaggedModel("robot", LaggedParameters(axis_gain=np.array([1.0, 0.5, 0.8]), lag=LAG))
G = MODEL.steady_velocity_jacobian(np.zeros(4))
K = feedback_gains(LAG, 0.1, np.full(3, 16.0), np.full(3, 3.0), np.ones(3))
LOOP = lagged_loop(
    LAG, 0.1, K, observer_gains(LAG, 0.1, np.full(3, 1e-3), np.tile([3e-4, 0.01, 5e-3], (3, 1))), 0
)
BOUND = np.array([0.002, 0.001, 0.003])
STATE, BIAS = np.array([0.1, 0.2, np.pi / 2, 0.0, 0.0, 0.0]), np.array([0.01, -0.02, 0.03])
HORIZON, LIMIT = 3, 80.0


def make_plan(turn=0.03):
    config = NominalNmpcConfig(horizon=HORIZON, terminal_weight=None)
    plan = idle_plan(make_tracking_problem(config, MODEL, 0.1))
    states = np.zeros((HORIZON + 1, 6))
    states[:, 2] = turn * np.arange(HORIZON + 1)
    return dc.replace(plan, states=states, inputs=np.arange(12.0).reshape(HORIZON, 4))


SETUP = {"period": 0.1, "horizon": HORIZON, "input_limit": LIMIT}


def make_dut(command_error=0.5, **config) -> LaggedTubeUpdater:
    config = LaggedTubeConfig(**{"innovation_bound": BOUND, **config})
    return LaggedTubeUpdater(config, MODEL, LOOP, K, command_error=command_error, **SETUP)


def simulate(dut, plan=None, bias=BIAS) -> Simulator:
    simulator = Simulator(dut)
    context = simulator.get_mutable_context()
    dut.GetInputPort("plan").FixValue(context, plan or make_plan())
    dut.GetInputPort("state").FixValue(context, STATE)
    dut.GetInputPort("bias").FixValue(context, bias)
    return simulator


def read(simulator, port) -> np.ndarray:
    return simulator.get_system().GetOutputPort(port).Eval(simulator.get_context())


def test_ports():
    inputs, outputs = port_table(make_dut())
    assert inputs == {"plan": "abstract", "state": 6, "bias": 3, "calibrated_bound": 3}
    assert outputs == {"half_width": 6, "error_bound": 6, "input_lower": 12, "input_upper": 12}


def test_no_output_has_feedthrough_from_the_plan():
    assert feedthrough(make_dut()) == {
        ("state", "half_width"),
        ("bias", "input_lower"),
        ("bias", "input_upper"),
    }


def test_the_first_plan_begins_at_the_estimate_and_has_all_inputs_but_the_bias():
    simulator = simulate(make_dut())
    np.testing.assert_array_equal(read(simulator, "half_width"), np.zeros(6))
    shift = np.tile(np.linalg.pinv(G) @ BIAS, HORIZON)
    np.testing.assert_allclose(read(simulator, "input_lower"), shift - LIMIT)
    np.testing.assert_allclose(read(simulator, "input_upper"), shift + LIMIT)


@pytest.mark.parametrize(
    ("shape", "make"),
    [("modes", ModeTube), ("ellipsoid", lambda *args: EllipsoidTube(*args, 1.0))],
)
def test_two_updates_match_the_recursion(shape, make):
    simulator, plan = simulate(make_dut(shape=shape)), make_plan()
    simulator.AdvanceTo(0.15)
    tube = make(LOOP, 0.5 * np.sum(np.abs(G), axis=1))
    state = tube.advance(tube.advance(tube.start(), 0.03, BOUND), 0.03, BOUND)
    np.testing.assert_allclose(
        read(simulator, "half_width"), box_of_state(tube.box(state), STATE[2]), rtol=1e-12
    )
    np.testing.assert_allclose(
        read(simulator, "error_bound"), tube.components(state).T.ravel(), rtol=1e-12
    )
    upper = []
    for i in (1, 2, 2):  # The plan's last stage is the last that is known.
        velocity = G @ plan.inputs[i]
        room = input_room(tube, state, K, velocity, np.linalg.pinv(G))
        upper.append(np.linalg.pinv(G) @ BIAS + LIMIT - room)
        state = tube.advance(state, 0.03, BOUND)
    np.testing.assert_allclose(read(simulator, "input_upper"), np.ravel(upper), rtol=1e-12)


def test_a_wheel_whose_directions_differ_misses_more():
    gain = np.full((2, 4), 0.2)
    gain[1, 2] = 0.3  # 1.2 of the mean of both directions.
    uneven = LaggedModel("uneven", LaggedParameters(lag=LAG, wheel_gain=gain))
    config = LaggedTubeConfig(innovation_bound=BOUND)
    simulator = simulate(LaggedTubeUpdater(config, uneven, LOOP, K, command_error=0.5, **SETUP))
    simulator.AdvanceTo(0.05)
    by_wheel = uneven.effective().steady_velocity_jacobian(np.zeros(4))
    tube = ModeTube(LOOP, np.abs(by_wheel) @ [0.5, 0.5, 0.6, 0.5])
    expected = tube.components(tube.advance(tube.start(), 0.03, BOUND)).T.ravel()
    np.testing.assert_allclose(read(simulator, "error_bound"), expected, rtol=1e-12)


def test_the_tube_follows_a_calibrated_bound():
    simulator, scaled = simulate(make_dut()), simulate(make_dut(innovation_bound=3 * BOUND))
    context = simulator.get_mutable_context()
    # Over the period: of velocities.
    simulator.get_system().GetInputPort("calibrated_bound").FixValue(context, 3 * BOUND / 0.1)
    for either in (simulator, scaled):
        either.AdvanceTo(0.15)
    for port in ("half_width", "error_bound", "input_upper"):
        np.testing.assert_allclose(read(simulator, port), read(scaled, port), rtol=1e-12)


def test_half_widths_settle_and_later_stages_leave_less():
    simulator = simulate(make_dut())
    widths = []
    for k in range(60):
        simulator.AdvanceTo(0.1 * k + 0.05)
        widths.append(read(simulator, "half_width"))
        upper = read(simulator, "input_upper").reshape(HORIZON, 4) - 4.0 * np.arange(3)[:, None]
        assert np.all(np.diff(upper, axis=0) < 0)
    np.testing.assert_allclose(widths[-1], widths[-2], rtol=1e-3)
    assert np.all(widths[-1] > 0)


def test_bounds_meet_where_the_law_takes_more_than_there_is():
    simulator = simulate(make_dut(innovation_bound=np.full(3, 0.5)), bias=np.zeros(3))
    simulator.AdvanceTo(0.05)
    np.testing.assert_array_equal(read(simulator, "input_upper"), np.zeros(12))
    np.testing.assert_array_equal(read(simulator, "input_lower"), np.zeros(12))


def test_interleaved_simulators_do_not_disturb_each_other():
    dut = make_dut()
    plans = make_plan(), make_plan(turn=0.3)
    both = [simulate(dut, plan) for plan in plans]
    alone = [simulate(make_dut(), plan) for plan in plans]
    for k in range(5):
        for simulator in (*both, *alone):
            simulator.AdvanceTo(0.1 * k + 0.05)
    for port in ("half_width", "input_lower", "input_upper"):
        for together, single in zip(both, alone, strict=True):
            np.testing.assert_array_equal(read(together, port), read(single, port))
    assert not np.array_equal(read(both[0], "half_width"), read(both[1], "half_width"))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("innovation_bound", -np.ones(3)),
        ("innovation_bound", np.ones(2)),
        ("command_error", -1.0),
        ("shape", "box"),
        ("gamma", 0.0),
    ],
)
def test_rejects_bad_config(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        make_dut(**{field: value})


def test_add_names_and_returns_the_system():
    builder = DiagramBuilder()
    dut = AddLaggedTubeUpdater(
        builder, LaggedTubeConfig(), MODEL, LOOP, K, command_error=0.5, name="tube", **SETUP
    )
    assert isinstance(dut, LaggedTubeUpdater)
    assert builder.Build().GetSubsystemByName("tube") is dut
