from types import SimpleNamespace

import numpy as np
import pytest
from meshcat_spy import MeshcatSpy
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from system_ports import port_table

from mirte_drake.robots.robot_description import robot_sdf
from mirte_drake.visualization.meshcat_scene import LONGEST_TRAIL, AddMeshcatScene, MeshcatScene
from mirte_drake.visualization.scene.shapes import read_robot_shapes
from mirte_drake.visualization.scene.stage import Stage

HORIZON = 2
STAGE = Stage(np.zeros((0, 2)), np.zeros((1, 2)))
STATES = np.array([[1.0, 0.0, 0.0], [1.1, 0.2, 0.0], [1.2, 0.4, 0.0]])
WIDTHS = np.array([[0.01, 0.02, 0.03], [0.02, 0.02, 0.03], [0.04, 0.02, 0.03]])
VALUES = {
    "pose": [1.0, 2.0, 0.1],
    "true_pose": [1.1, 2.1, 0.2],
    "reference": [3.0, 4.0, 0.0],
    "wheel_command": [1.0, 2.0, 3.0, 4.0],
    "wheel_angles": [5.0, 6.0, 7.0, 8.0],
    "half_widths": WIDTHS.ravel(),
    "disturbance": [0.1, 0.2, 0.3],
}


@pytest.fixture(scope="module")
def robot():
    return read_robot_shapes(robot_sdf())


@pytest.fixture
def meshcat():
    return MeshcatSpy()


@pytest.fixture
def dut(meshcat, robot):
    builder = DiagramBuilder()
    dut = AddMeshcatScene(builder, meshcat, STAGE, robot, period=0.1, horizon=HORIZON)
    builder.Build()  # It owns the system.
    return dut


def plan(sample=0):
    return SimpleNamespace(sample=sample, states=STATES)


def context_of(dut, *, sample=0, open_ports=(), **values):
    context = dut.CreateDefaultContext()
    for name, value in {**VALUES, "plan": AbstractValue.Make(plan(sample)), **values}.items():
        if name not in open_ports:
            dut.GetInputPort(name).FixValue(context, value)
    return context


def simulator_of(dut, **values) -> Simulator:
    return Simulator(dut, context_of(dut, **values))


def test_ports(dut):
    assert port_table(dut) == (
        {
            **{"pose": 3, "true_pose": 3, "reference": 3, "plan": "abstract"},
            **{"wheel_command": 4, "wheel_angles": 4, "half_widths": 9, "disturbance": 3},
        },
        {},
    )


def test_a_frame_has_what_the_ports_have(dut):
    frame = dut.frame(context_of(dut))
    for name in ("pose", "true_pose", "reference", "wheel_command", "wheel_angles", "disturbance"):
        np.testing.assert_array_equal(getattr(frame, name), VALUES[name])
    np.testing.assert_array_equal(frame.plan, STATES)
    np.testing.assert_array_equal(frame.half_widths, WIDTHS)


def test_between_samples_plan_and_tube_move_on_along_themselves(dut):
    context = context_of(dut, sample=4)
    context.SetTime(0.425)
    frame = dut.frame(context)
    np.testing.assert_allclose(frame.plan, [[1.025, 0.05, 0], [1.125, 0.25, 0], [1.2, 0.4, 0]])
    np.testing.assert_allclose(frame.half_widths[:, 0], [0.0125, 0.025, 0.04])
    # What is drawn at a sample is drawn before its solve: the plan's next stage is now.
    context.SetTime(0.5)
    np.testing.assert_allclose(dut.frame(context).plan[0], STATES[1])
    context.SetTime(0.9)
    np.testing.assert_allclose(dut.frame(context).plan[0], STATES[1])


def test_open_ports_mean_no_tube_and_no_disturbance(dut):
    frame = dut.frame(context_of(dut, open_ports=("half_widths", "disturbance")))
    np.testing.assert_array_equal(frame.half_widths, np.zeros((3, 3)))
    np.testing.assert_array_equal(frame.disturbance, np.zeros(3))


