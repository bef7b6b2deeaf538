"""How often sets hold the one-step errors of the robot's recordings: published and calibrated."""

import numpy as np
import pytest

from mirte_drake.control.conformal import (
    AdaptiveConformal,
    adapt,
    box_scores,
    first_calibration,
    missed,
)
from mirte_drake.identification.csv_file import load_csv
from mirte_drake.identification.one_step_bound import one_step_error
from mirte_drake.model.model_file import load_model

MODEL = load_model("extended_kinematic")
PUBLISHED = np.array([0.04, 0.03, 0.09])  # [m/s, m/s, rad/s]
runs = pytest.mark.parametrize(
    "name", ["training_data", "validation_const_rect", "validation_turn_rect"]
)


def scores_of(recordings, name) -> np.ndarray:
    return box_scores(one_step_error(MODEL, load_csv(recordings / f"{name}.csv")), PUBLISHED)


@runs
def test_the_published_set_misses_most_errors(recordings, name):
    assert np.mean(scores_of(recordings, name) <= 1.0) < 0.35


@runs
@pytest.mark.parametrize("target", [0.9, 0.95])
def test_the_calibrated_set_holds_its_target_within_two_points(recordings, name, target):
    settings = AdaptiveConformal(target=target)
    calibration, misses = first_calibration(settings), []
    for score in scores_of(recordings, name):
        misses.append(missed(calibration, score))
        calibration = adapt(settings, calibration, score)
    assert abs(1.0 - np.mean(misses) - target) <= 0.02
