"""The published studies, closed loop.

STUDY_SEEDS=5 in the environment runs all seeds that were measured.
"""

import functools
import os

import numpy as np
import pytest

from mirte_drake.benchmark.casadi_peer import CasadiNmpc
from mirte_drake.benchmark.problems import drive, tracking_problem
from mirte_drake.control.nmpc_solver import make_nmpc_solver
from mirte_drake.control.tracking_problem import cost_and_gradient, join
from mirte_drake.run import Run, simulate
from mirte_drake.run_summary import summarise
from mirte_drake.scenario_file import load_scenario

# RMSE of an independent implementation, with independent identically distributed disturbances
# at one seed: x [m], y [m], yaw [rad].
INDEPENDENT = {
    "rectangle": (0.0075, 0.0128, 0.0055),
    "circle": (0.0067, 0.0156, 0.0054),
    "turning_circle": (0.0081, 0.0081, 0.0192),
}
SEEDS = int(os.environ.get("STUDY_SEEDS", "3"))
seeds = pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, SEEDS))]
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


@studies
@seeds
def test_solvers_drive_alike(name, seed):
    """Closed loop to four decimals, whatever the solver."""
    errors = {
        solver: rmse(study(name, f"seed={seed}", f"nominal_nmpc.solver={solver}"))
        for solver in ("realtime", "snopt")
    }
    errors["converged"] = rmse(study(name, f"seed={seed}"))
    np.testing.assert_allclose(errors["converged"], errors["snopt"], rtol=0, atol=5e-5)
    np.testing.assert_allclose(errors["realtime"], errors["snopt"], rtol=0, atol=5e-5)


def gaps(name: str, seed: int, solver: str, every: int) -> np.ndarray:
    """Costs of a solver on the states that a study visits, relative to IPOPT's, minus one."""
    scenario = load_scenario(name, [f"seed={seed}"])
    problem = tracking_problem(scenario)
    ipopt = CasadiNmpc(problem, "casadi_ipopt", tolerance=1e-12)
    dut = make_nmpc_solver(problem, solver)
    result = []
    for sample in list(drive(scenario))[1::every]:
        optimum = ipopt.solve(sample.data, sample.guess)
        assert optimum.success, optimum.message
        x0, inputs = optimum.states[0], optimum.inputs
        cost, _ = cost_and_gradient(problem, sample.data, join(x0, inputs))
        result.append(dut.solve(sample.data, sample.guess).cost / cost - 1.0)
    return np.array(result)


@pytest.mark.parametrize(
    ("seed", "every"),
    [(0, 10), *(pytest.param(s, 1, marks=pytest.mark.slow) for s in range(SEEDS))],
)
@studies
def test_converged_solutions_are_the_optimum_and_one_iteration_is_near_it(name, seed, every):
    pytest.importorskip("casadi", reason="CasADi is optional: mirte-drake[benchmark]")
    assert np.max(np.abs(gaps(name, seed, "converged", every))) < 1e-8
    assert np.mean(gaps(name, seed, "realtime", every)) < 1e-4


@pytest.mark.slow
def test_snopt_and_ipopt_agree_on_logged_problems():
    checked = 0
    for name, count in (("rectangle", 34), ("circle", 33), ("turning_circle", 33)):
        scenario = load_scenario(name)
        problem = tracking_problem(scenario)
        programs = [make_nmpc_solver(problem, solver) for solver in ("snopt", "ipopt")]
        samples = list(drive(scenario))
        for k in np.linspace(1, len(samples) - 1, count).astype(int):
            data = samples[k].data
            guess = join(data.state, np.zeros((10, 4)))
            snopt, ipopt = (program.solve(data, guess) for program in programs)
            assert snopt.success, snopt.message
            assert ipopt.success, ipopt.message
            assert snopt.cost == pytest.approx(ipopt.cost, rel=1e-5)
            inputs = np.abs(ipopt.inputs).max()
            np.testing.assert_allclose(snopt.inputs, ipopt.inputs, rtol=0, atol=1e-3 * inputs)
            checked += 1
    assert checked == 100
