import dataclasses as dc

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from system_ports import feedthrough, port_table

from mirte_drake.control.plan import SolveStatus, idle_plan
from mirte_drake.model.model_file import load_model
from mirte_drake.model.sparse_model import SparseModel
from mirte_drake.systems.ancillary_inversion import (
    AddAncillaryInversion,
    AncillaryInversion,
    AncillaryInversionConfig,
)
from mirte_drake.systems.nominal_nmpc import NominalNmpcConfig, make_tracking_problem

MODEL = load_model("extended_kinematic")
XHAT, UBAR = np.array([0.1, 0.2, 0.3]), np.array([10.0, 20.0, 30.0, 40.0])


def make_model(**derivatives) -> SparseModel:
    names = {"x": {"u1": 0.01}, "y": {"u2": 0.01}, "theta": {"u3": 0.01}} | derivatives
    return SparseModel("by hand", ["x", "y", "theta"], ["u1", "u2", "u3", "u4"], names)


def make_dut(model=MODEL, *, feedback=9.0, period=0.1, input_limit=100.0) -> AncillaryInversion:
    config = AncillaryInversionConfig(feedback=feedback)
    return AncillaryInversion(config, model, period=period, input_limit=input_limit)


def make_plan(xhat=XHAT, ubar=UBAR, status=SolveStatus.SOLVED, model=MODEL):
    problem = make_tracking_problem(NominalNmpcConfig(horizon=2), model, 0.1)
    inputs = np.array([ubar, np.zeros(4)])
    states = model.roll_out(xhat, inputs, 0.1)
    return dc.replace(idle_plan(problem), status=status, states=states, inputs=inputs)


def evaluate(dut, port, plan, state) -> np.ndarray:
    context = dut.CreateDefaultContext()
    dut.GetInputPort("plan").FixValue(context, plan)
    dut.GetInputPort("state").FixValue(context, np.asarray(state, dtype=float))
    return dut.GetOutputPort(port).Eval(context)


def command(dut, plan, state) -> np.ndarray:
    return evaluate(dut, "wheel_command", plan, state)


def test_ports():
    inputs, outputs = port_table(make_dut())
    assert inputs == {"plan": "abstract", "state": 3}
    assert outputs == {"wheel_command": 4, "reached": 1}


def test_both_outputs_follow_from_plan_and_state():
    ports = [(i, o) for i in ("plan", "state") for o in ("wheel_command", "reached")]
    assert feedthrough(make_dut()) == set(ports)


def test_command_by_hand():
    # Each wheel moves one axis by 0.01 per pwm: u = ubar - 9 e / 0.01.
    error = np.array([0.02, -0.01, 0.05])
    model = make_model()
    actual = command(make_dut(model), make_plan(model=model), XHAT + error)
    np.testing.assert_allclose(actual, [10 - 18, 20 + 9, 30 - 45, 40.0])


@pytest.mark.parametrize("feedback", [2.0, 9.0, 10.0])
def test_command_leaves_of_the_error_what_the_feedback_says(feedback):
    rng, dut = np.random.default_rng(0), make_dut(feedback=feedback)
    for _ in range(20):
        xhat, ubar = rng.uniform(-3, 3, 3), rng.uniform(-40, 40, 4)
        error = 0.01 * rng.uniform(-1, 1, 3)
        plan = make_plan(xhat, ubar)
        left = MODEL.step(xhat + error, command(dut, plan, xhat + error), 0.1) - plan.nominal_next
        np.testing.assert_allclose(left, (1 - 0.1 * feedback) * error, rtol=0, atol=1e-12)
        assert evaluate(dut, "reached", plan, xhat + error) == [1.0]


def test_without_error_the_command_is_the_nominal_input():
    np.testing.assert_allclose(command(make_dut(), make_plan(), XHAT), UBAR, atol=1e-9)


@pytest.mark.parametrize("turns", [-3, 1])
def test_whole_turns_of_yaw_do_not_count(turns):
    state = XHAT + np.array([0.01, 0.0, 0.02])
    turned = state + np.array([0.0, 0.0, 2 * np.pi * turns])
    dut, plan = make_dut(), make_plan()
    np.testing.assert_allclose(command(dut, plan, turned), command(dut, plan, state), atol=1e-9)


def test_limits_are_kept_and_what_is_reached_is_told():
    dut, plan = make_dut(make_model()), make_plan(model=make_model())
    state = XHAT - np.array([0.2, 0.1, 0.0])  # Asks for 180 and 90 more.
    np.testing.assert_allclose(command(dut, plan, state), [100.0, 65.0, 30.0, 40.0], atol=1e-5)
    assert evaluate(dut, "reached", plan, state)[0] == pytest.approx(0.5, abs=1e-7)


def test_input_limit_is_that_of_the_scenario():
    state = XHAT - np.array([0.2, 0.0, 0.0])
    dut = make_dut(make_model(), input_limit=50.0)
    actual = command(dut, make_plan(model=make_model()), state)
    assert actual[0] == pytest.approx(50.0, abs=1e-5)


def test_stopping_plan_is_applied_as_it_is():
    plan = make_plan(status=SolveStatus.STOPPING)
    np.testing.assert_array_equal(command(make_dut(), plan, XHAT + 0.1), UBAR)
    assert evaluate(make_dut(), "reached", plan, XHAT + 0.1) == [1.0]


def test_shifted_plan_is_corrected():
    expected = command(make_dut(), make_plan(), XHAT + 0.01)
    actual = command(make_dut(), make_plan(status=SolveStatus.SHIFTED), XHAT + 0.01)
    np.testing.assert_array_equal(actual, expected)
    assert not np.allclose(actual, UBAR)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("entry", [0, 1, 2])
def test_measurement_that_is_not_finite_gives_the_nominal_input(entry, bad):
    state = XHAT.copy()
    state[entry] = bad
    np.testing.assert_array_equal(command(make_dut(), make_plan(), state), UBAR)


def test_contexts_do_not_share_results():
    dut = make_dut()
    first, second = dut.CreateDefaultContext(), dut.CreateDefaultContext()
    for context, error in ((first, 0.0), (second, 0.01)):
        dut.GetInputPort("plan").FixValue(context, make_plan())
        dut.GetInputPort("state").FixValue(context, XHAT + error)
    port = dut.GetOutputPort("wheel_command")
    before = port.Eval(first).copy()
    assert not np.allclose(port.Eval(second), before)
    np.testing.assert_array_equal(port.Eval(first), before)


@pytest.mark.parametrize(
    ("feedback", "message"),
    [(0.0, "> 0"), (-1.0, "> 0"), (np.nan, "finite"), (10.1, "<= 10")],
)
def test_rejects_bad_config(feedback, message):
    with pytest.raises(ValueError, match=f"^feedback: must be .*{message}"):
        make_dut(feedback=feedback)


@pytest.mark.parametrize(
    "model", [load_model("dynamic"), make_model(theta={"u3": 0.01, "cos(theta)*u4": 0.01})]
)
def test_other_models_are_refused(model):
    with pytest.raises(ValueError, match=f"{model.name}: "):
        make_dut(model)


def test_add_names_and_returns_the_system():
    builder, config = DiagramBuilder(), AncillaryInversionConfig()
    dut = AddAncillaryInversion(builder, config, MODEL, period=0.1, name="feedback")
    assert isinstance(dut, AncillaryInversion)
    assert builder.Build().GetSubsystemByName("feedback") is dut
