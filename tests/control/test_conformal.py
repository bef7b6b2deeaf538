import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from mirte_drake.control.conformal import (
    AdaptiveConformal,
    adapt,
    box_scores,
    conformal_rank,
    first_calibration,
    missed,
)


def judge(options: AdaptiveConformal, scores) -> tuple[np.ndarray, np.ndarray]:
    """Returns which scores were missed, and the scales that they were judged by."""
    calibration, misses, scales = first_calibration(options), [], []
    for score in scores:
        misses.append(missed(calibration, score))
        scales.append(calibration.scale)
        calibration = adapt(options, calibration, score)
    return np.array(misses), np.array(scales)


def test_rank_by_hand():
    assert [conformal_rank(n, 0.9) for n in (8, 9, 10, 19)] == [9, 9, 10, 18]


def test_a_further_exchangeable_score_is_within_the_rank_as_often_as_stated():
    rng = np.random.default_rng(0)
    for n, level in ((19, 0.9), (30, 0.8)):
        scores = np.sort(rng.exponential(size=(20000, n)), axis=1)
        within = rng.exponential(size=20000) <= scores[:, conformal_rank(n, level) - 1]
        assert level - 0.01 <= within.mean() <= level + 1 / (n + 1) + 0.01


def test_scores_by_hand():
    errors = np.array([[0.04, 0.0, 0.0], [-0.02, -0.06, 0.09]])
    np.testing.assert_allclose(box_scores(errors, np.array([0.04, 0.03, 0.09])), [1.0, 2.0])


def test_steps_by_hand():
    options = AdaptiveConformal(target=0.75, gain=0.1, window=3, cap=5.0)
    calibration = first_calibration(options, scale=1.0)
    assert (calibration.miss_rate, calibration.scale) == (0.25, 1.0)
    calibration = adapt(options, calibration, 2.0)  # Missed: 0.25 + 0.1 (0.25 - 1).
    assert calibration.miss_rate == pytest.approx(0.175)
    assert calibration.scale == 2.0  # The largest of one score.
    calibration = adapt(options, calibration, 0.5)  # Held: + 0.025.
    calibration = adapt(options, calibration, 1.0)
    assert calibration.miss_rate == pytest.approx(0.225)
    assert calibration.scale == 2.0  # Rank ceil(4 * 0.775) = 4, of three scores.
    calibration = adapt(options, calibration, 0.25)  # 2.0 leaves the window.
    assert_array_equal(calibration.scores, [0.5, 1.0, 0.25])
    assert calibration.miss_rate == pytest.approx(0.25)
    assert calibration.scale == 1.0  # Rank ceil(4 * 0.75) = 3.


def test_the_set_is_capped_and_empty_at_the_ends():
    options = AdaptiveConformal(target=0.9, gain=0.6, window=5, cap=3.0)
    after_a_miss = adapt(options, first_calibration(options), 2.0)
    assert after_a_miss.miss_rate < 0 and after_a_miss.scale == 3.0
    calibration = first_calibration(AdaptiveConformal(target=0.1, gain=1.0))
    calibration = adapt(AdaptiveConformal(target=0.1, gain=1.0), calibration, 0.5)
    assert calibration.miss_rate >= 1.0 and calibration.scale == 0.0
    assert missed(calibration, 0.0)


def test_scores_above_the_cap_are_missed_and_change_no_rate():
    options = AdaptiveConformal(cap=3.0)
    before = first_calibration(options)
    after = adapt(options, before, 7.0)
    assert missed(before, 7.0) and after.miss_rate == before.miss_rate
    assert after.scale == 3.0


sequences = st.one_of(
    st.lists(st.floats(0.0, 12.0), min_size=1, max_size=300),
    st.lists(st.sampled_from([0.0, 0.5, 1.0, 2.0, 11.0]), min_size=1, max_size=300),
)


@settings(max_examples=60, deadline=None)
@given(sequences, st.floats(0.05, 0.95), st.floats(0.01, 1.0), st.integers(1, 50))
def test_the_guarantee_holds_for_any_sequence(scores, target, gain, window):
    options = AdaptiveConformal(target=target, gain=gain, window=window, cap=10.0)
    misses, _ = judge(options, scores)
    counted = misses[np.array(scores) <= 10.0]
    if len(counted):
        rate = 1.0 - target
        bound = (max(rate, 1.0 - rate) + gain) / (gain * len(counted))
        assert abs(np.mean(counted) - rate) <= bound + 1e-9


def test_an_opponent_that_knows_the_set_cannot_break_the_guarantee():
    options = AdaptiveConformal(target=0.9, gain=0.05, cap=10.0)
    calibration, misses = first_calibration(options), []
    for _ in range(2000):
        score = min(1.001 * calibration.scale, options.cap)  # Just outside whenever possible.
        misses.append(missed(calibration, score))
        calibration = adapt(options, calibration, score)
    assert abs(np.mean(misses) - 0.1) <= 0.95 / (0.05 * 2000)


def test_it_follows_errors_that_change():
    rng = np.random.default_rng(1)
    sizes = np.repeat([1.0, 4.0, 0.5], 600)
    scores = sizes * np.abs(rng.normal(size=1800))
    misses, scales = judge(AdaptiveConformal(target=0.9, gain=0.05, window=100, cap=50.0), scores)
    for part in np.split(misses, 3):
        assert abs(np.mean(part) - 0.1) < 0.035
    medians = [np.median(part[200:]) for part in np.split(scales, 3)]
    np.testing.assert_allclose(medians, 1.645 * np.array([1.0, 4.0, 0.5]), rtol=0.25)


def test_correlated_errors_are_covered_on_average():
    rng, scores, x = np.random.default_rng(2), [], 0.0
    for _ in range(3000):
        x = 0.9 * x + rng.normal()
        scores.append(abs(x))
    misses, _ = judge(AdaptiveConformal(cap=50.0), scores)
    assert abs(np.mean(misses) - 0.1) < 0.01


@pytest.mark.parametrize(
    ("field", "value"),
    [("target", 0.0), ("target", 1.0), ("gain", 0.0), ("gain", 1.5), ("window", 0), ("cap", 0.0)],
)
def test_rejects_bad_settings(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        AdaptiveConformal(**{field: value}).validate()


@pytest.mark.parametrize(
    ("window", "kept"),
    [
        (50, 8),  # A 90 % quantile takes nine scores.
        (5, 4),  # Which a window of five never has: full, it does with what there is.
    ],
)
def test_a_few_small_scores_do_not_make_the_set_smaller(window, kept):
    settings = AdaptiveConformal(target=0.9, gain=0.05, window=window, cap=10.0)
    calibration, scales = first_calibration(settings, 1.0), []
    for _ in range(12):
        calibration = adapt(settings, calibration, 0.1)
        scales.append(calibration.scale)
    assert scales[: kept + 1] == [1.0] * kept + [0.1]
