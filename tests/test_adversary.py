import dataclasses as dc
import functools

import numpy as np
import pytest
from disturbed_robot import disturbed_successor

from mirte_drake.adversary import closeness, disturbed, gradient, play, search_disturbance
from mirte_drake.model.model_file import load_model
from mirte_drake.run import Run
from mirte_drake.scenario_file import load_scenario

W_MAX = np.array([0.04, 0.03, 0.09])
MODEL = load_model("extended_kinematic")


@functools.cache
def searched(name: str, seed: int = 0, duration: float = 8.0) -> tuple[Run, Run]:
    """Returns the run that a search begins with, and the one that it returns."""
    scenario = load_scenario(name, [f"duration={duration}"])
    return (
        search_disturbance(scenario, W_MAX, seed=seed, steps=()),
        search_disturbance(scenario, W_MAX, seed=seed),
    )


def test_disturbed_model_is_the_robot():
    model, rng = disturbed(MODEL), np.random.default_rng(0)
    for _ in range(10):
        x, u, w = rng.normal(size=3), rng.uniform(-50, 50, 4), W_MAX * rng.uniform(-1, 1, 3)
        (expected,) = disturbed_successor(MODEL, x, u, w[None], 0.1)
        actual = model.step(x, np.concatenate([u, w]), 0.1)
        np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-8)


def test_played_disturbances_are_those_given():
    w = W_MAX * np.random.default_rng(0).uniform(-1, 1, (6, 3))
    run = play(load_scenario("rigorous_rectangle", ["duration=0.5"]), w)
    np.testing.assert_array_equal(run.log["disturbance"], w)
    error = run.log["pose"][1:] - run.log["nominal_next"][:-1]
    np.testing.assert_allclose(closeness(run), np.abs(error) / run.log["half_width"][1:])


def test_gradient_by_hand_at_the_last_sample():
    run = play(load_scenario("rigorous_rectangle", ["duration=0.5"]), np.tile(0.5 * W_MAX, (6, 1)))
    slope = gradient(run, 2)
    # Nothing comes after: T_s over the half-width, in yaw alone.
    np.testing.assert_allclose(slope[4], [0.0, 0.0, 0.1 / run.log["half_width"][5, 2]], atol=1e-12)
    np.testing.assert_array_equal(slope[5], np.zeros(3))


@pytest.mark.parametrize("name", ["rectangle", "rigorous_turning_circle"])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_gradient_is_that_of_the_next_sample(name, axis):
    """Finite differences in one sample's disturbance, of the closeness just after it."""
    scenario, rng = load_scenario(name, ["duration=1"]), np.random.default_rng(axis)
    w = 0.7 * W_MAX * rng.choice([-1.0, 1.0], (11, 3))
    run = play(scenario, w)
    cut = {key: value[:11] for key, value in run.log.items()}  # The last sample's own slope.
    slope = gradient(dc.replace(run, log=cut), axis)[9]
    numerical = []
    for i in range(3):
        values = []
        for sign in (-1, 1):
            moved = w.copy()
            moved[9, i] += sign * 1e-4
            values.append(closeness(play(scenario, moved))[9, axis])
        numerical.append((values[1] - values[0]) / 2e-4)
    np.testing.assert_allclose(slope, numerical, rtol=0.02, atol=0.05)


def test_it_stays_within_the_bound():
    _, best = searched("rectangle")
    assert np.all(np.abs(best.log["disturbance"]) <= W_MAX)


def test_it_finds_more_than_it_begins_with():
    start, best = searched("rectangle")
    assert closeness(best).max() > closeness(start).max() + 0.02
    assert closeness(best).max() > 1.0  # The published tube is left.


def test_other_seeds_begin_elsewhere():
    scenario = load_scenario("rigorous_rectangle", ["duration=0.5"])
    corners, held = (search_disturbance(scenario, W_MAX, seed=s, steps=()) for s in (0, 4))
    assert np.ptp(corners.log["disturbance"], axis=0).min() > 0
    assert np.ptp(held.log["disturbance"], axis=0).max() == 0
    np.testing.assert_array_equal(np.abs(corners.log["disturbance"]), np.tile(W_MAX, (6, 1)))
