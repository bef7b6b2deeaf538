"""Searches the disturbance sequence that does most to leave the tube, by projected gradient."""

import dataclasses as dc
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mirte_drake.containment import of_plans, of_successors
from mirte_drake.model.candidate_library import COS, SIN, term_name
from mirte_drake.model.sparse_model import SparseModel
from mirte_drake.run import Run, simulate
from mirte_drake.scenario import Scenario, load_prediction_model
from mirte_drake.systems.disturbance_source import RecordedDisturbance
from mirte_drake.vectors import POSE_SIZE

PINNED = 1e-6  # [m, rad] An error this near to the tube's side stays there.
STEPS = (2.0, 2.0, 0.5, 0.5)  # Of the bound: first from corner to corner, then smaller.


def search_disturbance(
    scenario: Scenario, bound: np.ndarray, *, seed: int = 0, steps: Sequence[float] = STEPS
) -> Run:
    """Returns the run, of those that the search makes, that comes nearest to leaving its tube.

    The search climbs the sum over samples of the ``closeness``: of x, of y, of yaw or of the
    largest of them, as the seed goes on. It begins with independent corners of the box of
    disturbances, and for every other four seeds with one corner held throughout.

    Args:
        scenario: What to run, with a tube; its disturbance is replaced.
        bound: (3,) [m/s, m/s, rad/s] of the disturbance, body frame.
        seed: Of the start; further seeds are restarts.
        steps: Step of each iteration, as a multiple of the bound.
    """
    corners = np.random.default_rng(seed).choice([-1.0, 1.0], (scenario.steps, POSE_SIZE))
    w = bound * (corners if seed // 4 % 2 == 0 else corners[0] * np.ones_like(corners))
    axis = (None, 0, 1, 2)[seed % 4]
    run = best = play(scenario, w)
    for step in steps:
        uphill = bound * gradient(run, axis)
        largest = np.max(np.abs(uphill), axis=1, keepdims=True)
        w = np.clip(w + step * bound * uphill / np.maximum(largest, 1e-12), -bound, bound)
        run = play(scenario, w)
        if closeness(run).max() > closeness(best).max():
            best = run
    return best


def play(scenario: Scenario, w: np.ndarray) -> Run:
    """Runs a scenario under the disturbances (K, 3) [m/s, m/s, rad/s] of its samples."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "disturbance.csv"
        np.savetxt(file, w, delimiter=",", fmt="%.17g")
        return simulate(dc.replace(scenario, disturbance=RecordedDisturbance(file)), "adversary")


def closeness(run: Run) -> np.ndarray:
    """Returns |x_{k+1} - xbar_{k+1}| / d_{k+1} (K - 1, 3): above 1 the successor has left."""
    successors = of_successors(run.log)
    return np.abs(successors.error) / successors.bound


def gradient(run: Run, axis: int | None = None) -> np.ndarray:
    """Returns the gradient (K, 3) of the sum over samples of ``closeness``, by the disturbances.

    One backward sweep with the model's Jacobians. Of the nominal state that the controller chooses
    it takes that it stays where it is as long as the error is inside the tube, and moves with the
    robot along axes on which the error is at a side.

    Args:
        run: The run.
        axis: Index of x, y or yaw; None: of each sample's largest.
    """
    log = run.log
    by_error, by_disturbance = _jacobians(run)
    error = np.abs(of_plans(log).error)
    free = error < log["half_width"] - PINNED
    ratio, sign = closeness(run), np.sign(of_successors(log).error)
    result, by_successor = np.zeros_like(log["disturbance"]), np.zeros(POSE_SIZE)
    for k in reversed(range(len(ratio))):
        i = np.argmax(ratio[k]) if axis is None else axis
        by_successor[i] += sign[k, i] / log["half_width"][k + 1, i]
        result[k] = by_disturbance[k].T @ by_successor
        by_successor = free[k] * (by_error[k].T @ by_successor)
    return result


def _jacobians(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Returns the Jacobians (K, 3, 3) of the successor error by the error and the disturbance."""
    log, scenario = run.log, run.scenario
    n, inputs = POSE_SIZE, np.hstack([log["applied_input"], log["disturbance"]])
    model = load_prediction_model(scenario)
    assert isinstance(model, SparseModel)
    model = disturbed(model)
    jacobians = model.step_jacobians(log["pose"], inputs, scenario.period)
    by_pose, by_input, by_disturbance = np.split(jacobians, [n, n + 4], axis=-1)
    law = scenario.ancillary_inversion
    if law is not None:  # What it makes of the error; the turn within the sample left out.
        by_error = np.tile((1.0 - law.feedback * scenario.period) * np.eye(n), (len(inputs), 1, 1))
    else:
        by_error = by_pose - by_input @ log["gain"]
    return by_error, by_disturbance


def disturbed(model: SparseModel) -> SparseModel:
    """Returns a kinematic model with the disturbance w1, w2, w3, in the body frame, as inputs."""
    added = {
        "x": {f"{COS}*w1": 1.0, f"{SIN}*w2": -1.0},
        "y": {f"{SIN}*w1": 1.0, f"{COS}*w2": 1.0},
        "theta": {"w3": 1.0},
    }
    derivatives = {
        state: {term_name(term): factor for term, factor in equation.items()} | added[state]
        for state, equation in zip(model.states, model.equations, strict=True)
    }
    inputs = [*model.inputs, "w1", "w2", "w3"]
    return SparseModel(f"disturbed {model.name}", model.states, inputs, derivatives)
