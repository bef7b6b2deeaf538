import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.autodiffutils import InitializeAutoDiff
from scipy.optimize import linprog

from mirte_drake.control.dlqr import steady_input
from mirte_drake.control.tracking_problem import (
    TrackingData,
    cost_and_gradient,
    gauss_newton_hessian,
    join,
    pose,
    rate_matrix,
    shift,
    split,
)
from mirte_drake.model.model_file import load_model


def cost(problem, data, z) -> float:
    return cost_and_gradient(problem, data, z)[0]


@pytest.fixture(params=[False, True], ids=["published", "aligned"])
def either(problem, request):
    return dc.replace(problem, aligned=request.param)


@pytest.fixture
def dynamic_problem(problem):
    return dc.replace(problem, model=load_model("dynamic"))


@pytest.fixture
def z(make_data) -> np.ndarray:
    rng = np.random.default_rng(3)
    return np.concatenate([make_data().state + 0.01 * rng.normal(size=3), rng.uniform(-60, 60, 40)])


def naive_cost(problem, data, z):
    """Costs (4-9) with loops, for float and AutoDiffXd."""
    f, Ts, n = problem.model.derivative, problem.period, problem.model.num_states
    x, last, total = z[:n], data.previous_input, 0.0
    for i in range(problem.horizon):
        u = z[n + 4 * i : n + 4 * i + 4]
        k1 = f(x, u)
        k2 = f(x + Ts / 2 * k1, u)
        k3 = f(x + Ts / 2 * k2, u)
        k4 = f(x + Ts * k3, u)
        x = x + Ts / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        error = x[:3] - data.reference[i + 1 if problem.aligned else i]
        yaw = error[2].value() if error.dtype == object else error[2]
        error[2] = error[2] - 2 * np.pi * round(yaw / (2 * np.pi))
        total = total + error.dot(problem.state_weight).dot(error)
        total = total + u.dot(problem.input_weight).dot(u)
        total = total + (u - last).dot(problem.rate_weight).dot(u - last)
        last = u
    return total + error.dot(problem.terminal_weight).dot(error)


def gradient_by_differences(problem, data, z) -> np.ndarray:
    steps = 1e-5 * np.eye(z.size)
    return np.array(
        [(cost(problem, data, z + e) - cost(problem, data, z - e)) / 2e-5 for e in steps]
    )


def test_decision_vector_is_state_then_inputs_stage_by_stage(problem):
    x0, inputs = split(problem, np.arange(43.0))
    assert problem.size == 43
    np.testing.assert_array_equal(x0, [0, 1, 2])
    np.testing.assert_array_equal(inputs[:2], [[3, 4, 5, 6], [7, 8, 9, 10]])
    np.testing.assert_array_equal(join(x0, inputs), np.arange(43.0))


def test_cost_equals_a_plain_loop(either, make_data, z):
    np.testing.assert_allclose(cost(either, make_data(), z), naive_cost(either, make_data(), z))


def test_cost_with_coupled_weights_equals_a_plain_loop(either, make_data, z):
    rng = np.random.default_rng(4)
    roots = {"state_weight": 3, "input_weight": 4, "rate_weight": 4, "terminal_weight": 3}
    factors = {name: rng.normal(size=(size, size)) for name, size in roots.items()}
    coupled = dc.replace(either, **{name: M @ M.T for name, M in factors.items()})
    data = make_data()
    np.testing.assert_allclose(cost(coupled, data, z), naive_cost(coupled, data, z))
    _, gradient = cost_and_gradient(coupled, data, z)
    differences = gradient_by_differences(coupled, data, z)
    np.testing.assert_allclose(gradient, differences, rtol=1e-6, atol=1e-3)


def test_cost_of_one_stage_by_hand(problem, make_data):
    single = dc.replace(problem, horizon=1, terminal_weight=np.diag([1.0, 2.0, 3.0]))
    data = make_data(reference=np.array([[0.1, 0.2, 0.3], [9.0, 9.0, 9.0]]))
    value = cost(single, data, np.zeros(7))  # At rest at the origin, the wheels braked to 0.
    errors = 1001 * 0.1**2 + 1002 * 0.2**2 + 1003 * 0.3**2
    np.testing.assert_allclose(value, errors + 0.001 * (25 + 9 + 64 + 1))


