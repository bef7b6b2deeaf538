import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mirte_drake.identification.ode45 import ode45


def van_der_pol(_t, y):
    return np.array([y[1], (1 - y[0] ** 2) * y[1] - y[0]])


def rigid_body(_t, y):
    return np.array([y[1] * y[2], -y[0] * y[2], -0.51 * y[0] * y[1]])


def pendulum(t, y):
    return np.array([y[1], -9.81 * np.sin(y[0]) + np.cos(3 * t)])


# What `odeset('Stats', 'on')` prints for MATLAB's own examples vdpode (mu = 1) and rigidode.
@pytest.mark.parametrize(
    ("system", "end", "start", "steps", "failed", "evaluations"),
    [(van_der_pol, 20.0, [2.0, 0.0], 59, 10, 415), (rigid_body, 12.0, [0.0, 1.0, 1.0], 19, 2, 127)],
)
def test_takes_the_steps_that_matlab_takes(system, end, start, steps, failed, evaluations):
    calls = []
    solution = ode45(
        lambda t, y: calls.append(t) or system(t, y), np.array([0.0, end]), np.array(start)
    )
    assert len(solution.step_times) - 1 == steps
    assert solution.failed_steps == failed
    assert len(calls) == evaluations


@pytest.mark.parametrize(
    ("system", "start"),
    [(van_der_pol, [2.0, 0.0]), (rigid_body, [0.0, 1.0, 1.0]), (pendulum, [1.0, 0.0])],
)
def test_agrees_with_scipy(system, start):
    times = np.linspace(0.0, 10.0, 173)
    truth = solve_ivp(
        system, (0.0, 10.0), start, method="DOP853", t_eval=times, rtol=1e-12, atol=1e-12
    ).y.T
    start = np.array(start)
    tight = ode45(system, times, start, relative_tolerance=1e-10, absolute_tolerance=1e-10)
    np.testing.assert_allclose(tight.states, truth, rtol=0, atol=1e-7)
    loose = ode45(system, times, start).states  # Local tolerance 1e-3: the global error is larger.
    assert 1e-6 < np.max(np.abs(loose - truth)) < 0.2


def errors_at_step(h):
    """Error after one step of length h, and at the middle of the next one."""
    times = np.array([0.0, h, 1.5 * h, 10 * h])  # A tolerance that is always met: all steps are h.
    start = np.array([1.0, 0.5])
    solution = ode45(pendulum, times, start, relative_tolerance=1.0, absolute_tolerance=1e9)
    np.testing.assert_allclose(np.diff(solution.step_times), h)
    truth = solve_ivp(
        pendulum, (0, 1.5 * h), start, method="DOP853", t_eval=times[:3], rtol=1e-13, atol=1e-15
    ).y.T
    return np.abs(solution.states[1:3] - truth[1:]).max(axis=1)


def test_a_step_is_of_order_five_and_its_interpolant_of_order_four():
    ends, middles = np.array([errors_at_step(h) for h in (0.08, 0.04, 0.02)]).T
    np.testing.assert_allclose(np.log2(ends[:-1] / ends[1:]), 6, atol=0.5)  # Local error h^6.
    np.testing.assert_allclose(np.log2(middles[:-1] / middles[1:]), 5, atol=0.5)  # And h^5.


def test_the_interpolant_is_exact_for_a_polynomial_of_degree_four():
    times = np.linspace(0.0, 2.0, 41)
    solution = ode45(lambda t, y: np.array([5 * t**3 - t]), times, np.zeros(1))
    np.testing.assert_allclose(solution.states[:, 0], 1.25 * times**4 - times**2 / 2, atol=1e-13)


def test_steps_are_at_most_a_tenth_of_the_interval():
    solution = ode45(lambda t, y: np.ones(1), np.array([1.0, 4.0]), np.full(1, 100.0))
    steps = np.diff(solution.step_times)
    np.testing.assert_allclose(steps, 0.3, rtol=1e-12)
    assert solution.step_times[-1] == 4.0


def test_output_times_do_not_move_the_steps_beyond_the_first():
    few = ode45(van_der_pol, np.array([0.0, 0.05, 5.0]), np.array([2.0, 0.0]))
    many = ode45(van_der_pol, np.linspace(0.0, 5.0, 101), np.array([2.0, 0.0]))
    np.testing.assert_array_equal(few.step_times, many.step_times)
    np.testing.assert_array_equal(few.states[-1], many.states[-1])


def test_passes_over_a_pulse_that_no_stage_meets():
    # The fault of the published numbers: an input that is on for a short time has no effect.
    pulse = ode45(
        lambda t, y: np.array([float(5.011 < t < 5.029)]), np.array([0.0, 1.0, 10.0]), np.zeros(1)
    )
    assert pulse.states[-1] == 0.0


@pytest.mark.parametrize("times", [[0.0], [0.0, 0.0, 1.0], [1.0, 0.0]])
def test_rejects_times_that_do_not_increase(times):
    with pytest.raises(ValueError, match="times"):
        ode45(van_der_pol, np.array(times), np.zeros(2))


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_says_where_it_cannot_go_on():
    with pytest.raises(ArithmeticError, match=r"t = 0\.99"):
        ode45(lambda t, y: y**2, np.array([0.0, 2.0]), np.ones(1))
    with pytest.raises(ArithmeticError, match="t = 0 s"):
        ode45(lambda t, y: np.full(1, np.nan), np.array([0.0, 1.0]), np.ones(1))
