import dataclasses as dc

import numpy as np
import pytest

from mirte_drake.control.nmpc_solver import make_nmpc_solver
from mirte_drake.control.realtime_nmpc import RealtimeNmpc
from mirte_drake.control.tracking_problem import cost_and_gradient, gauss_newton_hessian, join
from mirte_drake.model.model_file import load_model
from mirte_drake.model.prediction_model import PredictionModel

GUESS = np.zeros(43)


class LaggedModel(PredictionModel):
    """Body velocities that follow the wheels with a lag: no table of terms, six states."""

    name = "lagged"
    num_states, num_inputs = 6, 4
    MIX = 0.004 * np.array([[1, 1, 1, 1], [-1, 1, -1, 1], [-3, 3, 3, -3]])

    def derivative(self, x, u):
        cos, sin = np.cos(x[..., 2]), np.sin(x[..., 2])
        pose = [cos * x[..., 3] - sin * x[..., 4], sin * x[..., 3] + cos * x[..., 4], x[..., 5]]
        lag = (np.tanh(u @ self.MIX.T) - x[..., 3:]) / 0.3
        return np.concatenate([np.stack(pose, axis=-1), lag], axis=-1)

    def linearise(self, x, u):
        cos, sin = np.cos(x[..., 2]), np.sin(x[..., 2])
        A, B = np.zeros((*x.shape, 6)), np.zeros((*x.shape, 4))
        A[..., 0, 2] = -sin * x[..., 3] - cos * x[..., 4]
        A[..., 1, 2] = cos * x[..., 3] - sin * x[..., 4]
        A[..., 0, 3], A[..., 0, 4] = cos, -sin
        A[..., 1, 3], A[..., 1, 4] = sin, cos
        A[..., 2, 5] = 1.0
        A[..., 3:, 3:] = -np.eye(3) / 0.3
        slope = 1.0 - np.tanh(u @ self.MIX.T) ** 2
        B[..., 3:, :] = slope[..., :, None] * self.MIX / 0.3
        return self.derivative(x, u), A, B


def same(one, other) -> bool:
    """Whether two solutions are equal to the last digit; failed ones have no cost."""
    arrays = ("inputs", "states", "cost")
    return (one.iterations, one.message) == (other.iterations, other.message) and all(
        np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True) for name in arrays
    )


@pytest.mark.parametrize("iterations", [1, 100])
def test_preparation_changes_nothing_but_the_time(problem, make_data, iterations):
    prepared = RealtimeNmpc(problem, max_iterations=iterations)
    plain = RealtimeNmpc(problem, max_iterations=iterations)
    for guess in (GUESS, np.linspace(-5.0, 5.0, 43)):
        prepared.prepare(guess)
        one, other = prepared.solve(make_data(), guess), plain.solve(make_data(), guess)
        assert same(one, other)
        assert one.solve_time > one.preparation_time > 0 and other.preparation_time == 0


def test_preparation_for_another_guess_is_not_used(problem, make_data):
    dut = RealtimeNmpc(problem)
    expected = dut.solve(make_data(), GUESS)
    dut.prepare(np.full(43, 20.0))
    assert same(dut.solve(make_data(), GUESS), expected)


def test_two_users_of_one_solver_do_not_disturb_each_other(problem, make_data):
    """Active sets and factorisations of one must not reach the other, not in the last digit."""
    datas = [
        make_data(reference=np.tile([1.0, y, 0.5 * y], (11, 1)), half_width=np.full(3, 1e-3))
        for y in (-1.0, 0.3)
    ]
    alone = [RealtimeNmpc(problem).solve(data, GUESS) for data in datas]
    shared = RealtimeNmpc(problem)
    for _ in range(3):
        for data, expected in zip(datas, alone, strict=True):
            assert same(shared.solve(data, GUESS), expected)


@pytest.mark.parametrize("scale", [1.0, 1e4, 1e8])
@pytest.mark.parametrize("name", ["realtime", "converged"])
def test_earlier_solves_leave_no_trace_on_far_problems_of_six_states(
    problem, make_data, name, scale
):
    dynamic, rng = dc.replace(problem, model=load_model("dynamic")), np.random.default_rng(0)
    shared = make_nmpc_solver(dynamic, name)
    for _ in range(6):
        data = make_data(state=scale * rng.normal(size=6), half_width=np.full(6, 0.01))
        guess = np.concatenate([data.state, rng.uniform(-50, 50, 40)])
        shared.prepare(guess)
        one, other = shared.solve(data, guess), make_nmpc_solver(dynamic, name).solve(data, guess)
        assert same(one, other)


@pytest.mark.parametrize("size", [1e20, 1e160, np.inf, np.nan])
def test_preparation_never_raises(problem, make_data, size):
    dynamic = dc.replace(problem, model=load_model("dynamic"))
    dut, data = RealtimeNmpc(dynamic), make_data(state=np.zeros(6), half_width=np.zeros(6))
    expected = dut.solve(data, np.zeros(46))
    dut.prepare(np.full(46, size))
    assert same(dut.solve(data, np.zeros(46)), expected)


