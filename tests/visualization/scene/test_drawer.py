import dataclasses as dc

import numpy as np
import pytest
from meshcat_spy import MeshcatSpy
from pydrake.geometry import Box, Cylinder

from mirte_drake.geometry import WHEEL_RADIUS
from mirte_drake.robots.robot_description import robot_sdf
from mirte_drake.vectors import WHEELS
from mirte_drake.visualization.scene.display import ARROW_TIME, LONGEST_ARROW, shown_stages
from mirte_drake.visualization.scene.drawer import SceneDrawer
from mirte_drake.visualization.scene.frame import Frame, Trail
from mirte_drake.visualization.scene.robot import BAR_LENGTH
from mirte_drake.visualization.scene.shapes import read_robot_shapes
from mirte_drake.visualization.scene.stage import Patch, Stage

HORIZON = 10
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]])
STAGE = Stage(SQUARE, np.zeros((1, 2)), [Patch(np.array([0.5, 0.5]), np.array([0.4, 0.2]))])
FRAME = Frame(
    pose=np.array([0.1, 0.2, 0.3]),
    true_pose=np.array([0.12, 0.18, np.pi / 2]),
    reference=np.array([0.15, 0.25, 0.0]),
    plan=np.array([[0.1 + 0.01 * i, 0.2, 0.0] for i in range(HORIZON + 1)]),
    half_widths=np.array([[0.01 + 0.001 * i, 0.02, 0.03] for i in range(HORIZON + 1)]),
    disturbance=np.array([0.03, 0.04, 0.5]),
    wheel_command=np.array([50.0, -25.0, 0.0, 100.0]),
    wheel_angles=np.array([0.5, -1.0, 2.0, 7.0]),
)
TRAIL = Trail(
    poses=np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]),
    true_poses=np.array([[0.0, 0.0, 0.0], [0.1, 0.05, 0.0]]),
    nominal=np.array([[[0.0, 0.01, 0.0], [0.1, 0.01, 0.0]]]),
    half_widths=np.array([[[0.01, 0.02, 0.03], [0.01, 0.02, 0.03]]]),
)


@pytest.fixture(scope="module")
def robot():
    return read_robot_shapes(robot_sdf())


@pytest.fixture
def meshcat():
    return MeshcatSpy()


@pytest.fixture
def drawer(meshcat, robot):
    return SceneDrawer(meshcat, STAGE, robot, HORIZON)


def changed(**values) -> Frame:
    return dc.replace(FRAME, **{name: np.array(value) for name, value in values.items()})


def test_all_is_there(meshcat, drawer):
    drawer.draw(FRAME)
    drawer.leave(TRAIL, 7)
    for path in (
        *("floor/plate", "floor/fine", "floor/coarse", "floor/patch_0", "reference/path"),
        *("reference/now", "robot/body", "pose/pin", "plan/stage_1", "plan/stage_10"),
        *("tube/now", "tube/stage_10", "disturbance", "trail/measured/7", "trail/true/7"),
        "trail/swept_tube/7",
        *(f"robot/{wheel}" for wheel in WHEELS),
        *(f"robot/commands/{wheel}/forward/filling" for wheel in WHEELS),
    ):
        assert meshcat.HasPath(f"/mirte/{path}"), path
    for path in ("/Grid", "/Axes"):  # The floor has a grid of its own.
        assert meshcat.properties[path, "visible"] is False


