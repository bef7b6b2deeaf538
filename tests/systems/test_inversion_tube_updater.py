import dataclasses as dc

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from system_ports import feedthrough, port_table

from mirte_drake.control.inversion_tube import propagate_inversion_tube, required_room
from mirte_drake.control.plan import idle_plan
from mirte_drake.control.turning_map import turning_map
from mirte_drake.model.model_file import load_model
from mirte_drake.model.sparse_model import SparseModel
from mirte_drake.systems.inversion_tube_updater import (
    AddInversionTubeUpdater,
    InversionTubeUpdater,
    InversionTubeUpdaterConfig,
)
from mirte_drake.systems.nominal_nmpc import NominalNmpcConfig, make_tracking_problem

MODEL = load_model("extended_kinematic")
STATE, UBAR = np.array([0.1, 0.2, 0.3]), np.array([10.0, 20.0, 30.0, 40.0])
COMMAND = np.array([12.0, 15.0, 33.0, 41.0])
D0, W_MAX = np.array([0.005, 0.004, 0.01]), np.array([0.04, 0.03, 0.09])
# Each wheel moves one axis, whatever the yaw.
BY_HAND = SparseModel(
    "by hand",
    ["x", "y", "theta"],
    ["u1", "u2", "u3", "u4"],
    {"x": {"u1": 0.01}, "y": {"u2": 0.01}, "theta": {"u3": 0.01}},
)


def make_dut(
    model=MODEL, *, horizon=2, feedback=9.0, input_limit=100.0, **config
) -> InversionTubeUpdater:
    return InversionTubeUpdater(
        InversionTubeUpdaterConfig(**config),
        model,
        period=0.1,
        horizon=horizon,
        feedback=feedback,
        input_limit=input_limit,
    )


def make_plan(model=MODEL, ubar=UBAR):
    problem = make_tracking_problem(NominalNmpcConfig(horizon=2), model, 0.1)
    inputs = np.array([ubar, ubar + 1.0])
    states = model.roll_out(STATE, inputs, 0.1)
    return dc.replace(idle_plan(problem), states=states, inputs=inputs)


def simulate(dut, plan=None, state=STATE, command=COMMAND) -> Simulator:
    simulator = Simulator(dut)
    context = simulator.get_mutable_context()
    dut.GetInputPort("plan").FixValue(context, plan or make_plan())
    dut.GetInputPort("state").FixValue(context, np.asarray(state, dtype=float))
    dut.GetInputPort("wheel_command").FixValue(context, command)
    return simulator


def read(simulator, port) -> np.ndarray:
    return simulator.get_system().GetOutputPort(port).Eval(simulator.get_context())


def updated(dut, *ports, **inputs) -> list[np.ndarray]:
    simulator = simulate(dut, **inputs)
    simulator.AdvanceTo(0.05)  # Past the update at 0, before the one at 0.1.
    return [read(simulator, port) for port in ports]


def test_ports():
    inputs, outputs = port_table(make_dut(horizon=10))
    assert inputs == {"plan": "abstract", "state": 3, "wheel_command": 4}
    assert outputs == {"half_width": 3, "input_lower": 40, "input_upper": 40}


def test_no_output_has_feedthrough():
    assert feedthrough(make_dut()) == set()


def test_first_sample_has_the_initial_width_and_bounds():
    simulator = simulate(make_dut(initial_half_width=D0))
    np.testing.assert_array_equal(read(simulator, "half_width"), D0)
    np.testing.assert_array_equal(read(simulator, "input_lower"), np.full(8, -90.0))
    np.testing.assert_array_equal(read(simulator, "input_upper"), np.full(8, 90.0))


def test_initial_bounds_stay_within_the_input_limit():
    simulator = simulate(make_dut(input_limit=50.0))
    np.testing.assert_array_equal(read(simulator, "input_upper"), np.full(8, 50.0))


def test_one_update_by_hand():
    # At rest, the law's command: a tenth of d_0 is left, and the disturbance turns by 0.009 rad.
    dut, plan = make_dut(BY_HAND, initial_half_width=D0), make_plan(BY_HAND, np.zeros(4))
    error = np.array([0.005, -0.002, 0.01])
    (width, upper) = updated(
        dut,
        "half_width",
        "input_upper",
        plan=plan,
        state=STATE + error,
        command=np.array([*(-900.0 * error), 0.0]),
    )
    heading = 0.3 + 0.01 - 0.5 * 0.009  # In the middle of the sample's sweep.
    swept = 0.5 * 0.09 * 0.1 + 0.009
    for angles in (heading - swept, heading + swept):
        box = np.abs([np.cos(angles), np.sin(angles)])
        assert np.all(width[:2] - 0.1 * D0[:2] >= 0.1 * np.array([W_MAX[:2] @ box, 0]) - 1e-12)
    assert width[2] == pytest.approx(0.001 + 0.009)
    np.testing.assert_allclose(upper[:4], 100.0 - 900.0 * np.array([*width, 0.0]), rtol=1e-5)


