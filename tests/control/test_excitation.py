import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mirte_drake.control.excitation import (
    MODES,
    PATTERNS,
    ExcitationConfig,
    excitation,
    template_targets,
)
from mirte_drake.model.model_file import load_model

CONFIG = ExcitationConfig()
RANDOM_INTERVALS = 200  # 60 s in control intervals of 0.3 s.
INTERVALS = 400
RAMP = 5  # Intervals in which 100 PWM go to zero by 20.
seeds = st.integers(0, 2**53)


def templates(seed) -> tuple[np.ndarray, np.ndarray]:
    """Random and pattern targets, one row each; they last four control intervals."""
    targets = template_targets(CONFIG, seed)[::4]
    return targets[: RANDOM_INTERVALS // 4], targets[RANDOM_INTERVALS // 4 : -RAMP // 4]


def mode_of(targets) -> np.ndarray:
    """Index in MODES of each row's signs, either direction."""
    matches = np.abs(np.sign(targets) @ MODES.T) == 4
    assert np.all(matches.sum(axis=1) == 1)
    return np.argmax(matches, axis=1)


def test_size():
    assert excitation(CONFIG, 0, 0.1).shape == (1200, 4)
    assert template_targets(CONFIG, 0).shape == (INTERVALS, 4)


@given(seeds)
def test_limits(seed):
    commands = excitation(CONFIG, seed, 0.3)
    from_rest_to_rest = np.vstack([np.zeros(4), commands, np.zeros(4)])
    assert np.max(np.abs(np.diff(from_rest_to_rest, axis=0))) <= 20 + 1e-9
    assert np.max(np.abs(commands)) <= 100
    np.testing.assert_array_equal(commands[-1], np.zeros(4))


@given(seeds)
def test_random_part_is_balanced_over_x_y_and_yaw(seed):
    modes = mode_of(templates(seed)[0])
    assert sorted(np.bincount(modes)) == [16, 17, 17]
    for begin in range(0, 48, 3):
        assert set(modes[begin : begin + 3]) == {0, 1, 2}


@given(seeds)
def test_random_magnitudes(seed):
    magnitude = np.abs(templates(seed)[0])
    assert np.all((magnitude >= 30) & (magnitude <= 100))
    assert np.all(np.ptp(magnitude, axis=1) > 0)


def test_random_magnitudes_fill_their_range_in_both_directions():
    targets = np.vstack([templates(seed)[0] for seed in range(20)])
    counts, _ = np.histogram(np.abs(targets), bins=7, range=(30, 100))
    assert np.all(np.abs(counts - 4000 / 7) < 100)  # Standard deviation 22.
    assert abs(np.mean(targets[:, 0] > 0) - 0.5) < 0.07  # Standard deviation 0.016.


@given(seeds)
def test_patterns_have_equal_magnitudes_and_all_occur(seed):
    patterns = templates(seed)[1]
    assert set(np.abs(patterns).ravel()) == {0.0, 50.0}
    seen = {tuple(row) for row in np.sign(patterns)}
    assert seen == {tuple(row) for row in PATTERNS.astype(float)}


def test_wheels_turn_alike_where_a_pattern_is_reached():
    commands, targets = excitation(CONFIG, 3, 0.3), template_targets(CONFIG, 3)
    reached = np.all(commands == targets, axis=1)[RANDOM_INTERVALS:-RAMP]
    assert np.mean(reached) > 0.1
    magnitude = np.abs(commands[RANDOM_INTERVALS:-RAMP][reached])
    assert np.all((magnitude == 0) | (magnitude == 50))


def test_modes_move_along_their_axis():
    velocity = load_model("kinematic").derivative(np.zeros((3, 3)), 50.0 * MODES)
    assert np.all(np.diag(velocity) > 0.1)
    # In units of what the axis' own mode gives, other modes move it little.
    relative = np.abs(velocity / np.diag(velocity))
    np.testing.assert_allclose(relative, np.eye(3), atol=0.3)


def test_first_template_is_approached_in_steps():
    target = template_targets(CONFIG, 1)[0]
    steps = 20.0 * np.array([[1], [2], [3], [4]])
    expected = np.sign(target) * np.minimum(steps, np.abs(target))
    np.testing.assert_allclose(excitation(CONFIG, 1, 0.3)[:4], expected, atol=1e-12)


def test_seed_determines_the_sequence():
    np.testing.assert_array_equal(excitation(CONFIG, 5, 0.1), excitation(CONFIG, 5, 0.1))
    assert np.any(excitation(CONFIG, 5, 0.1) != excitation(CONFIG, 6, 0.1))


def test_command_is_held_for_a_control_interval():
    commands = excitation(CONFIG, 0, 0.1).reshape(INTERVALS, 3, 4)
    np.testing.assert_array_equal(commands, np.broadcast_to(commands[:, :1], commands.shape))


@pytest.mark.parametrize("period", [0.1, 0.07, 1 / 3, 0.3])
def test_period_only_samples(period):
    steps, commands = excitation(CONFIG, 0, 0.3), excitation(CONFIG, 0, period)
    for k in range(len(commands)):
        index = [i for i in range(INTERVALS) if 0.3 * i <= k * period + 1e-6][-1]
        np.testing.assert_array_equal(commands[k], steps[index])
    assert (len(commands) - 1) * period < 120 <= len(commands) * period + 1e-9


def test_parts_can_be_left_out():
    only_random = template_targets(ExcitationConfig(random_duration=120.0), 0)
    mode_of(only_random[:-RAMP])
    only_patterns = template_targets(ExcitationConfig(random_duration=0.0), 0)
    assert set(np.abs(only_patterns).ravel()) == {0.0, 50.0}


@pytest.mark.parametrize(
    "bad",
    [
        {"duration": 0.5},
        {"duration": np.nan},
        {"control_interval": 0.0},
        {"template_interval": 0.2},
        {"random_duration": 121.0},
        {"random_duration": -1.0},
        {"min_magnitude": 101.0},
        {"max_magnitude": 101.0},
        {"pattern_magnitude": 0.0},
        {"max_change": 0.0},
    ],
)
def test_rejects_bad_config(bad):
    with pytest.raises(ValueError, match=f"^{next(iter(bad))}: "):
        excitation(ExcitationConfig(**bad), 0, 0.1)


@pytest.mark.parametrize("period", [0.0, -0.1, np.inf])
def test_rejects_bad_period(period):
    with pytest.raises(ValueError, match=r"^period: "):
        excitation(CONFIG, 0, period)
