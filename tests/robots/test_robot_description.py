from xml.etree import ElementTree

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    DiscreteContactApproximation,
    MultibodyPlant,
)
from pydrake.multibody.tree import RpyFloatingJoint
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from mirte_drake.errors import UserError
from mirte_drake.geometry import PWM_SPEED, ROLLER_AXES, WHEEL_POSITIONS, WHEEL_RADIUS
from mirte_drake.robots.chassis import BASE_MASS
from mirte_drake.robots.floor import add_floor
from mirte_drake.robots.mecanum_wheel import ROLLER_COUNT, WHEEL_MASS
from mirte_drake.robots.robot_description import STALL_TORQUE, robot_sdf, write_robot_sdf
from mirte_drake.vectors import WHEELS


@pytest.fixture(scope="module")
def plant() -> MultibodyPlant:
    plant = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.005)[0]
    Parser(plant).AddModelsFromString(robot_sdf(), "sdf")
    plant.Finalize()
    return plant


def test_masses_are_those_of_the_robot(plant):
    total = plant.CalcTotalMass(plant.CreateDefaultContext())
    assert total == pytest.approx(BASE_MASS + 4 * WHEEL_MASS, rel=1e-12)
    assert total == pytest.approx(13.6)


def test_each_wheel_has_a_motor_and_free_rollers(plant):
    robot = plant.GetModelInstanceByName("mirte_master")
    joints = [plant.get_joint(i) for i in plant.GetJointIndices(robot)]
    revolute = [joint for joint in joints if joint.type_name() == "revolute"]
    assert len(revolute) == 4 * (1 + ROLLER_COUNT)
    actuators = [plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices(robot)]
    assert [actuator.joint().name() for actuator in actuators] == list(WHEELS)
    assert [actuator.effort_limit() for actuator in actuators] == [STALL_TORQUE] * 4
    assert all(actuator.has_controller() for actuator in actuators)


def test_wheels_and_their_lowest_rollers_lie_as_the_geometry_says(plant):
    context = plant.CreateDefaultContext()
    base = plant.GetFrameByName("base_link").CalcPoseInWorld(context)
    for wheel, position, axis in zip(WHEELS, WHEEL_POSITIONS, ROLLER_AXES, strict=True):
        hub = plant.GetFrameByName(f"{wheel}_wheel").CalcPose(
            context, plant.GetFrameByName("base_link")
        )
        np.testing.assert_allclose(hub.translation(), [*position, WHEEL_RADIUS], atol=1e-12)
        poses = [
            base.inverse() @ plant.GetFrameByName(f"{wheel}_roller_{i}").CalcPoseInWorld(context)
            for i in range(ROLLER_COUNT)
        ]
        lowest = min(poses, key=lambda pose: pose.translation()[2])
        along = lowest.rotation().matrix()[:, 0]
        np.testing.assert_allclose(np.abs(along @ [*axis, 0.0]), 1.0, atol=1e-9)


def test_file_is_self_contained(tmp_path):
    path = tmp_path / "robot.sdf"
    write_robot_sdf(path)
    tags = {element.tag for element in ElementTree.parse(path).iter()}
    assert not tags & {"mesh", "uri", "include"}
    assert "ellipsoid" in tags


def test_file_loads_back_and_drives(tmp_path):
    path = tmp_path / "robot.sdf"
    write_robot_sdf(path)
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.005)
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kLagged)
    (robot,) = Parser(plant).AddModels(path)
    base = plant.GetFrameByName("base_link")
    plant.AddJoint(RpyFloatingJoint("floating_base", plant.world_frame(), base))
    add_floor(plant, 0.8, [])
    plant.Finalize()
    assert plant.num_joints() == 1 + 4 * (1 + ROLLER_COUNT)
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    assert plant.CalcTotalMass(context) == pytest.approx(BASE_MASS + 4 * WHEEL_MASS, rel=1e-12)
    desired = [*np.zeros(4), *np.full(4, 50 * PWM_SPEED)]
    plant.get_desired_state_input_port(robot).FixValue(context, desired)
    simulator.AdvanceTo(1.0)
    velocity = plant.GetBodyByName("base_link").EvalSpatialVelocityInWorld(context).translational()
    ideal = 50 * PWM_SPEED * WHEEL_RADIUS
    np.testing.assert_allclose(velocity, [ideal, 0.0, 0.0], atol=0.03 * ideal)


def test_text_is_the_same_each_time():
    assert robot_sdf() == robot_sdf()


def test_reports_a_file_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot be written"):
        write_robot_sdf(tmp_path / "file" / "robot.sdf")
