import dataclasses as dc

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from system_ports import feedthrough, port_table

from mirte_drake.control.dlqr import discretise_euler, solve_dlqr
from mirte_drake.control.plan import SolveStatus, idle_plan
from mirte_drake.model.model_file import load_model
from mirte_drake.model.sparse_model import SparseModel
from mirte_drake.systems.ancillary_dlqr import AddAncillaryDlqr, AncillaryDlqr, AncillaryDlqrConfig
from mirte_drake.systems.nominal_nmpc import NominalNmpcConfig, make_tracking_problem

MODEL = load_model("extended_kinematic")
STATES = np.array([[0.1, 0.2, 0.3], [0.15, 0.2, 0.5], [0.2, 0.3, 0.7], [0.2, 0.3, 0.9]])
INPUTS = np.array([[10.0, 20.0, 30.0, 40.0], [5.0, -5.0, 50.0, 0.0], [-60.0, 0.0, 30.0, 20.0]])


def make_model(**derivatives) -> SparseModel:
    names = {"x": {"u1": 0.01}, "y": {"u2": 0.01}, "theta": {"u3": 0.01}} | derivatives
    return SparseModel("by hand", ["x", "y", "theta"], ["u1", "u2", "u3", "u4"], names)


def make_dut(model=MODEL, *, stages=1, **config) -> AncillaryDlqr:
    return AncillaryDlqr(AncillaryDlqrConfig(**config), model, period=0.1, stages=stages)


def make_plan(states=STATES, inputs=INPUTS, status=SolveStatus.SOLVED):
    problem = make_tracking_problem(NominalNmpcConfig(horizon=len(inputs)), MODEL, 0.1)
    return dc.replace(idle_plan(problem), status=status, states=states, inputs=inputs)


def evaluate(dut, port, plan, state=STATES[0]):
    context = dut.CreateDefaultContext()
    dut.GetInputPort("plan").FixValue(context, plan)
    dut.GetInputPort("state").FixValue(context, np.asarray(state, dtype=float))
    return dut.GetOutputPort(port).Eval(context)


def command(dut, plan, state) -> np.ndarray:
    return evaluate(dut, "wheel_command", plan, state)


def test_ports():
    inputs, outputs = port_table(make_dut())
    assert inputs == {"plan": "abstract", "state": 3}
    assert outputs == {"wheel_command": 4, "designs": "abstract"}


def test_command_has_feedthrough_and_designs_depend_on_the_plan_alone():
    assert feedthrough(make_dut()) == {
        ("plan", "wheel_command"),
        ("state", "wheel_command"),
        ("plan", "designs"),
    }


def test_command_by_hand():
    # Each axis alone: a = 1, b = 0.001, q = 1000, r = 0.001. The Riccati equation is
    # p^2 - 1000 p - 1e6 = 0, so p = 1000 (1 + sqrt 5) / 2 and k = b p / (r + b^2 p).
    k = 1000 * (np.sqrt(5) - 1) / 2
    error = np.array([0.02, -0.01, 0.05])
    actual = command(make_dut(make_model()), make_plan(), STATES[0] + error)
    expected = [10 - k * 0.02, 20 + k * 0.01, 30 - k * 0.05, 40.0]
    np.testing.assert_allclose(actual, expected, rtol=1e-9)


def test_command_of_the_identified_model_uses_the_gain_at_the_first_stage():
    Q, R = np.diag([1000.0, 2000.0, 3000.0]), np.diag([1e-3, 2e-3, 3e-3, 4e-3])
    _, A, B = MODEL.linearise(STATES[0], INPUTS[0])
    K, _ = solve_dlqr(*discretise_euler(A, B, 0.1), Q, R)
    error = np.array([0.01, 0.02, -0.03])
    dut = make_dut(state_weight=np.diag(Q), input_weight=np.diag(R))
    actual = command(dut, make_plan(), STATES[0] + error)
    np.testing.assert_allclose(actual, INPUTS[0] - K @ error, rtol=1e-12)


def test_without_error_the_command_is_the_nominal_input():
    np.testing.assert_array_equal(command(make_dut(), make_plan(), STATES[0]), INPUTS[0])


def test_opposite_errors_give_opposite_corrections():
    dut, plan, error = make_dut(), make_plan(), np.array([0.01, -0.02, 0.04])
    both = command(dut, plan, STATES[0] + error) + command(dut, plan, STATES[0] - error)
    np.testing.assert_allclose(both, 2 * INPUTS[0], atol=1e-9)


@pytest.mark.parametrize("turns", [-3, -1, 1, 2])
def test_whole_turns_of_yaw_do_not_count(turns):
    dut, plan = make_dut(), make_plan()
    state = STATES[0] + np.array([0.01, 0.0, 0.02])
    turned = state + np.array([0.0, 0.0, 2 * np.pi * turns])
    np.testing.assert_allclose(command(dut, plan, turned), command(dut, plan, state), atol=1e-9)


def test_stopping_plan_is_applied_as_it_is():
    plan = make_plan(status=SolveStatus.STOPPING)
    np.testing.assert_array_equal(command(make_dut(), plan, STATES[0] + 0.1), INPUTS[0])


