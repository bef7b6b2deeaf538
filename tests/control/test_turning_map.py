import numpy as np
import pytest

from mirte_drake.control.input_inversion import jacobian, velocity
from mirte_drake.control.turning_map import turning_map
from mirte_drake.model.model_file import load_model
from mirte_drake.model.sparse_model import SparseModel

LINEAR = {"x": {"u1": 0.01}, "y": {"u2": 0.01}, "theta": {"u3": 0.01}}


def make_model(**derivatives) -> SparseModel:
    inputs = ["u1", "u2", "u3", "u4"]
    return SparseModel("by hand", ["x", "y", "theta"], inputs, LINEAR | derivatives)


@pytest.mark.parametrize("name", ["kinematic", "extended_kinematic"])
def test_it_is_the_model_at_every_yaw(name):
    model, rng = load_model(name), np.random.default_rng(0)
    mapping = turning_map(model)
    for _ in range(20):
        x, u = rng.normal(scale=5.0, size=3), rng.uniform(-100, 100, 4)
        f, A, B = model.linearise(x, u)
        at = mapping.at(x[2])
        np.testing.assert_allclose(velocity(at, u), f, rtol=0, atol=1e-13)
        np.testing.assert_allclose(jacobian(at, u), B, rtol=0, atol=1e-15)
        by_yaw = velocity(mapping.turned(x[2] + np.pi / 2), u)
        np.testing.assert_allclose(by_yaw, A[:, 2], rtol=0, atol=1e-13)


def test_mean_of_an_input_with_that_yaw_rate_is_the_models_step():
    model, rng = load_model("extended_kinematic"), np.random.default_rng(1)
    mapping = turning_map(model)
    for _ in range(20):
        x, u = rng.normal(scale=5.0, size=3), rng.uniform(-100, 100, 4)
        rate = velocity(mapping.still, u)[2]
        moved = x + 0.1 * velocity(mapping.over(x[2], rate, 0.1), u)
        np.testing.assert_allclose(moved, model.step(x, u, 0.1), rtol=0, atol=1e-13)


def test_parts_by_hand():
    mapping = turning_map(
        make_model(
            x={"u1": 1.0, "sin(theta)*u2": 2.0},
            y={"cos(theta)*u3": 3.0, "1": 0.5},
            theta={"u4": 4.0, "u1*u2": 0.25},
        )
    )
    expected = np.zeros((3, 3, 4))
    expected[0, 0, 0], expected[0, 2, 3] = 1.0, 4.0  # Still: x by u1, yaw by u4.
    expected[1, 0, 1], expected[2, 1, 2] = 2.0, 3.0
    for part, linear in zip(mapping, expected, strict=True):
        np.testing.assert_allclose(part.linear, linear, atol=1e-12)
    np.testing.assert_allclose(mapping.still.offset, [0.0, 0.5, 0.0], atol=1e-12)
    product = np.zeros((4, 4))
    product[0, 1] = product[1, 0] = 0.125
    np.testing.assert_allclose(mapping.still.quadratic[2], product, atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"x": {"sin(theta)*sin(theta)*u1": 0.01}}, "sin and cos of yaw alone"),
        ({"x": {"x": 0.01, "u1": 0.01}}, "sin and cos of yaw alone"),
        ({"theta": {"cos(theta)*u3": 0.01}}, "yaw rate must not depend on the yaw"),
        ({"theta": {"u1*u2*u3": 1e-6}}, "at most two inputs"),
    ],
)
def test_other_models_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        turning_map(make_model(**changes))


def test_a_model_with_velocity_states_is_refused():
    with pytest.raises(ValueError, match="must have the pose as its state"):
        turning_map(load_model("dynamic"))