def test_the_robot_is_where_it_really_is(meshcat, drawer):
    drawer.draw(FRAME)
    X = meshcat.transforms["/mirte/robot"]
    np.testing.assert_allclose(X.translation(), [0.12, 0.18, 0.0])
    np.testing.assert_allclose(X.rotation().matrix()[:, 0], [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(meshcat.properties["/mirte/pose", "position"], [0.1, 0.2, 0.0])


def test_wheels_turn_by_their_angle_and_roll_forward(meshcat, drawer):
    drawer.draw(FRAME)
    for wheel, angle in zip(WHEELS, FRAME.wheel_angles, strict=True):
        X = meshcat.transforms[f"/mirte/robot/{wheel}"]
        # By hand: a point on top of a wheel that turns forward by theta goes to sin(theta)
        # ahead and cos(theta) up.
        top = X @ np.array([0.0, 0.0, 0.03]) - X.translation()
        np.testing.assert_allclose(top, [0.03 * np.sin(angle), 0, 0.03 * np.cos(angle)], atol=1e-12)
        assert X.translation()[2] == pytest.approx(WHEEL_RADIUS)


def test_the_tube_has_its_size_at_every_stage_that_is_shown(meshcat, drawer):
    drawer.draw(FRAME)
    assert [path for path in meshcat.objects if path.startswith("/mirte/tube")] == [
        "/mirte/tube/now/box",
        *(f"/mirte/tube/stage_{stage}/box" for stage in (2, 4, 6, 8, 10)),
    ]
    for name, stage in (("now", 0), ("stage_2", 2), ("stage_10", 10)):
        shape, color = meshcat.objects[f"/mirte/tube/{name}/box"]
        assert isinstance(shape, Box) and 0.1 < color.a() < 0.5
        scale = meshcat.properties[f"/mirte/tube/{name}", "scale"]
        np.testing.assert_allclose(
            np.array(scale[:2]) * shape.size()[:2], [2 * (0.01 + 0.001 * stage), 0.04]
        )
        middle = meshcat.properties[f"/mirte/tube/{name}", "position"]
        np.testing.assert_allclose(middle[:2], [0.1 + 0.01 * stage, 0.2])
        assert middle[2] > 0.19  # Above the robot.


def test_plan_and_reference_are_at_the_level_of_the_pose(meshcat, drawer):
    drawer.draw(FRAME)
    head = meshcat.transforms["/mirte/pose/head"].translation()[2]
    for stage in range(1, 11):
        bead = meshcat.properties[f"/mirte/plan/stage_{stage}", "position"]
        np.testing.assert_allclose(bead, [0.1 + 0.01 * stage, 0.2, head])
    reference = meshcat.properties["/mirte/reference/now", "position"]
    np.testing.assert_allclose(reference, [0.15, 0.25, head])


def test_without_a_tube_no_box_is_seen(meshcat, drawer):
    drawer.draw(changed(half_widths=np.zeros((HORIZON + 1, 3))))
    for (path, name), value in meshcat.properties.items():
        if path.startswith("/mirte/tube") and name == "scale":
            assert max(value[:2]) <= 1e-3


def test_bars_fill_with_the_command_of_their_wheel(meshcat, drawer):
    drawer.draw(FRAME)
    shape, _ = meshcat.objects["/mirte/robot/commands/front_left/forward/filling"]
    assert isinstance(shape, Cylinder) and shape.length() == BAR_LENGTH
    filled = {
        (wheel, direction): meshcat.properties[
            f"/mirte/robot/commands/{wheel}/{direction}", "scale"
        ][2]
        for wheel in WHEELS
        for direction in ("forward", "backward")
    }
    full = {key: share for key, share in filled.items() if share > 1e-3}
    assert full == {
        ("front_left", "forward"): 0.5,
        ("front_right", "backward"): 0.25,
        ("rear_left", "forward"): 1.0,
    }


def test_the_arrow_points_where_the_disturbance_goes(meshcat, drawer):
    drawer.draw(FRAME)
    # Body frame (0.03, 0.04) on a robot that looks along y: (-0.04, 0.03) in the world.
    X, scale = (
        meshcat.transforms["/mirte/disturbance"],
        meshcat.properties["/mirte/disturbance", "scale"],
    )
    tip = X.rotation().matrix()[:, 0] * scale[0]
    np.testing.assert_allclose(tip, ARROW_TIME * np.array([-0.04, 0.03, 0.0]), atol=1e-12)
    np.testing.assert_allclose(X.translation()[:2], [0.12, 0.18])
    drawer.draw(changed(disturbance=[3.0, 4.0, 0.0]))
    assert meshcat.properties["/mirte/disturbance", "scale"] == [LONGEST_ARROW] * 3


def test_trails_lie_on_the_floor_one_above_the_other(meshcat, drawer):
    drawer.leave(TRAIL, 0)
    swept, true, measured = (
        meshcat.meshes[f"/mirte/trail/{name}/0"][0] for name in ("swept_tube", "true", "measured")
    )
    np.testing.assert_allclose(swept[:2].min(axis=1), [-0.01, -0.01])
    np.testing.assert_allclose(swept[:2].max(axis=1), [0.11, 0.03])
    np.testing.assert_allclose([measured[0].min(), measured[0].max()], [0.0, 0.1], atol=1e-12)
    assert np.ptp(measured[1]) < 0.01 < np.ptp(true[1])
    path = meshcat.meshes["/mirte/reference/path"][0]
    assert 0 < swept[2, 0] < path[2, 0] < true[2, 0] < measured[2, 0] < 0.01


def test_a_true_pose_that_is_the_measured_one_has_no_trail_of_its_own(meshcat, drawer):
    drawer.leave(dc.replace(TRAIL, true_poses=TRAIL.poses), 0)
    assert "/mirte/trail/measured/0" in meshcat.meshes
    assert "/mirte/trail/true/0" not in meshcat.meshes


def test_a_piece_takes_the_place_of_an_earlier_one_also_where_there_is_nothing(meshcat, drawer):
    drawer.leave(TRAIL, 0)
    still = Trail(*(0 * getattr(TRAIL, field.name) for field in dc.fields(TRAIL)))
    drawer.leave(still, 0)
    for name in ("measured", "true", "swept_tube"):
        assert not meshcat.HasPath(f"/mirte/trail/{name}/0")


def test_trails_can_be_removed(meshcat, drawer):
    drawer.leave(TRAIL, 0)
    drawer.forget()
    assert not meshcat.HasPath("/mirte/trail/measured/0")
    drawer.leave(TRAIL, 0)
    assert meshcat.HasPath("/mirte/trail/measured/0")


def test_the_floor_bears_robot_and_patches_wherever_they_are(meshcat, robot):
    places = np.array([[5.0, -3.0]])
    SceneDrawer(meshcat, dc.replace(STAGE, places=places), robot, HORIZON)
    plate, _ = meshcat.objects["/mirte/floor/plate"]
    middle = meshcat.transforms["/mirte/floor/plate"].translation()
    lower, upper = middle[:2] - plate.size()[:2] / 2, middle[:2] + plate.size()[:2] / 2
    assert np.all(lower <= [-0.25, -3.25]) and np.all(upper >= [5.25, 1.25])
    assert middle[2] + plate.size()[2] / 2 == 0.0
    patch = meshcat.meshes["/mirte/floor/patch_0"][0]
    np.testing.assert_allclose(patch[:2].min(axis=1), [0.3, 0.4])
    np.testing.assert_allclose(patch[:2].max(axis=1), [0.7, 0.6])


def test_a_patch_larger_than_the_floor_ends_with_it_and_one_beside_it_is_left_out(meshcat, robot):
    large = Patch(np.zeros(2), np.full(2, 100.0))
    beside = Patch(np.array([50.0, 0.0]), np.ones(2))
    SceneDrawer(meshcat, dc.replace(STAGE, patches=[large, beside]), robot, HORIZON)
    assert np.ptp(meshcat.meshes["/mirte/floor/patch_0"][0][0]) < 3
    assert "/mirte/floor/patch_1" not in meshcat.meshes


def test_a_robot_without_a_known_path_has_a_floor(meshcat, robot):
    stage = Stage(np.zeros((0, 2)), np.array([[-1.0, -1.0], [1.0, 1.0]]))
    SceneDrawer(meshcat, stage, robot, HORIZON).draw(FRAME)
    assert "/mirte/reference/path" not in meshcat.meshes
    assert meshcat.objects["/mirte/floor/plate"][0].size()[0] > 2


@pytest.mark.parametrize("size", [1.0, 30.0, 1000.0])
def test_a_large_floor_has_lines_that_are_seen_and_not_too_many(size, meshcat, robot):
    drawer = SceneDrawer(meshcat, dc.replace(STAGE, path=size * SQUARE), robot, HORIZON)
    plate, _ = meshcat.objects["/mirte/floor/plate"]
    for name in ("floor/fine", "floor/coarse", "reference/path"):
        assert 4 <= meshcat.meshes[f"/mirte/{name}"][1].shape[1] < 5000
    drawer.leave(TRAIL, 0)
    trail = meshcat.meshes["/mirte/trail/measured/0"][0]
    assert np.ptp(trail[1]) >= plate.size()[0] / 600
    position, target = meshcat.camera
    far = meshcat.properties["/Cameras/default/rotated/<object>", "far"]
    assert far > 2 * np.linalg.norm(position - target)


def test_light_and_dark(meshcat, robot):
    brightness = {}
    for background in ("light", "dark"):
        SceneDrawer(meshcat, dc.replace(STAGE, background=background), robot, HORIZON)
        brightness[background] = [
            sum(meshcat.properties["/Background/<object>", edge])
            for edge in ("top_color", "bottom_color")
        ]
    assert min(brightness["light"]) > 2.5 > 0.6 > max(brightness["dark"])


@pytest.mark.parametrize(
    ("horizon", "most", "stages"),
    [
        (10, 10, [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]),
        (10, 5, [2, 4, 6, 8, 10]),
        (1, 10, [1]),
        (3, 10, [1, 2, 3]),
        (55, 5, [11, 22, 33, 44, 55]),
    ],
)
def test_a_long_horizon_is_thinned_out(horizon, most, stages):
    assert shown_stages(horizon, most).tolist() == stages


@pytest.mark.parametrize("horizon", [1, 55])
def test_any_horizon_can_be_drawn(horizon, meshcat, robot):
    drawer = SceneDrawer(meshcat, STAGE, robot, horizon)
    drawer.draw(changed(plan=np.ones((horizon + 1, 3)), half_widths=np.ones((horizon + 1, 3))))
    assert meshcat.properties[f"/mirte/tube/stage_{horizon}", "scale"][:2] == [2.0, 2.0]


def test_a_recording_has_every_move_and_shows_trails_when_they_are_there(meshcat, drawer):
    meshcat.StartRecording(10, set_visualizations_while_recording=False)
    for k in range(3):
        drawer.draw(FRAME, 0.1 * k)
    drawer.leave(TRAIL, 0, (0.1, 0.5))
    moving = {path for path, _ in meshcat.recorded if not path.startswith("/mirte/trail")}
    assert {"/mirte/robot", "/mirte/robot/front_left", "/mirte/tube/now", "/mirte/pose"} <= moving
    for (path, _), moves in meshcat.recorded.items():
        if path in moving:
            np.testing.assert_allclose([time for time, _ in moves], [0, 0.1, 0.2])
    shown = meshcat.recorded["/mirte/trail/measured/0", "visible"]
    assert shown == [(0.0, False), (0.1, True), (0.5, True)]
