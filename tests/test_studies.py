"""The published studies, closed loop: what issue A promises of them."""

import functools

import numpy as np
import pytest

from mirte_drake.control.nmpc_solver import make_nmpc_solver
from mirte_drake.control.reference_paths import window
from mirte_drake.control.tracking_problem import TrackingData, join
from mirte_drake.model.model_file import load_model
from mirte_drake.run import Run, simulate, summarise
from mirte_drake.scenario import load_scenario
from mirte_drake.systems.nominal_nmpc import make_tracking_problem

# RMSE of an independent implementation, with independent identically distributed disturbances
# at one seed: x [m], y [m], yaw [rad].
INDEPENDENT = {
    "rectangle": (0.0075, 0.0128, 0.0055),
    "circle": (0.0067, 0.0156, 0.0054),
    "turning_circle": (0.0081, 0.0081, 0.0192),
}
seeds = pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 5))]
)
studies = pytest.mark.parametrize("name", INDEPENDENT)


@functools.cache
def study(name: str, *overrides: str) -> Run:
    return simulate(load_scenario(name, overrides), name)


def rmse(run: Run) -> np.ndarray:
    return np.array(list(summarise(run)["rmse"].values()))


@studies
@seeds
def test_study_holds_its_constraints_and_its_accuracy(name, seed):
    run = study(name, f"seed={seed}")
    summary = summarise(run)
    assert summary["solve_failures"] == 0
    assert summary["tube_violations"] == 0
    assert summary["input_violations"] == 0
    assert summary["rate_violations"] == 0
    np.testing.assert_allclose(rmse(run), INDEPENDENT[name], rtol=0.2)


@studies
@seeds
def test_aligned_reference_takes_a_quarter_off_the_position_error(name, seed):
    published = rmse(study(name, f"seed={seed}"))
    aligned = rmse(study(name, f"seed={seed}", "nominal_nmpc.reference_alignment=aligned"))
    assert aligned[:2].mean() <= 0.75 * published[:2].mean()


@pytest.mark.slow
@studies
@pytest.mark.parametrize(
    "disturbance",
    [
        "!CornerDisturbance {bound: [0.04, 0.03, 0.09]}",
        "!ConstantDisturbance {value: [0.04, 0.03, 0.09]}",
    ],
)
def test_worst_disturbances_keep_the_state_in_the_tube(name, disturbance):
    """The successor may leave the tube (ancillary moves meet quadratic terms); x_k may not."""
    run = study(name, f"disturbance={disturbance}")
    summary = summarise(run)
    assert summary["tube_violations"] == summary["input_violations"] == 0
    successor = np.abs(run.log["pose"][1:] - run.log["nominal_next"][:-1])
    counted = np.any(successor > run.log["half_width"][1:] + 1e-9, axis=1).sum()
    assert summary["successor_violations"] == counted
    # By a few milliradians in yaw; where the heading turns, the published box also misses the
    # rotation of the disturbance, by about a millimetre.
    assert np.all((successor - run.log["half_width"][1:]).max(axis=0) < [2e-3, 2e-3, 5e-3])


def logged_problems(name: str, count: int):
    """Yields problems of a run, rebuilt from its log."""
    log = study(name).log
    scenario = load_scenario(name)
    problem = make_tracking_problem(
        scenario.nominal_nmpc, load_model(scenario.prediction_model), scenario.period
    )
    poses = scenario.reference.poses(scenario.period)
    horizon = problem.horizon
    for k in np.linspace(1, len(log["time"]) - 1, count).astype(int):
        data = TrackingData(
            state=log["pose"][k],
            reference=window(poses, k, horizon + 1),
            half_width=log["half_width"][k],
            input_lower=np.tile(log["input_lower"][k], (horizon, 1)),
            input_upper=np.tile(log["input_upper"][k], (horizon, 1)),
            previous_input=log["nominal_input"][k - 1],
        )
        yield problem, data, join(log["pose"][k], np.zeros((horizon, 4)))


def test_snopt_and_ipopt_agree_on_logged_problems():
    checked = 0
    for name, count in (("rectangle", 34), ("circle", 33), ("turning_circle", 33)):
        programs = {}
        for problem, data, guess in logged_problems(name, count):
            for solver in ("snopt", "ipopt"):
                if solver not in programs:
                    programs[solver] = make_nmpc_solver(problem, solver)
            snopt, ipopt = (programs[s].solve(data, guess) for s in ("snopt", "ipopt"))
            assert snopt.success, snopt.message
            assert ipopt.success, ipopt.message
            assert snopt.cost == pytest.approx(ipopt.cost, rel=1e-5)
            inputs = np.abs(ipopt.inputs).max()
            np.testing.assert_allclose(snopt.inputs, ipopt.inputs, rtol=0, atol=1e-3 * inputs)
            checked += 1
    assert checked == 100
