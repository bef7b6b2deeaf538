import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from system_ports import port_table

from mirte_drake.control.plan import Plan, SolveStatus
from mirte_drake.control.tracking_problem import TrackingData
from mirte_drake.systems.held_tube import AddHeldTube, HeldTube

NOW, NEXT = np.arange(6.0), 10 + np.arange(6.0)


def plan(half_width) -> Plan:
    inputs, states = np.zeros((2, 4)), np.zeros((3, len(half_width)))
    data = TrackingData(states[0], states[:, :3], half_width, inputs, inputs, np.zeros(4))
    return Plan(0, SolveStatus.SOLVED, "", states, inputs, data)


def test_ports():
    inputs = {"plan": "abstract", "half_width": 6}
    assert port_table(HeldTube(horizon=5, states=6)) == (inputs, {"half_widths": 18})


@pytest.mark.parametrize("states", [3, 6])
def test_the_next_half_width_is_held_over_the_plan(states):
    dut = HeldTube(horizon=2, states=states)
    context, other = dut.CreateDefaultContext(), dut.CreateDefaultContext()
    for each, factor in ((context, 1.0), (other, 2.0)):
        dut.GetInputPort("plan").FixValue(each, plan(factor * NOW[:states]))
        dut.GetInputPort("half_width").FixValue(each, factor * NEXT[:states])
    for each, factor in ((context, 1.0), (other, 2.0)):
        widths = dut.GetOutputPort("half_widths").Eval(each).reshape(-1, 3)
        np.testing.assert_array_equal(widths, factor * np.array([NOW[:3], NEXT[:3], NEXT[:3]]))


def test_add_names_and_returns_the_system():
    builder = DiagramBuilder()
    added = AddHeldTube(builder, horizon=2, states=3)
    assert added.get_name() == "held_tube" and added in builder.GetSystems()