@pytest.mark.parametrize("factor", [1e-9, 1e-4, 1e6])
@pytest.mark.parametrize("iterations", [1, 100])
def test_the_unit_of_the_cost_does_not_matter(problem, make_data, iterations, factor):
    names = ("state_weight", "input_weight", "rate_weight", "terminal_weight")
    scaled = dc.replace(problem, **{name: factor * getattr(problem, name) for name in names})
    one, other = (
        RealtimeNmpc(each, max_iterations=iterations).solve(make_data(), GUESS)
        for each in (problem, scaled)
    )
    np.testing.assert_allclose(other.inputs, one.inputs, atol=1e-7)
    assert other.cost == pytest.approx(factor * one.cost)


def test_small_weights_on_inputs(problem, make_data):
    free = dc.replace(problem, input_weight=1e-6 * np.eye(4), rate_weight=np.zeros((4, 4)))
    solution = RealtimeNmpc(free).solve(make_data(), GUESS)
    assert solution.success and not solution.early, solution.message
    assert solution.iterations < 30


@pytest.mark.parametrize("kind", [int, np.float32])
def test_guess_of_another_type(problem, make_data, kind):
    dut = RealtimeNmpc(problem)
    expected = dut.solve(make_data(), GUESS)
    dut.prepare(GUESS.astype(kind))
    assert same(dut.solve(make_data(), GUESS.astype(kind)), expected)
    assert same(dut.solve(make_data(), GUESS), expected)


def test_one_iteration_is_the_gauss_newton_step(problem, make_data):
    """Without active constraints: by hand, from gradient and Hessian."""
    wide = dc.replace(problem, rate_limit=np.full(4, 1e3))
    limits = {"input_lower": np.full((10, 4), -1e3), "input_upper": np.full((10, 4), 1e3)}
    data = make_data(half_width=np.full(3, 1.0), **limits)
    guess = np.linspace(-2.0, 3.0, 43)
    _, gradient = cost_and_gradient(wide, data, guess)
    expected = guess - np.linalg.solve(gauss_newton_hessian(wide, guess), gradient)
    solution = RealtimeNmpc(wide, max_iterations=1).solve(data, guess)
    z = join(solution.initial_state, solution.inputs)
    np.testing.assert_allclose(z, expected, atol=1e-7)
    assert solution.iterations == 1


def test_iterations_follow_the_optimum_from_sample_to_sample(problem, make_data):
    """Real-time iterations on a problem that stays the same converge to its optimum."""
    data, dut = make_data(), RealtimeNmpc(problem, max_iterations=1)
    optimum = make_nmpc_solver(problem, "converged").solve(data, GUESS)
    z, gaps = GUESS, []
    for _ in range(6):
        solution = dut.solve(data, z)
        z = join(solution.initial_state, solution.inputs)
        gaps.append(solution.cost / optimum.cost - 1.0)
    assert gaps[-1] < 1e-10
    assert np.all(np.diff(gaps) <= 1e-12)


def test_a_step_that_costs_more_is_shortened(problem, make_data):
    """Half a turn off, the linearisation points the wrong way at first."""
    data = make_data(reference=np.tile([0.5, 0.5, 3.0], (11, 1)))
    guess = np.concatenate([data.state, np.tile([90.0, -90.0, -90.0, 90.0], 10)])
    begin, _ = cost_and_gradient(problem, data, guess)
    for iterations in (1, 100):
        solution = RealtimeNmpc(problem, max_iterations=iterations).solve(data, guess)
        assert solution.success and solution.cost < begin


def test_problem_that_is_not_finite_leaves_no_trace(problem, make_data):
    dut, expected = RealtimeNmpc(problem), RealtimeNmpc(problem).solve(make_data(), GUESS)
    for bad in (
        make_data(state=np.array([np.nan, 0, 0])),
        make_data(reference=np.full((11, 3), 1e200)),
        make_data(previous_input=np.full(4, 1e300)),
    ):
        assert not dut.solve(bad, GUESS).success or np.isfinite(dut.solve(bad, GUESS).cost)
        assert same(dut.solve(make_data(), GUESS), expected)


def test_iteration_limit_is_told(problem, make_data):
    solution = RealtimeNmpc(problem, max_iterations=2).solve(
        make_data(reference=np.tile([3.0, -2.0, 3.0], (11, 1))), GUESS
    )
    assert solution.success and solution.early
    assert solution.message == "not converged in 2 iterations"


@pytest.mark.parametrize("name", ["converged", "realtime"])
def test_any_model_will_do(problem, make_data, name):
    """The general path: Jacobians from the model's own methods, six states."""
    lagged = dc.replace(problem, model=LaggedModel())
    data = make_data(
        state=np.array([0.01, -0.02, 0.03, 0.1, 0.0, 0.1]), half_width=np.full(6, 0.003)
    )
    guess = np.zeros(46)
    optimum = make_nmpc_solver(lagged, "ipopt", tolerance=1e-9).solve(data, guess)
    assert optimum.success, optimum.message
    dut, z = make_nmpc_solver(lagged, name), guess
    for _ in range(8 if name == "realtime" else 1):
        solution = dut.solve(data, z)
        z = join(solution.initial_state, solution.inputs)
    assert solution.success and solution.states.shape == (11, 6)
    assert solution.cost == pytest.approx(optimum.cost, rel=1e-6)
