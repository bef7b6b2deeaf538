import dataclasses as dc

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from system_ports import port_table

from mirte_drake.control.dlqr import DlqrDesign
from mirte_drake.control.plan import Plan, SolveStatus
from mirte_drake.control.tracking_problem import TrackingData
from mirte_drake.systems.horizon_tube import AddHorizonTube, HorizonTube
from mirte_drake.systems.tube_updater import TubeUpdaterConfig

W_MAX = np.array([0.04, 0.03, 0.09])
A_CL = np.array([[0.5, -0.1, 0.0], [0.0, 0.4, 0.0], [0.0, 0.2, -0.3]])
HALF_WIDTH = np.array([0.1, 0.2, 0.3])


def design(closed_loop=A_CL, yaw=0.0) -> DlqrDesign:
    return DlqrDesign(yaw, np.zeros((4, 3)), closed_loop)


def plan(half_width=HALF_WIDTH, horizon=3) -> Plan:
    inputs = np.zeros((horizon, 4))
    states = np.zeros((horizon + 1, 3))
    data = TrackingData(np.zeros(3), states, half_width, inputs, inputs, np.zeros(4))
    return Plan(0, SolveStatus.SOLVED, "", states, inputs, data)


def make_dut(config=None, horizon=3) -> HorizonTube:
    return HorizonTube(config or TubeUpdaterConfig(), period=0.1, horizon=horizon)


def half_widths(dut, designs, plan=None) -> np.ndarray:
    context = dut.CreateDefaultContext()
    dut.GetInputPort("plan").FixValue(context, plan or globals()["plan"]())
    dut.GetInputPort("designs").FixValue(context, designs)
    return dut.GetOutputPort("half_widths").Eval(context).reshape(-1, 3)


def test_ports():
    inputs = {"plan": "abstract", "designs": "abstract"}
    assert port_table(make_dut(horizon=5)) == (inputs, {"half_widths": 18})


def test_begins_with_the_plan_and_follows_the_equation():
    widths = half_widths(make_dut(), (design(),))
    np.testing.assert_array_equal(widths[0], HALF_WIDTH)
    first = [0.5 * 0.1 + 0.1 * 0.2 + 0.004, 0.4 * 0.2 + 0.003, 0.2 * 0.2 + 0.3 * 0.3 + 0.009]
    np.testing.assert_allclose(widths[1], first, rtol=0, atol=1e-15)
    np.testing.assert_allclose(widths[2], np.abs(A_CL) @ first + 0.1 * W_MAX, rtol=0, atol=1e-15)
    assert len(widths) == 4


def test_each_stage_has_its_own_design_where_there_are_many():
    designs = tuple(design(k * A_CL) for k in (1.0, 0.5, 0.0))
    widths = half_widths(make_dut(), designs)
    np.testing.assert_allclose(widths[2], 0.5 * np.abs(A_CL) @ widths[1] + 0.1 * W_MAX, atol=1e-15)
    np.testing.assert_allclose(widths[3], 0.1 * W_MAX, atol=1e-15)


def test_the_bound_can_be_turned_with_the_robot():
    config = TubeUpdaterConfig(disturbance_frame="rotated")
    widths = half_widths(make_dut(config), (design(np.zeros((3, 3)), yaw=np.pi / 2),))
    np.testing.assert_allclose(widths[1], 0.1 * W_MAX[[1, 0, 2]], atol=1e-15)


def test_contexts_are_independent():
    dut = make_dut()
    one = half_widths(dut, (design(),))
    other = half_widths(dut, (design(),), plan(half_width=np.zeros(3)))
    np.testing.assert_array_equal(one, half_widths(dut, (design(),)))
    np.testing.assert_allclose(other[1], 0.1 * W_MAX, atol=1e-15)


def test_rejects_a_bad_config():
    with pytest.raises(ValueError, match=r"^disturbance_bound: "):
        make_dut(dc.replace(TubeUpdaterConfig(), disturbance_bound=-np.ones(3)))


def test_add_names_and_returns_the_system():
    builder = DiagramBuilder()
    dut = AddHorizonTube(builder, TubeUpdaterConfig(), period=0.1, horizon=3, name="ahead")
    assert isinstance(dut, HorizonTube)
    assert builder.Build().GetSubsystemByName("ahead") is dut