@pytest.mark.parametrize("turns", [-2, 1, 5])
def test_reference_shifted_by_whole_turns_costs_the_same(either, make_data, z, turns):
    data = make_data()
    shifted = make_data(reference=data.reference + np.array([0, 0, 2 * np.pi * turns]))
    value, gradient = cost_and_gradient(either, data, z)
    shifted_value, shifted_gradient = cost_and_gradient(either, shifted, z)
    np.testing.assert_allclose(shifted_value, value, rtol=1e-12)
    np.testing.assert_allclose(shifted_gradient, gradient, rtol=1e-9, atol=1e-9)


def test_window_that_wraps_is_unwrapped_near_the_measured_yaw(either, make_data):
    straight = np.column_stack([np.zeros(11), np.zeros(11), np.linspace(3.0, 3.5, 11)])
    wrapped = straight - np.array([0, 0, 2 * np.pi]) * (straight[:, 2:] > np.pi)
    data = make_data(reference=wrapped, state=np.array([0.0, 0.0, 3.0 - 4 * np.pi]))
    first = int(either.aligned)
    expected = straight[first : first + 10] - np.array([0, 0, 4 * np.pi])
    before = wrapped.copy()
    np.testing.assert_allclose(pose(either, data).references, expected, atol=1e-12)
    np.testing.assert_array_equal(data.reference, before)


def test_gradient_equals_central_differences(either, make_data, z):
    _, gradient = cost_and_gradient(either, make_data(), z)
    differences = gradient_by_differences(either, make_data(), z)
    np.testing.assert_allclose(gradient, differences, rtol=1e-6, atol=1e-4)


def test_gradient_equals_autodiff_through_a_plain_loop(either, make_data, z):
    automatic = naive_cost(either, make_data(), InitializeAutoDiff(z).ravel())
    value, gradient = cost_and_gradient(either, make_data(), z)
    np.testing.assert_allclose(value, automatic.value())
    np.testing.assert_allclose(gradient, automatic.derivatives(), rtol=1e-10, atol=1e-9)


def test_gradient_of_a_model_with_more_states_than_the_pose(dynamic_problem, make_data):
    rng = np.random.default_rng(5)
    z = np.concatenate([0.1 * rng.normal(size=6), rng.uniform(-60, 60, 40)])
    data = make_data(state=z[:6], half_width=np.zeros(6))
    automatic = naive_cost(dynamic_problem, data, InitializeAutoDiff(z).ravel())
    value, gradient = cost_and_gradient(dynamic_problem, data, z)
    np.testing.assert_allclose(value, automatic.value())
    np.testing.assert_allclose(gradient, automatic.derivatives(), rtol=1e-10, atol=1e-9)


def test_hessian_is_symmetric_and_positive_definite(either, z):
    hessian = gauss_newton_hessian(either, z)
    np.testing.assert_allclose(hessian, hessian.T, rtol=1e-12)
    assert np.min(np.linalg.eigvalsh(hessian)) > 0.9 * 2 * 0.001


def test_hessian_is_exact_where_the_residual_is_zero(problem, make_data):
    # Steady straight driving along its own prediction: no tracking error in any stage.
    inputs = np.tile(steady_input(problem.model, np.array([0.1, 0.0, 0.0])), (10, 1))
    z = join(np.zeros(3), inputs)
    states = problem.model.roll_out(np.zeros(3), inputs, 0.1)
    data = make_data(state=np.zeros(3), reference=states)
    aligned = dc.replace(problem, aligned=True)
    differences = []
    for step in 1e-5 * np.eye(43):
        ahead, behind = (cost_and_gradient(aligned, data, z + s)[1] for s in (step, -step))
        differences.append((ahead - behind) / 2e-5)
    hessian = gauss_newton_hessian(aligned, z)
    np.testing.assert_allclose(hessian, differences, rtol=0, atol=1e-6 * np.max(hessian))


def test_hessian_of_a_model_with_more_states_than_the_pose(dynamic_problem):
    z = np.concatenate([np.full(6, 0.1), np.full(40, 20.0)])
    hessian = gauss_newton_hessian(dynamic_problem, z)
    assert hessian.shape == (46, 46)
    # Without weight on velocities each pose error is still seen, and each input is paid for.
    assert np.min(np.linalg.eigvalsh(hessian)) > 0


