import dataclasses as dc

import numpy as np
import pytest
from meshcat_spy import MeshcatSpy
from projection import seen_at
from pydrake.systems.analysis import Simulator

from mirte_drake.angles import rotation
from mirte_drake.assembly import MakeDiagram
from mirte_drake.geometry import body_velocity
from mirte_drake.live_view import LiveView, floor_patches, scene_stage
from mirte_drake.robots.floor import FrictionPatch
from mirte_drake.robots.multibody_robot import MultibodyRobotConfig
from mirte_drake.robots.names import ROBOTS, robot_override
from mirte_drake.run import simulate
from mirte_drake.scenario import Scenario
from mirte_drake.scenario_file import load_scenario, scenario_names
from mirte_drake.systems.velocity_setpoint import VelocitySetpointConfig
from mirte_drake.visualization.live_disturbance import PUSH, PUSH_BUTTON, SIZE_SLIDER


def watched(scenario):
    """Returns a Diagram with its view, advanced through its first sample, and Meshcat."""
    meshcat = MeshcatSpy()
    simulator = Simulator(MakeDiagram(scenario, view=LiveView(scenario, meshcat)))
    simulator.get_mutable_integrator().set_target_accuracy(scenario.accuracy)
    simulator.Initialize()
    simulator.AdvancePendingEvents()
    return simulator, meshcat


def frame(simulator):
    scene = simulator.get_system().GetSubsystemByName("meshcat_scene")
    return scene.frame(scene.GetMyContextFromRoot(simulator.get_context()))


def names(diagram) -> set[str]:
    return {system.get_name() for system in diagram.GetSystems()}


def outputs(diagram) -> set[str]:
    return {diagram.get_output_port(i).get_name() for i in range(diagram.num_output_ports())}


@pytest.mark.parametrize("name", scenario_names())
def test_every_scenario_can_be_watched(name):
    scenario = load_scenario(name)
    simulator, meshcat = watched(scenario)
    plain = MakeDiagram(scenario)
    assert outputs(simulator.get_system()) == outputs(plain)
    tube = set()
    if scenario.has_tube:
        tube = {"held_tube" if scenario.tube_updater is None else "horizon_tube"}
    assert names(simulator.get_system()) - names(plain) == {
        *("meshcat_scene", "live_disturbance", "wheel_speeds", "wheel_angles", *tube)
    }
    simulator.AdvanceTo(0.25)
    assert meshcat.HasPath("/mirte/trail/measured/2")
    assert np.any(frame(simulator).half_widths > 0) == bool(tube)


@pytest.mark.parametrize("name", scenario_names())
def test_the_first_camera_sees_the_robot_anywhere_on_its_path(name):
    scenario = load_scenario(name)
    _, meshcat = watched(scenario)
    path = scenario.reference.poses(scenario.period)
    corners = np.array([[x, y] for x in (-0.15, 0.15) for y in (-0.2, 0.2)])
    around = np.concatenate([path[:, :2] + (rotation(path[:, 2])[:, :2, :2] @ c) for c in corners])
    points = np.vstack([np.column_stack([around, np.full(len(around), z)]) for z in (0.0, 0.3)])
    places = seen_at(points, *meshcat.camera)
    assert np.all(np.abs(places) < 1)
    assert np.max(np.ptp(places, axis=0)) > 1.2  # Near enough, too.


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_robot_can_be_watched_and_drives_as_it_would_alone(robot):
    scenario = load_scenario("circle", [robot_override(robot), "duration=0.6"])
    log = simulate(scenario, "").log
    simulator, _ = watched(scenario)
    simulator.AdvanceTo(0.6)
    shown = frame(simulator)
    # Not to the last bit: an integrator of variable step stops for every picture.
    np.testing.assert_allclose(shown.pose, log["pose"][-1], atol=1e-4)
    np.testing.assert_allclose(shown.true_pose, log["true_pose"][-1], atol=1e-4)
    np.testing.assert_allclose(shown.reference, log["reference"][-1], atol=1e-12)
    # Before the solve of this instant: the plan of the last sample, moved on to its successor.
    np.testing.assert_allclose(shown.plan[0], log["nominal_next"][-2], atol=1e-4)
    np.testing.assert_allclose(shown.half_widths[0], log["half_width"][-1], atol=1e-4)
    np.testing.assert_allclose(shown.wheel_command, log["applied_input"][-2], atol=0.5)
    # What the wheels did is what odometry, or a pose without slip, says; the heading is constant.
    moved = log["pose"][-1] - log["pose"][0]
    np.testing.assert_allclose(body_velocity(shown.wheel_angles), moved, atol=2e-3)
    assert np.max(np.abs(shown.wheel_angles)) > 0.3