def test_updates_are_those_of_the_functions():
    (width, lower, upper) = updated(
        make_dut(initial_half_width=D0), "half_width", "input_lower", "input_upper"
    )
    plan, mapping = make_plan(), turning_map(MODEL)
    nominal = STATE, plan.states[1]
    expected = propagate_inversion_tube(
        MODEL, mapping, nominal, STATE, COMMAND, D0, W_MAX, 9.0, 0.1
    )
    np.testing.assert_array_equal(width, expected)
    room = required_room(mapping, plan.states[1, 2], plan.inputs[1], expected, 9.0, 0.1, 100.0)
    np.testing.assert_array_equal(upper, np.tile(100.0 - room, 2))
    np.testing.assert_array_equal(lower, -upper)


def test_a_command_that_is_not_the_laws_widens_the_tube():
    (width,) = updated(make_dut(), "half_width", command=UBAR)
    (wider,) = updated(make_dut(), "half_width", command=UBAR + 10.0 * np.eye(4)[2])
    assert np.all(wider > width)


def test_missing_measurement_keeps_the_tube_finite():
    (width,) = updated(
        make_dut(initial_half_width=D0), "half_width", state=[np.nan, 0, 0], command=UBAR
    )
    assert np.all(np.isfinite(width)) and np.all(width > D0)


def test_bounds_are_zero_when_the_tube_takes_more_than_there_is():
    lower, upper = updated(
        make_dut(initial_half_width=np.full(3, 0.2), feedback=1.0), "input_lower", "input_upper"
    )
    np.testing.assert_array_equal(upper, np.zeros(8))
    np.testing.assert_array_equal(lower, np.zeros(8))


def test_one_stage_is_enough():
    plan = make_plan()
    plan = dc.replace(plan, inputs=plan.inputs[:1], states=plan.states[:2])
    (upper,) = updated(make_dut(horizon=1), "input_upper", plan=plan)
    assert upper.shape == (4,) and np.all(upper < 100.0)


def test_disturbance_bound_can_be_changed_in_a_context():
    dut = make_dut()
    changed, other = simulate(dut, command=UBAR), simulate(dut, command=UBAR)
    changed.get_mutable_context().get_mutable_numeric_parameter(0).SetFromVector([0.0, 0.0, 0.9])
    changed.AdvanceTo(0.05)
    other.AdvanceTo(0.05)
    assert read(changed, "half_width")[2] == pytest.approx(0.09)
    assert read(other, "half_width")[2] == pytest.approx(0.009)


def test_interleaved_simulators_do_not_disturb_each_other():
    dut, commands = make_dut(initial_half_width=D0), (COMMAND, UBAR)
    together = [simulate(dut, command=command) for command in commands]
    alone = [simulate(make_dut(initial_half_width=D0), command=command) for command in commands]
    for k in range(3):
        for simulator in (*together, *alone):
            simulator.AdvanceTo(0.1 * k + 0.05)
    for port in ("half_width", "input_lower", "input_upper"):
        for shared, own in zip(together, alone, strict=True):
            np.testing.assert_array_equal(read(shared, port), read(own, port))
    assert not np.array_equal(*(read(simulator, "half_width") for simulator in together))
    fresh = dut.CreateDefaultContext()
    np.testing.assert_array_equal(dut.GetOutputPort("half_width").Eval(fresh), D0)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("disturbance_bound", np.array([0.1, -0.1, 0.1])),
        ("disturbance_bound", np.ones(2)),
        ("initial_half_width", -np.ones(3)),
        ("initial_half_width", np.array([0.1, np.nan, 0.1])),
        ("initial_input_limit", -1.0),
    ],
)
def test_rejects_bad_config(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        make_dut(**{field: value})


def test_model_whose_inputs_multiply_in_the_position_is_refused():
    tables = {"x": {"u1": 0.01, "u1*u2": 1e-4}, "y": {"u2": 0.01}, "theta": {"u3": 0.01}}
    model = SparseModel("by hand", ["x", "y", "theta"], ["u1", "u2", "u3", "u4"], tables)
    with pytest.raises(ValueError, match="products of inputs"):
        make_dut(model)


def test_add_names_and_returns_the_system():
    builder, config = DiagramBuilder(), InversionTubeUpdaterConfig()
    dut = AddInversionTubeUpdater(
        builder, config, MODEL, period=0.1, horizon=10, feedback=9.0, name="tube"
    )
    assert isinstance(dut, InversionTubeUpdater)
    assert builder.Build().GetSubsystemByName("tube") is dut
