import numpy as np
import pytest

from mirte_drake.model.model_file import load_model
from mirte_drake.model.roll_forward import roll_forward

MODEL = load_model("kinematic")
FORWARD, TURN = np.full(4, 50.0), np.array([-20.0, 20.0, 20.0, -20.0])
START = np.array([0.3, -0.2, 0.4])


def test_commands_in_force_one_after_the_other():
    sent = [(0.0, FORWARD), (0.1, TURN), (0.2, FORWARD)]
    after = roll_forward(MODEL, START, sent, 0.07, 0.22)
    expected = MODEL.step(START, FORWARD, 0.03)
    expected = MODEL.step(expected, TURN, 0.1)
    expected = MODEL.step(expected, FORWARD, 0.02)
    np.testing.assert_allclose(after, expected, atol=1e-12)


def test_the_wheels_stand_before_the_first_command():
    after = roll_forward(MODEL, START, [(1.0, FORWARD)], 0.5, 1.1)
    np.testing.assert_allclose(after, MODEL.step(START, FORWARD, 0.1), atol=1e-12)


@pytest.mark.parametrize("end", [0.1, 0.05])
def test_nothing_to_predict(end):
    np.testing.assert_array_equal(roll_forward(MODEL, START, [(0.0, FORWARD)], 0.1, end), START)
    np.testing.assert_array_equal(roll_forward(MODEL, START, [], 0.1, 0.3), START)


def test_commands_of_the_future_do_not_count():
    sent = [(0.0, FORWARD), (0.5, TURN)]
    after = roll_forward(MODEL, START, sent, 0.1, 0.3)
    np.testing.assert_allclose(after, MODEL.step(START, FORWARD, 0.2), atol=1e-12)