def test_the_tube_ahead_is_the_one_that_comes():
    scenario = load_scenario("rectangle", ["duration=1", "disturbance=!NoDisturbance {}"])
    log = simulate(scenario, "").log
    simulator, _ = watched(scenario)
    simulator.AdvanceTo(0.5)
    simulator.AdvancePendingEvents()
    ahead = frame(simulator).half_widths
    np.testing.assert_allclose(ahead[0], log["half_width"][5], atol=1e-6)
    np.testing.assert_allclose(ahead[5], log["half_width"][10], rtol=0.05)


def test_a_push_moves_the_robot_and_the_slider_scales_the_disturbance():
    scenario = load_scenario(
        "rectangle", ["disturbance=!ConstantDisturbance {value: [0, 0.01, 0]}"]
    )
    simulator, meshcat = watched(scenario)
    port = simulator.get_system().GetOutputPort("disturbance")
    np.testing.assert_allclose(port.Eval(simulator.get_context()), [0, 0.01, 0])
    meshcat.SetSliderValue(SIZE_SLIDER, 2.0)
    meshcat.click(PUSH_BUTTON)
    simulator.AdvanceTo(0.1)
    before = frame(simulator).true_pose
    simulator.AdvanceTo(0.15)
    pushed = port.Eval(simulator.get_context())
    np.testing.assert_allclose(pushed, [0, 0.02 + PUSH / 0.1, 0], atol=1e-12)
    simulator.AdvanceTo(0.2)
    assert frame(simulator).true_pose[1] - before[1] == pytest.approx(PUSH, abs=0.01)
    simulator.AdvanceTo(0.25)
    np.testing.assert_allclose(port.Eval(simulator.get_context()), [0, 0.02, 0])


def test_a_robot_that_only_its_floor_disturbs_has_no_controls_for_it():
    scenario = load_scenario("rectangle", [robot_override("multibody")])
    simulator, meshcat = watched(scenario)
    assert "live_disturbance" not in names(simulator.get_system())
    assert meshcat.GetButtonNames() == [] and meshcat.GetSliderNames() == []
    np.testing.assert_array_equal(frame(simulator).disturbance, np.zeros(3))


def test_the_stage_holds_path_start_and_patches():
    robot = MultibodyRobotConfig(
        initial_pose=np.array([4.0, 5.0, 0.0]), patches=[FrictionPatch(np.ones(2))]
    )
    stage = scene_stage(Scenario(robot=robot), "dark")
    assert stage.background == "dark" and len(stage.path) == 251
    np.testing.assert_array_equal(stage.places, [[4.0, 5.0]])
    np.testing.assert_array_equal(stage.patches[0].center, np.ones(2))
    assert floor_patches(Scenario()) == []


def test_a_setpoint_has_room_but_no_path():
    reference = VelocitySetpointConfig(start=np.array([1.0, 2.0, 0.0]))
    scenario = dc.replace(Scenario(), reference=reference, duration=1.0)
    stage = scene_stage(scenario)
    assert stage.path.shape == (0, 2)
    np.testing.assert_array_equal(stage.places, [[0.0, 1.0], [2.0, 3.0]])
    simulator, _ = watched(scenario)
    simulator.AdvanceTo(0.25)
