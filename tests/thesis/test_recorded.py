import numpy as np
import pytest

from mirte_drake.errors import UserError
from mirte_drake.thesis.published import VALIDATION_RMSE
from mirte_drake.thesis.recorded import FILES, recorded_figure


@pytest.mark.parametrize("number", ["3-3", "3-4"])
def test_what_is_drawn_has_the_published_rmse(number, recordings):
    figure = recorded_figure(number, recordings)
    rows = {row[0]: [float(value) for value in row[1:]] for row in figure.table.rows}
    for name, published in VALIDATION_RMSE[number].items():
        label = name.replace("_", " ")
        assert rows[f"{label}, published"] == list(published)
        # To the printed digit, of which the last may be rounded the other way.
        np.testing.assert_allclose(rows[f"{label}, as drawn"], published, rtol=0, atol=0.0061)
    yaw = rows["extended kinematic, exact"][2]
    assert yaw != rows["extended kinematic, as drawn"][2]


def test_curves_are_the_recording_and_the_models(recordings):
    figure = recorded_figure("3-3", recordings)
    _, draw = figure.parts["a"]
    labels = [line.get_label() for line in draw().axes[0].get_lines()]
    assert labels == ["measured", "kinematic", "extended kinematic", "dynamic", "start"]


@pytest.mark.slow
def test_the_training_data_and_its_derivative(recordings):
    figure = recorded_figure("3-2", recordings)
    assert list(figure.parts) == ["a", "b", "c", "d"]
    assert "differs by 0.021 m/s, 0.021 m/s and 0.053 rad/s" in figure.ours
    assert "800 samples" in figure.published


@pytest.mark.parametrize("number", FILES)
def test_a_missing_recording_is_named(number, tmp_path):
    with pytest.raises(UserError, match=f"has no {FILES[number]}, which figure {number} needs"):
        recorded_figure(number, tmp_path)
