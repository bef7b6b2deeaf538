import numpy as np
import pytest
from scipy.linalg import expm

from mirte_drake.control.dlqr import design_dlqr
from mirte_drake.control.lagged_axis import axis_model
from mirte_drake.control.loop_analysis import (
    delay_margin,
    late_axis_model,
    observer_loop,
    pose_feedback_loop,
    spectral_radius,
)
from mirte_drake.model.model_file import load_model
from mirte_drake.scenario_file import load_scenario
from mirte_drake.systems.ancillary_lagged import AncillaryLaggedConfig
from mirte_drake.systems.state_estimator import StateEstimatorConfig

T = 0.1
# [s] Of the training recording by a regression of each axis, FACTS section 2, and of our model.
REGRESSED = np.array([0.36, 0.41, 0.30])
IDENTIFIED = load_model("lagged").parameters.lag
MULTIBODY = load_model("lagged_multibody").parameters.lag
RECKONED = load_scenario("lagged_rectangle").delay  # [samples]


def published_gain() -> np.ndarray:
    """Velocities that the published ancillary law asks for, per error of the pose, at rest."""
    model, x, u = load_model("extended_kinematic"), np.zeros(3), np.zeros(4)
    design = design_dlqr(model, x, u, T, 1000 * np.eye(3), 0.001 * np.eye(4))
    return model.linearise(x, u)[2] @ design.gain


def our_gains(lag) -> tuple[np.ndarray, np.ndarray]:
    return AncillaryLaggedConfig().gains(lag, T), StateEstimatorConfig().gains(lag, T)


def our_radius(lag, delay, known_delay) -> float:
    K, L = our_gains(lag)
    return max(
        spectral_radius(observer_loop(K[i], L[i], lag[i], T, delay, known_delay=known_delay))
        for i in range(3)
    )


def test_a_delay_within_the_sample_switches_within_the_sample():
    A, before, now = late_axis_model(0.25, T, 0.3)
    F, G = np.array([[0.0, 1.0], [0.0, -4.0]]), np.array([0.0, 4.0])

    def advance(x, r, duration):
        block = expm(duration * np.block([[F, G[:, None]], [np.zeros((1, 3))]]))
        return block[:2, :2] @ x + block[:2, 2] * r

    x = np.array([0.1, 0.2])
    expected = advance(advance(x, 0.5, 0.03), -0.7, 0.07)
    np.testing.assert_allclose(A @ x + 0.5 * before - 0.7 * now, expected, rtol=1e-12)


@pytest.mark.parametrize(("samples", "radius"), [(0, 0.90), (1, 1.00), (2, 1.06)])
def test_the_published_law_on_the_regressed_lag(samples, radius):
    loop = pose_feedback_loop(published_gain(), REGRESSED, T, samples * T)
    assert spectral_radius(loop) == pytest.approx(radius, abs=0.006)


def test_the_published_law_has_a_margin_of_about_one_sample():
    gain = published_gain()
    assert delay_margin(lambda d: pose_feedback_loop(gain, REGRESSED, T, d)) == pytest.approx(
        0.104, abs=0.002
    )


@pytest.mark.parametrize("lag", [IDENTIFIED, REGRESSED, MULTIBODY])
def test_our_law_meets_its_targets_with_any_delay_up_to_two_samples(lag):
    """One law, which reckons with one sample, whatever the delay is."""
    radii = [our_radius(lag, samples * T, RECKONED) for samples in range(3)]
    assert radii[0] <= 0.85 and radii[1] < 0.85 and radii[2] < 0.95


def test_our_law_has_more_than_twice_the_margin():
    gain, (K, L) = published_gain(), our_gains(IDENTIFIED)
    published = delay_margin(lambda d: pose_feedback_loop(gain, IDENTIFIED, T, d))

    def ours(delay) -> np.ndarray:
        axes = zip(K, L, IDENTIFIED, strict=True)
        return np.array([observer_loop(*axis, T, delay, known_delay=RECKONED) for axis in axes])

    assert published == pytest.approx(0.114, abs=0.002)
    assert delay_margin(ours) == pytest.approx(0.290, abs=0.005)


def test_known_delay_adds_no_pole_but_zero():
    K, L = our_gains(IDENTIFIED)
    poles = [
        np.linalg.eigvals(observer_loop(K[0], L[0], IDENTIFIED[0], T, d * T, known_delay=d))
        for d in (0, 2)
    ]
    moving = [np.sort_complex(p[np.abs(p) > 1e-3]) for p in poles]
    np.testing.assert_allclose(moving[0], moving[1], atol=1e-6)
    # They are those of the law and of the observer.
    A, B = axis_model(IDENTIFIED[0], T)
    for pole in np.linalg.eigvals(A - B * K[0]):
        assert np.min(np.abs(moving[0] - pole)) < 1e-6


def test_a_loop_that_nothing_unsettles_has_no_margin():
    assert delay_margin(lambda d: np.array([[0.5]])) == np.inf
    assert delay_margin(lambda d: np.array([[1.5]])) == 0.0
