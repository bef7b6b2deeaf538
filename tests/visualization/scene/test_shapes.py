import numpy as np
import pytest
from meshcat_spy import MeshcatSpy

from mirte_drake.geometry import ROLLER_AXES, WHEEL_POSITIONS, WHEEL_RADIUS
from mirte_drake.robots.mecanum_wheel import HUB_RADIUS, ROLLER_COUNT
from mirte_drake.robots.robot_description import robot_sdf
from mirte_drake.vectors import WHEELS
from mirte_drake.visualization.scene.shapes import draw_robot_shapes, read_robot_shapes


@pytest.fixture(scope="module")
def robot():
    return read_robot_shapes(robot_sdf())


def test_wheels_are_where_the_geometry_says(robot):
    assert tuple(robot.wheels) == WHEELS
    for X, position in zip(robot.wheels.values(), WHEEL_POSITIONS, strict=True):
        np.testing.assert_allclose(X.translation(), [*position, WHEEL_RADIUS], atol=1e-12)
        np.testing.assert_allclose(X.rotation().matrix(), np.eye(3), atol=1e-12)


def test_a_roller_moves_with_its_wheel(robot):
    for wheel, axis in zip(WHEELS, ROLLER_AXES, strict=True):
        rollers = [s for s in robot.shapes if s.part == wheel and "roller" in s.name]
        assert len(rollers) == ROLLER_COUNT
        distances = [np.linalg.norm(roller.X.translation()[[0, 2]]) for roller in rollers]
        np.testing.assert_allclose(distances, HUB_RADIUS, atol=1e-12)
        lowest = min(rollers, key=lambda roller: roller.X.translation()[2])
        assert abs(lowest.X.rotation().matrix()[:2, 0] @ axis) == pytest.approx(1.0)


def test_the_body_has_the_rest(robot):
    body = [shape for shape in robot.shapes if shape.part == "body"]
    assert {shape.name.split("/")[0] for shape in body} == {"base_link"}
    assert len({(shape.part, shape.name) for shape in robot.shapes}) == len(robot.shapes)
    orange = [s for s in body if "stripe" in s.name]
    assert orange and all(s.color.r() > 0.9 and s.color.b() < 0.2 for s in orange)


def test_all_shapes_are_drawn(robot):
    meshcat = MeshcatSpy()
    draw_robot_shapes(meshcat, "/robot", robot)
    for shape in robot.shapes:
        path = f"/robot/{shape.part}/{shape.name}"
        assert meshcat.HasPath(path)
        assert meshcat.transforms[path].IsExactlyEqualTo(shape.X)
