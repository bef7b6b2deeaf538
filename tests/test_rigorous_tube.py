"""The tube of docs/concepts/rigorous_tube.md, closed loop on the robot that it is proven for.

RIGOROUS_SEEDS=50 in the environment runs as many seeds of the slow tests.
"""

import functools
import itertools
import os

import numpy as np
import pytest

from mirte_drake.adversary import closeness, search_disturbance
from mirte_drake.run import Run, simulate
from mirte_drake.run_summary import summarise
from mirte_drake.scenario_file import load_scenario

W_MAX = np.array([0.04, 0.03, 0.09])
CORNERS = [(corner * W_MAX).tolist() for corner in itertools.product((-1, 1), repeat=3)]
SETTLED = 20  # Samples until the half-widths are near their steady state.
TOLERANCE = 1e-6  # [m, rad]
SEEDS = int(os.environ.get("RIGOROUS_SEEDS", "2"))

paths = pytest.mark.parametrize("path", ["rectangle", "circle", "turning_circle"])
seeds = pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, SEEDS))]
)
slow_seeds = pytest.mark.parametrize("seed", range(SEEDS))


def disturbance(kind: str, seed: int) -> str:
    return {
        "uniform": "!UniformDisturbance {}",
        "corner": "!CornerDisturbance {}",
        "constant": f"!ConstantDisturbance {{value: {CORNERS[seed % 8]}}}",
    }[kind]


@functools.lru_cache(maxsize=4)
def drive(name: str, kind: str, seed: int) -> Run:
    overrides = [f"seed={seed}", f"disturbance={disturbance(kind, seed)}"]
    return simulate(load_scenario(name, overrides), name)


def check_tube(run: Run) -> None:
    """Everything that the rigorous tube promises."""
    summary, log = summarise(run), run.log
    assert summary["successor_violations"] == summary["tube_violations"] == 0
    successor = np.abs(log["pose"][1:] - log["nominal_next"][:-1])
    assert np.all(successor <= log["half_width"][1:] + TOLERANCE)
    assert summary["input_violations"] == summary["solve_failures"] == 0
    assert np.all(log["reached"] == 1.0)
    assert np.all(np.abs(log["applied_input"]) <= 100.0)
    assert log["input_upper"].min() >= 60.0 and log["input_lower"].max() <= -60.0
    # The law stays within the room that the bounds leave it.
    assert np.all(log["nominal_input"] <= log["input_upper"] + 1e-9)


@paths
@seeds
@pytest.mark.parametrize("kind", ["uniform", "corner", "constant"])
def test_the_successor_is_in_the_tube(path, kind, seed):
    check_tube(drive(f"rigorous_{path}", kind, seed))


@pytest.mark.slow
@paths
@slow_seeds
def test_no_searched_disturbance_leaves_the_tube(path, seed):
    run = search_disturbance(load_scenario(f"rigorous_{path}"), W_MAX, seed=seed)
    check_tube(run)
    assert closeness(run).max() > 0.99  # It comes very near: the tube is hardly wider than needed.


def test_a_searched_disturbance_stays_in_the_tube():
    scenario = load_scenario("rigorous_turning_circle", ["duration=8"])
    check_tube(search_disturbance(scenario, W_MAX, steps=(2.0, 0.5)))


@paths
@seeds
def test_the_tube_is_at_most_half_as_wide_as_the_published_one(path, seed):
    ours, published = drive(f"rigorous_{path}", "uniform", seed), drive(path, "uniform", seed)
    ratio = ours.log["half_width"][SETTLED:] / published.log["half_width"][SETTLED:]
    assert np.all(ratio.max(axis=0) <= [0.5, 0.5, 0.9])


def test_the_published_tube_does_not_hold_what_ours_does():
    """The same disturbances, so that the comparison above is of a tube that fails."""
    for path in ("rectangle", "turning_circle"):
        published = summarise(drive(path, "corner", 0))
        assert published["successor_violations"] > 10


@paths
def test_it_holds_with_the_robots_deadband_rounding_and_play(path):
    """Then the law does not get what it asks for; the tube takes what was applied into account."""
    limiter = [
        "wheel_command_limiter={deadband: 10, round_to_integer: true, play: 2}",
        "duration=8",
    ]
    run = simulate(
        load_scenario(f"rigorous_{path}", [*limiter, "disturbance=!CornerDisturbance {}"]), path
    )
    summary = summarise(run)
    assert summary["successor_violations"] == summary["tube_violations"] == 0
    assert np.any(run.log["half_width"][1:, 2] > 0.0096)