def test_without_a_plan_it_is_where_the_robot_is(dut):
    context = context_of(dut, open_ports=("plan", "half_widths"))
    np.testing.assert_array_equal(dut.frame(context).plan, [VALUES["pose"]] * 3)
    left, dut._drawer.leave = [], lambda trail, index: left.append(trail)
    Simulator(dut, context).AdvanceTo(0.15)
    np.testing.assert_array_equal(left[0].nominal, [[VALUES["pose"]] * 2])
    assert not np.any(left[0].half_widths)


def test_before_the_first_solve_the_plan_is_where_the_robot_is(dut):
    frame = dut.frame(context_of(dut, sample=-1))
    np.testing.assert_array_equal(frame.plan, [VALUES["pose"]] * 3)
    np.testing.assert_array_equal(frame.half_widths, np.zeros((3, 3)))


def test_draws_three_times_in_a_sample(meshcat, dut):
    simulator, drawn = simulator_of(dut), []
    dut._drawer.draw = lambda frame: drawn.append(simulator.get_context().get_time())
    simulator.AdvanceTo(0.25)
    np.testing.assert_allclose(drawn, np.arange(8) / 30, atol=1e-12)


def test_trails_lead_from_sample_to_sample(meshcat, dut):
    simulator = simulator_of(dut)
    left = []
    dut._drawer.leave = lambda trail, index: left.append((index, trail))
    for k in range(3):
        simulator.AdvanceTo(0.1 * k + 0.05)
        dut.GetInputPort("pose").FixValue(simulator.get_mutable_context(), [k + 1.0, 0, 0])
        dut.GetInputPort("true_pose").FixValue(simulator.get_mutable_context(), [k + 5.0, 0, 0])
    assert [index for index, _ in left] == [1, 2]
    np.testing.assert_array_equal(left[1][1].poses, [[1, 0, 0], [2, 0, 0]])
    np.testing.assert_array_equal(left[1][1].true_poses, [[5, 0, 0], [6, 0, 0]])
    np.testing.assert_array_equal(left[1][1].nominal, [STATES[:2]])
    np.testing.assert_array_equal(left[1][1].half_widths, [WIDTHS[:2]])


def test_a_long_run_takes_the_place_of_its_oldest_trail(meshcat, dut):
    simulator = simulator_of(dut)
    dut._drawer.draw = lambda frame: None
    left = []
    dut._drawer.leave = lambda trail, index: left.append(index)
    simulator.AdvanceTo(0.1 * (LONGEST_TRAIL + 2) + 0.05)
    assert len(left) == LONGEST_TRAIL + 2
    assert len(set(left)) == LONGEST_TRAIL and left[-1] == left[1] == 2


def test_beginning_anew_removes_the_trails(meshcat, dut):
    simulator = simulator_of(dut)
    simulator.AdvanceTo(0.05)
    dut.GetInputPort("pose").FixValue(simulator.get_mutable_context(), [9.0, 0, 0])
    simulator.AdvanceTo(0.15)
    assert meshcat.HasPath("/mirte/trail/measured/1")
    simulator.reset_context(context_of(dut))
    simulator.Initialize()
    assert not meshcat.HasPath("/mirte/trail")


def test_contexts_are_independent(dut):
    one, other = simulator_of(dut), simulator_of(dut, pose=[7.0, 8.0, 9.0])
    one.AdvanceTo(0.15)
    other.AdvanceTo(0.05)
    state = one.get_context().get_discrete_state_vector().value()
    np.testing.assert_array_equal(state, [*VALUES["pose"], *VALUES["true_pose"]])
    state = other.get_context().get_discrete_state_vector().value()
    np.testing.assert_array_equal(state[:3], [7.0, 8.0, 9.0])
    np.testing.assert_array_equal(dut.frame(other.get_context()).pose, [7.0, 8.0, 9.0])


def test_add_names_and_returns_the_system(meshcat, robot):
    builder = DiagramBuilder()
    dut = AddMeshcatScene(
        builder, meshcat, STAGE, robot, period=0.1, horizon=HORIZON, name="picture"
    )
    assert isinstance(dut, MeshcatScene)
    assert builder.Build().GetSubsystemByName("picture") is dut
    assert meshcat.HasPath("/mirte/robot/body")
