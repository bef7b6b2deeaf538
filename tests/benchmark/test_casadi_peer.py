import dataclasses as dc
import sys

import numpy as np
import pytest

from mirte_drake.benchmark.casadi_peer import METHODS, CasadiNmpc
from mirte_drake.control.nmpc_program import NmpcProgram
from mirte_drake.control.tracking_problem import (
    cost_and_gradient,
    join,
    pose,
    rate_matrix,
)
from mirte_drake.errors import UserError

methods = pytest.mark.parametrize("method", METHODS)


@pytest.fixture(autouse=True, scope="module")
def casadi():
    return pytest.importorskip("casadi", reason="CasADi is optional: mirte-drake[benchmark]")


def at_rest(problem, data) -> np.ndarray:
    return join(data.state, np.zeros((problem.horizon, problem.model.num_inputs)))


@methods
@pytest.mark.parametrize(
    ("model", "aligned", "horizon"),
    [
        ("extended_kinematic", False, 10),
        ("extended_kinematic", True, 10),
        ("extended_kinematic", False, 1),
        ("kinematic", False, 10),
        ("dynamic", False, 10),
        ("dynamic", True, 6),
    ],
)
def test_a_peer_finds_the_optimum_that_ipopt_finds(
    make_problem, make_data, method, model, aligned, horizon
):
    problem = make_problem(model, aligned=aligned, horizon=horizon)
    peer = CasadiNmpc(problem, method)
    ipopt = NmpcProgram(problem, solver="ipopt", tolerance=1e-8)
    for seed in range(4):
        data = make_data(problem, seed)
        guess = at_rest(problem, data)
        expected, solution = ipopt.solve(data, guess), peer.solve(data, guess)
        assert expected.success and solution.success, (expected.message, solution.message)
        z = join(solution.initial_state, solution.inputs)
        # The cost that the peer states is that of its inputs under the package's own roll-out.
        np.testing.assert_allclose(solution.cost, cost_and_gradient(problem, data, z)[0], rtol=5e-7)
        # IPOPT widens the bounds a little: its cost is taken after its inputs were clipped.
        z = join(expected.initial_state, expected.inputs)
        optimum = cost_and_gradient(problem, data, z)[0]
        np.testing.assert_allclose(solution.cost, optimum, rtol=5e-7)
        np.testing.assert_allclose(solution.inputs, expected.inputs, rtol=0, atol=0.02)
        np.testing.assert_allclose(solution.initial_state, expected.initial_state, atol=1e-5)


@methods
def test_bounds_and_rates_are_met(problem, make_data, method):
    peer = CasadiNmpc(problem, method)
    active = 0
    for seed in range(6):
        data = make_data(problem, seed)
        data = dc.replace(data, reference=data.reference + 0.3)  # Far off: limits matter.
        solution = peer.solve(data, at_rest(problem, data))
        assert solution.success, solution.message
        assert np.all(np.abs(solution.initial_state - data.state) <= data.half_width + 1e-15)
        assert np.all(solution.inputs <= data.input_upper)
        assert np.all(solution.inputs >= data.input_lower)
        posed = pose(problem, data)
        lower, upper = posed.least[43:], posed.most[43:]
        moves = rate_matrix(problem) @ join(solution.initial_state, solution.inputs)
        assert np.all(moves >= lower - 1e-9) and np.all(moves <= upper + 1e-9)
        active += np.sum(np.minimum(moves - lower, upper - moves) < 1e-4)
    assert active > 0


@methods
def test_a_peer_begins_from_its_last_solve(problem, make_data, method):
    peer = CasadiNmpc(problem, method)
    data = make_data(problem, 1)
    cold = peer.solve(data, at_rest(problem, data))
    warm = peer.solve(data, join(cold.initial_state, cold.inputs))
    assert 0 <= warm.iterations < cold.iterations
    assert warm.cost == pytest.approx(cold.cost, rel=1e-7)


@methods
def test_turns_of_the_reference_do_not_change_the_cost(problem, make_data, method):
    peer = CasadiNmpc(problem, method)
    data = make_data(problem, 2)
    turned = dc.replace(data, reference=data.reference - [0.0, 0.0, 4 * np.pi])
    np.testing.assert_allclose(pose(problem, turned).references, pose(problem, data).references)
    one, other = (peer.solve(each, at_rest(problem, data)) for each in (data, turned))
    assert other.cost == pytest.approx(one.cost, rel=1e-7)


@methods
def test_failures_come_with_a_message_and_are_forgotten(problem, make_data, method):
    peer = CasadiNmpc(problem, method)
    data = make_data(problem, 3)
    guess = at_rest(problem, data)
    first = peer.solve(data, guess)
    for changes, word in (
        ({"input_lower": np.full((10, 4), 95.0)}, "CasADi: "),
        ({"state": np.full(3, np.nan)}, "not finite"),
    ):
        failed = peer.solve(dc.replace(data, **changes), guess)
        assert not failed.success and word in failed.message
        assert failed.message.count("\n") == 0
    again = peer.solve(data, guess)
    np.testing.assert_array_equal(again.inputs, first.inputs)
    assert again.iterations == first.iterations


@methods
def test_a_tighter_tolerance_takes_more_iterations(problem, make_data, method):
    data = make_data(problem, 4)
    guess = at_rest(problem, data)
    rough, fine = (
        CasadiNmpc(problem, method, tolerance=tolerance).solve(data, guess)
        for tolerance in (1e-2, 1e-10)
    )
    assert rough.iterations < fine.iterations


def test_unknown_method(problem):
    with pytest.raises(ValueError, match="method: must be one of casadi_ipopt, casadi_sqp_hpipm"):
        CasadiNmpc(problem, "acados")


def test_missing_package_is_named_with_its_remedy(problem, monkeypatch):
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(UserError, match=r"pip install mirte-drake\[benchmark\]"):
        CasadiNmpc(problem, "casadi_ipopt")
