import numpy as np
import pytest
from projection import seen_at

from mirte_drake.visualization.scene.camera import MARGINS, camera_pose


@pytest.mark.parametrize("seed", range(20))
def test_everything_is_seen_and_no_camera_is_nearer(seed):
    generator = np.random.default_rng(seed)
    size = generator.uniform([0.1, 0.1, 0.0], [5.0, 5.0, 0.4])
    points = generator.uniform(-1, 1, (30, 3)) * size + generator.uniform(-3, 3, 3)
    places = seen_at(points, *camera_pose(points))
    side, below, above = 1 - np.array(MARGINS)
    assert np.all(np.abs(places[:, 0]) <= side + 1e-9)
    assert np.all((places[:, 1] >= -below - 1e-9) & (places[:, 1] <= above + 1e-9))
    # In one direction the points fill the picture from edge to edge.
    left, low = places.min(axis=0)
    right, high = places.max(axis=0)
    wide = np.allclose([left, right], [-side, side], atol=1e-9)
    tall = np.allclose([low, high], [-below, above], atol=1e-9)
    assert wide or tall
    # In the other one the room left and right, or below and above, is the same.
    assert left + side == pytest.approx(side - right, abs=0.35)


def test_the_scene_is_seen_from_its_right_and_from_above():
    position, target = camera_pose(np.array([[-1.0, -1, 0], [1, 1, 0], [1, -1, 0.3], [-1, 1, 0]]))
    assert position[1] < -1 and position[2] > 1
    assert np.linalg.norm(target[:2]) < 1
