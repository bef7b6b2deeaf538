import numpy as np
import pytest

from mirte_drake.visualization.scene.ribbons import (
    convex_hull,
    dashes,
    grid,
    joined,
    rectangle,
    ribbon,
    swept_box,
)


def area(mesh) -> float:
    """Area of a flat mesh; negative triangles, seen from below, count as such."""
    a, b, c = (mesh.points[mesh.triangles[:, i]] for i in range(3))
    ab, ac = b - a, c - a
    return float(np.sum(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]) / 2)


def turned_up(mesh) -> bool:
    a, b, c = (mesh.points[mesh.triangles[:, i]] for i in range(3))
    ab, ac = b - a, c - a
    return bool(np.all(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0] >= -1e-15))


def test_a_straight_line_becomes_a_rectangle():
    mesh = ribbon(np.array([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0]]), 0.2)
    assert sorted(map(tuple, mesh.points.round(12).tolist())) == [
        *((0.0, -0.1), (0.0, 0.1), (1.0, -0.1), (1.0, 0.1), (3.0, -0.1), (3.0, 0.1)),
    ]
    assert area(mesh) == pytest.approx(0.6) and turned_up(mesh)


def test_a_right_angle_is_mitred():
    mesh = ribbon(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]), 0.2)
    np.testing.assert_allclose(mesh.points[2:4], [[0.9, 0.1], [1.1, -0.1]], atol=1e-12)
    assert turned_up(mesh)


def test_a_line_that_turns_back_stays_finite():
    mesh = ribbon(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]]), 0.1)
    assert np.all(np.isfinite(mesh.points)) and np.max(np.abs(mesh.points)) < 2


@pytest.mark.parametrize("line", [np.zeros((1, 2)), np.zeros((4, 2))])
def test_a_robot_that_stands_leaves_nothing(line):
    assert len(ribbon(line, 0.1).triangles) == 0


def test_points_that_stand_still_change_nothing():
    line = np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    np.testing.assert_array_equal(ribbon(line, 0.1).points, ribbon(line[[0, 2, 4]], 0.1).points)


def test_dashes_follow_the_line_round_a_corner():
    line = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    pieces = dashes(line, 0.4, 0.2)
    assert len(pieces) == 4
    np.testing.assert_allclose(pieces[0], [[0, 0], [0.4, 0]], atol=1e-12)
    np.testing.assert_allclose(pieces[1], [[0.6, 0], [1.0, 0]], atol=1e-12)
    np.testing.assert_allclose(pieces[2], [[1.0, 0.2], [1.0, 0.6]], atol=1e-12)
    np.testing.assert_allclose(pieces[3][[0, -1]], [[1.0, 0.8], [1.0, 1.0]], atol=1e-12)
    around = dashes(line, 0.5, 0.3)[1]
    np.testing.assert_allclose(around, [[0.8, 0], [1, 0], [1, 0.3]], atol=1e-12)


def test_a_box_that_moves_sweeps_its_hull():
    # By hand: both boxes, 0.4 x 0.2, and the parallelogram between them.
    half = np.array([0.2, 0.1])
    mesh = swept_box(np.zeros(2), half, np.array([1.0, 0.5]), half)
    assert area(mesh) == pytest.approx(0.08 + 1.0 * 0.2 + 0.5 * 0.4) and turned_up(mesh)
    assert len(mesh.points) == 6


def test_a_box_that_grows_on_the_spot_sweeps_the_larger_one():
    mesh = swept_box(np.ones(2), np.zeros(2), np.ones(2), np.array([0.3, 0.2]))
    assert area(mesh) == pytest.approx(0.24) and len(mesh.points) == 4


def test_a_hull_holds_its_points():
    points = np.random.default_rng(0).normal(size=(50, 2))
    mesh = convex_hull(points)
    assert turned_up(mesh)
    edges = np.roll(mesh.points, -1, axis=0) - mesh.points
    for corner, edge in zip(mesh.points, edges, strict=True):
        to = points - corner
        assert np.all(edge[0] * to[:, 1] - edge[1] * to[:, 0] >= -1e-12)


@pytest.mark.parametrize("points", [[[1, 2]] * 8, [[0, 0], [1, 1], [2, 2]]])
def test_a_hull_without_area_has_no_triangles(points):
    assert len(convex_hull(np.array(points, dtype=float)).triangles) == 0


def test_a_grid_has_the_multiples_within():
    lower, upper = np.array([-0.05, 0.1]), np.array([0.25, 0.3])
    mesh = grid(lower, upper, 0.1, 0.01)
    # x = 0, 0.1, 0.2 over the height 0.2, and y = 0.2 over the width 0.3; edges have no line.
    assert len(mesh.triangles) == 2 * 4
    assert area(mesh) == pytest.approx(3 * 0.01 * 0.2 + 0.01 * 0.3)


def test_joined_meshes_keep_their_triangles():
    one, two = rectangle(np.zeros(2), np.ones(2)), rectangle(np.full(2, 5.0), np.full(2, 7.0))
    assert area(joined([one, two])) == pytest.approx(1 + 4)
    assert len(joined([]).triangles) == 0