def test_constraint_bounds_by_hand(problem, make_data):
    limited = dc.replace(problem, rate_limit=np.array([1.0, 2.0, 3.0, 4.0]))
    data = make_data(
        half_width=np.array([0.1, 0.2, 0.3]), input_upper=90 + np.arange(40.0).reshape(10, 4)
    )
    posed = pose(limited, data)
    least, most = posed.least, posed.most
    np.testing.assert_allclose(least[:43], [-0.09, -0.22, -0.27, *np.full(40, -90.0)])
    np.testing.assert_allclose(most[:43], [0.11, 0.18, 0.33, *(90 + np.arange(40.0))])
    moves = slice(43, None)  # The first is limited against the previous input (5, -3, 8, 1).
    np.testing.assert_array_equal(least[moves][:8], [4.0, -5.0, 5.0, -3.0, -1, -2, -3, -4])
    np.testing.assert_array_equal(most[moves][:8], [6.0, -1.0, 11.0, 5.0, 1, 2, 3, 4])
    np.testing.assert_array_equal(most[moves][8:], np.tile([1.0, 2.0, 3.0, 4.0], 8))
    np.testing.assert_array_equal(least[moves][8:], -most[moves][8:])


def test_rate_matrix_gives_the_moves(problem):
    inputs = np.random.default_rng(6).normal(size=(10, 4))
    moves = rate_matrix(problem) @ join(np.array([7.0, 8.0, 9.0]), inputs)
    expected = np.concatenate([inputs[0], *(inputs[1:] - inputs[:-1])])
    assert rate_matrix(problem).shape == (40, 43)
    np.testing.assert_allclose(moves, expected)


def one_wheel(problem, lower, upper, previous=0.0):
    """Limits of a wheel with a rate limit of 30, the other three as always."""
    horizon = len(lower)
    small = dc.replace(problem, horizon=horizon)
    bounds = np.full((horizon, 4), -90.0), np.full((horizon, 4), 90.0)
    for bound, values in zip(bounds, (lower, upper), strict=True):
        bound[:, 1] = values
    data = TrackingData(
        np.zeros(3), np.zeros((horizon + 1, 3)), np.zeros(3), *bounds, np.array([0, previous, 0, 0])
    )
    return pose(small, data)


def test_limits_without_contradiction_are_the_bounds_and_the_rate_limit(problem):
    limits = one_wheel(problem, [-90.0] * 3, [90.0] * 3)
    np.testing.assert_array_equal(limits.lowest, limits.data.input_lower)
    np.testing.assert_array_equal(limits.highest, limits.data.input_upper)
    np.testing.assert_array_equal(limits.rate, np.full((3, 4), 30.0))
    assert not limits.relaxed and limits.note == ""


def test_limits_look_ahead_to_later_bounds(problem):
    limits = one_wheel(problem, [-90.0, -90, 50], [90.0, 90, 50])
    np.testing.assert_array_equal(limits.lowest[:, 1], [-10, 20, 50])
    np.testing.assert_array_equal(limits.highest[:, 1], [90, 80, 50])
    assert not limits.relaxed


@pytest.mark.parametrize("sign", [1, -1])
def test_first_rate_gives_way_by_just_what_the_bounds_ask_for(problem, sign):
    lower, upper = sorted(([sign * 50.0] * 3, [sign * 90.0] * 3))
    limits = one_wheel(problem, lower, upper, previous=sign * -5.0)
    assert limits.relaxed and limits.note == "bounds ask for a move of 55 pwm"
    np.testing.assert_array_equal(limits.rate[:, 1], [55, 30, 30])
    np.testing.assert_array_equal(limits.rate[:, [0, 2, 3]], 30.0)


def test_rates_give_way_late(problem):
    """Both (40, 40) and (30, 50) would do: the first move is the one that is applied."""
    limits = one_wheel(problem, [0.0, 50.0], [10.0, 60.0], previous=-30.0)
    np.testing.assert_array_equal(limits.rate[:, 1], [30, 50])
    np.testing.assert_array_equal(limits.highest[:, 1], [10, 60])