def test_shifted_plan_is_corrected():
    plan = make_plan(status=SolveStatus.SHIFTED)
    expected = command(make_dut(), make_plan(), STATES[0] + 0.1)
    np.testing.assert_array_equal(command(make_dut(), plan, STATES[0] + 0.1), expected)
    assert not np.array_equal(expected, INPUTS[0])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("entry", [0, 1, 2])
def test_measurement_that_is_not_finite_gives_the_nominal_input(entry, bad):
    state = STATES[0].copy()
    state[entry] = bad
    with np.errstate(invalid="ignore"):
        np.testing.assert_array_equal(command(make_dut(), make_plan(), state), INPUTS[0])


def test_design_is_the_closed_loop_at_the_plan_and_stable():
    (design,) = evaluate(make_dut(), "designs", make_plan())
    _, A, B = MODEL.linearise(STATES[0], INPUTS[0])
    expected = np.eye(3) + 0.1 * A - 0.1 * B @ design.gain
    np.testing.assert_allclose(design.closed_loop, expected, atol=1e-14)
    assert design.yaw == STATES[0, 2]
    assert np.max(np.abs(np.linalg.eigvals(design.closed_loop))) < 1.0


def test_every_stage_gets_its_own_design():
    designs = evaluate(make_dut(stages=3), "designs", make_plan())
    assert [design.yaw for design in designs] == [0.3, 0.5, 0.7]
    for design, x, u in zip(designs, STATES[:3], INPUTS, strict=True):
        _, A, B = MODEL.linearise(x, u)
        K, _ = solve_dlqr(*discretise_euler(A, B, 0.1), 1000 * np.eye(3), 0.001 * np.eye(4))
        np.testing.assert_allclose(design.gain, K, rtol=1e-12)


def test_stages_do_not_change_the_command():
    state = STATES[0] + 0.02
    expected = command(make_dut(stages=1), make_plan(), state)
    np.testing.assert_array_equal(command(make_dut(stages=3), make_plan(), state), expected)


# Yaw rate u3/64 + u3 u3/4096: at u3 = -32 no input moves the yaw to first order.
FADING = {"theta": {"u3": 1 / 64, "u3*u3": 1 / 4096}}


def test_stage_that_cannot_be_stabilised_gets_no_feedback():
    inputs = INPUTS.copy()
    inputs[1, 2] = -32.0
    designs = evaluate(
        make_dut(make_model(**FADING), stages=3), "designs", make_plan(inputs=inputs)
    )
    np.testing.assert_array_equal(designs[1].gain, np.zeros((4, 3)))
    np.testing.assert_array_equal(designs[1].closed_loop, np.eye(3))
    assert np.any(designs[0].gain != 0)
    assert np.any(designs[2].gain != 0)


def test_command_without_feedback_is_the_nominal_input():
    inputs = INPUTS.copy()
    inputs[0, 2] = -32.0
    actual = command(make_dut(make_model(**FADING)), make_plan(inputs=inputs), STATES[0] + 0.1)
    np.testing.assert_array_equal(actual, inputs[0])


def test_model_whose_yaw_no_input_drives_is_refused():
    with pytest.raises(ValueError, match="cannot be stabilised"):
        make_dut(make_model(theta={}))


def test_model_with_body_velocity_gets_a_gain_of_six_columns():
    model = load_model("dynamic")
    dut = make_dut(model, state_weight=np.full(6, 1000.0))
    plan = make_plan(states=np.zeros((4, 6)))
    (design,) = evaluate(dut, "designs", plan, np.zeros(6))
    assert design.gain.shape == (4, 6)
    assert np.max(np.abs(np.linalg.eigvals(design.closed_loop))) < 1.0


def test_contexts_do_not_share_designs():
    dut = make_dut()
    first, second = dut.CreateDefaultContext(), dut.CreateDefaultContext()
    for context, state in ((first, STATES), (second, STATES + np.array([0.0, 0.0, 1.0]))):
        dut.GetInputPort("plan").FixValue(context, make_plan(states=state))
    yaws = [dut.GetOutputPort("designs").Eval(c)[0].yaw for c in (first, second, first)]
    assert yaws == [0.3, 1.3, 0.3]


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("state_weight", np.array([1.0, 0.0, 1.0])),
        ("state_weight", np.array([1.0, np.nan, 1.0])),
        ("state_weight", np.ones(4)),
        ("input_weight", np.array([1.0, 1.0, 1.0, -1.0])),
        ("input_weight", np.full(4, np.inf)),
        ("input_weight", np.ones(3)),
    ],
)
def test_rejects_bad_config(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        make_dut(**{field: value})


def test_add_names_and_returns_the_system():
    builder = DiagramBuilder()
    dut = AddAncillaryDlqr(builder, AncillaryDlqrConfig(), MODEL, period=0.1, name="feedback")
    assert isinstance(dut, AncillaryDlqr)
    assert builder.Build().GetSubsystemByName("feedback") is dut
