import dataclasses as dc

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from system_ports import feedthrough, port_table

from mirte_drake.control.lagged_law import tracking_error, wanted_velocity
from mirte_drake.control.plan import SolveStatus, idle_plan
from mirte_drake.model.lagged_model import LaggedModel, LaggedParameters
from mirte_drake.systems.ancillary_lagged import (
    AddAncillaryLagged,
    AncillaryLagged,
    AncillaryLaggedConfig,
)
from mirte_drake.systems.nominal_nmpc import NominalNmpcConfig, make_tracking_problem

MODEL = LaggedModel(
    "robot",
    LaggedParameters(
        axis_gain=np.array([1.0, 0.5, 0.8]),
        wheel_gain=np.array([[0.18, 0.17, 0.16, 0.15], [0.14, 0.15, 0.16, 0.17]]),
        deadband=5.0,
        lag=np.array([0.3, 0.15, 0.2]),
    ),
)
EFFECTIVE = MODEL.effective()
NOMINAL = np.array([0.1, 0.2, 0.3, 0.2, -0.1, 0.1])
INPUT = np.array([20.0, 40.0, 50.0, -45.0])
ERROR = np.array([0.01, -0.02, 0.03, 0.02, 0.01, -0.05])
BIAS = np.array([0.01, 0.02, -0.03])


def make_dut(limit=90.0, **config) -> AncillaryLagged:
    return AncillaryLagged(AncillaryLaggedConfig(**config), MODEL, period=0.1, input_limit=limit)


def make_plan(inputs=INPUT, status=SolveStatus.SOLVED):
    config = NominalNmpcConfig(horizon=2, terminal_weight=None)
    plan = idle_plan(make_tracking_problem(config, EFFECTIVE, 0.1))
    states = np.tile(NOMINAL, (3, 1))
    return dc.replace(plan, status=status, states=states, inputs=np.tile(inputs, (2, 1)))


def command(dut, plan, state, bias=BIAS) -> np.ndarray:
    context = dut.CreateDefaultContext()
    dut.GetInputPort("plan").FixValue(context, plan)
    dut.GetInputPort("state").FixValue(context, state)
    dut.GetInputPort("bias").FixValue(context, bias)
    return dut.GetOutputPort("wheel_command").Eval(context)


def test_ports_and_feedthrough():
    inputs, outputs = port_table(make_dut())
    assert inputs == {"plan": "abstract", "state": 6, "bias": 3}
    assert outputs == {"wheel_command": 4}
    assert feedthrough(make_dut()) == {(port, "wheel_command") for port in inputs}


def test_command_settles_at_the_wanted_velocity():
    dut = make_dut()
    u = command(dut, make_plan(), NOMINAL + ERROR)
    error = tracking_error(NOMINAL + ERROR, NOMINAL)
    wanted = wanted_velocity(error, EFFECTIVE.steady_velocity(INPUT), BIAS, dut.gains)
    np.testing.assert_allclose(MODEL.steady_velocity(u), wanted, atol=1e-10)
    # Of all the effective commands that do, it is the one nearest to the nominal input.
    G = EFFECTIVE.steady_velocity_jacobian(np.zeros(4))
    more = MODEL.effective_command(u) - INPUT
    np.testing.assert_allclose(more, np.linalg.pinv(G) @ G @ more, atol=1e-8)


def test_without_error_or_bias_the_command_is_that_for_the_nominal_input():
    u = command(make_dut(), make_plan(), NOMINAL, np.zeros(3))
    np.testing.assert_allclose(u, MODEL.command_for(INPUT), atol=1e-10)


def test_effective_commands_keep_to_the_limit():
    u = command(make_dut(limit=40.0), make_plan(), NOMINAL + 20 * ERROR)
    effective = MODEL.effective_command(u)
    assert np.max(np.abs(effective)) == pytest.approx(40.0)


@pytest.mark.parametrize("turns", [-1, 2])
def test_whole_turns_of_yaw_do_not_count(turns):
    dut, plan = make_dut(), make_plan()
    turned = NOMINAL + ERROR + [0, 0, 2 * np.pi * turns, 0, 0, 0]
    np.testing.assert_allclose(
        command(dut, plan, turned), command(dut, plan, NOMINAL + ERROR), atol=1e-8
    )


@pytest.mark.parametrize(
    ("plan", "state"),
    [
        (make_plan(status=SolveStatus.STOPPING), NOMINAL + ERROR),
        (make_plan(), np.full(6, np.nan)),
    ],
)
def test_nothing_is_added_while_stopping_or_without_a_state(plan, state):
    np.testing.assert_array_equal(command(make_dut(), plan, state), MODEL.command_for(INPUT))


@pytest.mark.parametrize("field", ["position_weight", "velocity_weight", "command_weight"])
@pytest.mark.parametrize("value", [np.zeros(3), np.ones(4), np.full(3, np.nan)])
def test_rejects_bad_config(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        make_dut(**{field: value})


def test_add_names_and_returns_the_system():
    builder = DiagramBuilder()
    dut = AddAncillaryLagged(
        builder, AncillaryLaggedConfig(), MODEL, period=0.1, input_limit=90.0, name="law"
    )
    assert isinstance(dut, AncillaryLagged)
    assert builder.Build().GetSubsystemByName("law") is dut