def test_a_later_rate_gives_way_where_two_stages_contradict_each_other(problem):
    limits = one_wheel(problem, [0.0, 70], [10.0, 90])
    np.testing.assert_array_equal(limits.rate[:, 1], [30, 60])
    np.testing.assert_array_equal(limits.lowest[:, 1], [10, 70])


@given(
    st.lists(st.tuples(st.floats(-90, 90), st.floats(0, 80)), min_size=1, max_size=8),
    st.floats(-90, 90),
    st.floats(-200, 200),
)
def test_projection_meets_bounds_and_rates_and_moves_nothing_that_does(
    problem, intervals, previous, wanted
):
    lower = np.array([low for low, _ in intervals])
    limits = one_wheel(problem, lower, lower + [w for _, w in intervals], previous)
    z = join(np.ones(3), np.full((len(intervals), 4), wanted))
    data, projected = limits.data, limits.project(z)
    inputs = projected[3:].reshape(-1, 4)
    np.testing.assert_array_equal(projected[:3], np.zeros(3))
    assert np.all(inputs >= data.input_lower) and np.all(inputs <= data.input_upper)
    moves = np.abs(np.diff(inputs, axis=0, prepend=data.previous_input[None]))
    assert np.all(moves <= limits.rate + 1e-12)
    np.testing.assert_array_equal(limits.project(projected), projected)


@given(
    st.lists(st.tuples(st.floats(-90, 90), st.floats(0, 80)), min_size=1, max_size=5),
    st.floats(-90, 90),
)
def test_relaxed_rates_take_the_least_slack_there_is(problem, intervals, previous):
    """The least |s|_1 with which a chain of inputs exists, by linear programming."""
    lower = np.array([low for low, _ in intervals])
    upper = lower + np.array([width for _, width in intervals])
    limits = one_wheel(problem, lower, upper, previous)
    N = len(intervals)
    D = np.eye(N) - np.eye(N, k=-1)
    offset = 30.0 + np.eye(N)[0] * previous, 30.0 - np.eye(N)[0] * previous
    result = linprog(
        np.r_[np.zeros(N), np.ones(N)],
        A_ub=np.block([[D, -np.eye(N)], [-D, -np.eye(N)]]),
        b_ub=np.r_[offset],
        bounds=[*zip(lower, upper, strict=True), *[(0, None)] * N],
    )
    slack = limits.rate[:, 1] - 30.0
    assert slack.sum() == pytest.approx(result.fun, abs=1e-6)


def test_shift_drops_the_first_input_and_repeats_the_last(problem):
    inputs = np.arange(40.0).reshape(10, 4)
    shifted = shift(problem, np.array([1.0, 2.0, 3.0]), inputs)
    expected = [1.0, 2.0, 3.0, *range(4, 40), 36.0, 37.0, 38.0, 39.0]
    np.testing.assert_array_equal(shifted, expected)


@pytest.mark.parametrize("name", ["input_weight", "rate_limit", "terminal_weight"])
def test_problem_of_wrong_shape(problem, name):
    with pytest.raises(ValueError, match=f"{name}: must have shape"):
        dc.replace(problem, **{name: np.eye(2)})


@pytest.mark.parametrize("name", ["reference", "half_width", "previous_input", "input_lower"])
def test_data_of_wrong_shape(problem, make_data, name):
    with pytest.raises(ValueError, match="problem data: "):
        pose(problem, make_data(**{name: np.zeros(1)}))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"half_width": np.array([0.1, -0.1, 0.1])}, "half_width .* is negative"),
        ({"state": np.array([0.0, np.nan, 0.0])}, "not finite"),
        (
            {"input_lower": np.full((10, 4), 95.0)},
            r"input_lower 95 is above input_upper 90 \(stage 0, wheel 0\)",
        ),
    ],
)
def test_what_no_solver_can_work_with(problem, make_data, changes, message):
    pose(problem, make_data())
    with pytest.raises(ValueError, match=message):
        pose(problem, make_data(**changes))


@pytest.mark.parametrize("field", ["state", "reference", "half_width", "previous_input"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_data_that_is_not_finite_is_found(make_data, field, value):
    assert make_data().is_finite()
    array = getattr(make_data(), field).copy()
    array.flat[-1] = value
    assert not make_data(**{field: array}).is_finite()
