import numpy as np

from mirte_drake.containment import TubeErrors, of_plans, of_successors, of_true_poses

COUNT = 4
POSES, STATES = np.zeros((COUNT, 3)), np.zeros((COUNT, 6))
LOG = {
    "pose": POSES,
    "true_pose": POSES,
    "nominal_pose": POSES,
    "nominal_next": POSES,
    "half_width": np.arange(1.0, COUNT + 1)[:, None] * [0.1, 0.1, 0.2],
}
LAGGED = {
    **LOG,
    "state": STATES,
    "nominal_next_velocity": POSES,
    "error_bound": np.arange(1.0, COUNT + 1)[:, None] * [0.1, 0.1, 0.2, 0.3, 0.3, 0.4],
}


def changed(array, **rows) -> np.ndarray:
    """An array with other rows, named by their number: r2=..."""
    array = array.copy()
    for name, row in rows.items():
        array[int(name[1:])] = row
    return array


def test_a_sample_on_the_edge_is_inside_and_one_beyond_counts_once():
    bound = np.full((3, 2), 0.1)
    errors = TubeErrors(np.array([[0.1, -0.1], [0.11, -0.2], [0.0, 0.0]]), bound)
    np.testing.assert_array_equal(errors.outside, [[False, False], [True, True], [False, False]])
    assert errors.violations == 1


def test_a_sample_is_compared_with_what_the_one_before_predicted():
    log = {**LOG, "nominal_next": changed(POSES, r1=[0.05, 0.0, 2 * np.pi])}
    errors = of_successors(log)
    np.testing.assert_allclose(errors.error, [[0, 0, 0], [-0.05, 0, 0], [0, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(errors.bound, LOG["half_width"][1:])


def test_a_lagging_sample_is_compared_in_its_own_frame_with_velocities():
    # At a quarter turn 0.1 m along the world's y is forward; a velocity is the body's.
    log = {
        **LAGGED,
        "state": changed(STATES, r2=[0.0, 0.1, np.pi / 2, 0.03, 0.0, 0.01]),
        "nominal_next": changed(POSES, r1=[0.0, 0.0, np.pi / 2]),
        "nominal_next_velocity": changed(POSES, r1=[0.0, 0.02, 0.0]),
    }
    errors = of_successors(log)
    expected = [[0.1, 0, 0], [0.03, -0.02, 0.01]]
    np.testing.assert_allclose(errors.error[1], np.ravel(expected), atol=1e-15)
    np.testing.assert_allclose(errors.error[[0, 2]], 0.0)
    np.testing.assert_allclose(errors.bound, LAGGED["error_bound"][1:])


def test_a_plan_begins_around_the_pose_that_is_estimated():
    pose = changed(POSES, r1=[0.3, 0.0, 0.0])
    assert of_plans({**LOG, "pose": pose}).violations == 1
    assert of_plans({**LAGGED, "pose": pose}).violations == 0
    state = changed(STATES, r1=[0.3, 0.0, 0.0, 0, 0, 0])
    assert of_plans({**LAGGED, "state": state}).violations == 1


def test_the_true_pose_belongs_to_the_plan_that_acts():
    true = changed(POSES, r1=[0.3, 0.0, 0.0], r3=[0.15, 0.0, 0.0])
    for log in (LOG, LAGGED):
        errors = of_true_poses({**log, "true_pose": true}, 0)
        np.testing.assert_allclose(errors.error[:, 0], [0.0, 0.3, 0.0, 0.15])
        np.testing.assert_allclose(errors.bound[:, 0], [0.1, 0.2, 0.3, 0.4])
        # Two samples late the bound is that of the plan of then, and the first sample has none.
        errors = of_true_poses({**log, "true_pose": true}, 2)
        np.testing.assert_allclose(errors.error[:, 0], [0.0, 0.15])
        np.testing.assert_allclose(errors.bound[:, 0], [0.1, 0.2])
        assert errors.error.shape == errors.bound.shape == (2, 3)


def test_a_true_pose_beside_a_lagging_plan_is_seen_from_the_robot():
    log = {
        **LAGGED,
        "true_pose": changed(POSES, r0=[0.0, 0.2, np.pi / 2 + 0.1]),
        "nominal_pose": changed(POSES, r0=[0.0, 0.0, np.pi / 2]),
    }
    expected = [0.2 * np.cos(0.1), -0.2 * np.sin(0.1), 0.1]
    np.testing.assert_allclose(of_true_poses(log, 0).error[0], expected)
