import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.symbolic import Variable

from mirte_drake.model.model_file import load_model, load_model_file, model_names
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.model.sparse_model import SparseModel

NAMES = [name for name in model_names() if load_model_file(name).lagged is None]


@pytest.fixture(scope="module", params=NAMES)
def model(request) -> SparseModel:
    return load_model(request.param)


@pytest.fixture
def points(model) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    return rng.normal(size=(2, 5, model.num_states)), rng.uniform(-90, 90, (2, 5, 4))


def test_kinematic_models_have_the_pose_and_the_dynamic_one_its_rates():
    pose = ("x", "y", "theta")
    assert load_model("kinematic").states == load_model("extended_kinematic").states == pose
    assert load_model("dynamic").states == (*pose, "x_dot", "y_dot", "theta_dot")
    assert all(load_model(name).inputs == ("u1", "u2", "u3", "u4") for name in NAMES)


@pytest.mark.parametrize(
    ("yaw", "u", "expected"),
    [
        # x and y: constant plus cos(theta) column; yaw: linear plus square.
        (0, [100, 0, 0, 0], [0.205432, -0.037275, -0.43797 - 0.71607]),
        (0, [0, 100, 0, 0], [0.190356, 0.083281, 0.8181]),
        (0, [0, 0, 100, 0], [0.162802, -0.103715, 0.46648 - 0.30088]),
        (0, [0, 0, 0, 100], [0.103556, 0.042914, -0.78721 + 0.27602]),
        # Constant plus sin(theta) column.
        (90, [100, 0, 0, 0], [0.036195, 0.18045, -0.43797 - 0.71607]),
        (90, [0, 100, 0, 0], [-0.110828, 0.17564, 0.8181]),
        (90, [0, 0, 100, 0], [0.116427, 0.201897, 0.46648 - 0.30088]),
        (90, [0, 0, 0, 100], [-0.053788, 0.166747, -0.78721 + 0.27602]),
        # The products of two wheels add to the single wheels.
        (0, [100, 100, 0, 0], [0.395788, 0.046006, -1.15404 + 0.8181 - 0.72158]),
        (0, [100, 0, 100, 0], [0.368234, -0.14099, -1.15404 + 0.1656 + 1.1008]),
        (0, [100, 0, 0, 100], [0.308988, 0.005639, -1.15404 - 0.51119 + 0.16506]),
        (0, [0, 100, 100, 0], [0.353158, -0.020434, 0.8181 + 0.1656 + 0.51765]),
        (0, [0, 100, 0, 100], [0.293912, 0.126195, 0.8181 - 0.51119 - 0.21046]),
        (0, [0, 0, 100, 100], [0.266358, -0.060801, 0.1656 - 0.51119]),
    ],
)
def test_extended_kinematic_model_by_hand(yaw, u, expected):
    model = load_model("extended_kinematic")
    x = np.array([7.0, -8.0, np.radians(yaw)])
    np.testing.assert_allclose(model.derivative(x, np.array(u)), expected, rtol=0, atol=1e-12)


def test_kinematic_model_by_hand():
    model = load_model("kinematic")
    u = np.array([10.0, 20.0, 30.0, 40.0])
    yaw_rate = -0.067258 + 0.138158 + 0.197883 - 0.267384
    ahead = [0.023453 + 0.04748 + 0.041667 + 0.033176, None, yaw_rate]
    ahead[1] = -0.008759 + 0.0138616 - 0.0234309 + 0.0349728
    aside = [0.0033047 - 0.0175064 + 0.032904 - 0.0247944, None, yaw_rate]
    aside[1] = 0.015423 + 0.036544 + 0.064473 + 0.073876
    np.testing.assert_allclose(model.derivative(np.zeros(3), u), ahead, atol=1e-12)
    np.testing.assert_allclose(model.derivative(np.array([0, 0, np.pi / 2]), u), aside, atol=1e-12)


def test_dynamic_model_takes_body_velocities_at_a_turned_heading():
    yaw, x_dot, y_dot, yaw_rate = 0.8, 0.3, -0.2, 0.5
    u1, u2, u3, u4 = u = np.array([50.0, -20.0, 70.0, 10.0])
    sin, cos = np.sin(yaw), np.cos(yaw)
    vx, vy = cos * x_dot + sin * y_dot, cos * y_dot - sin * x_dot
    along_x = 1.037 * sin * vy - 1.167 * cos * vx
    along_x += sin * (0.0012988 * u1 - 0.00040258 * u2 + 0.00091462 * u3 - 0.0025439 * u4)
    along_x += cos * (0.002428 * u1 + 0.001833 * u2 + 0.0026499 * u3 + 0.0028136 * u4)
    along_y = -1.3093 * sin * vx - 2.2961 * cos * vy
    along_y += sin * (0.0022445 * u1 + 0.0032406 * u2 + 0.0027253 * u3 + 0.0034616 * u4)
    along_y += cos * (-0.00090785 * u1 + 0.0013923 * u2 - 0.0024104 * u3 + 0.0027898 * u4)
    turn = -1.2711 * yaw_rate - 0.0078466 * u1 + 0.011304 * u2 + 0.010035 * u3 - 0.011928 * u4
    x = np.array([4.0, 5.0, yaw, x_dot, y_dot, yaw_rate])
    expected = [x_dot, y_dot, yaw_rate, along_x, along_y, turn]
    np.testing.assert_allclose(load_model("dynamic").derivative(x, u), expected, rtol=1e-13)


def test_batches_equal_single_evaluation(model, points):
    xs, us = points
    batch = (
        model.derivative(xs, us),
        *model.linearise(xs, us),
        model.step(xs, us, 0.1),
        model.step_jacobians(xs, us, 0.1),
    )
    for index in np.ndindex(2, 5):
        x, u = xs[index], us[index]
        single = (
            model.derivative(x, u),
            *model.linearise(x, u),
            model.step(x, u, 0.1),
            model.step_jacobians(x, u, 0.1),
        )
        for many, one in zip(batch, single, strict=True):
            np.testing.assert_allclose(many[index], one, rtol=1e-13, atol=1e-13)


def test_compiled_code_equals_the_general_path(model, points):
    """What every PredictionModel inherits: RK4 and its Jacobians from derivative, linearise."""
    xs, us = points
    x, inputs = xs[0, 0], us[0]
    general = PredictionModel
    np.testing.assert_allclose(
        model.step(xs, us, 0.1), general.step(model, xs, us, 0.1), rtol=1e-12, atol=1e-12
    )
    np.testing.assert_allclose(
        model.step_jacobians(xs, us, 0.1),
        general.step_jacobians(model, xs, us, 0.1),
        rtol=1e-11,
        atol=1e-12,
    )
    compiled = model.roll_out_jacobians(x, inputs, 0.1)
    for one, other in zip(compiled, general.roll_out_jacobians(model, x, inputs, 0.1), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-11)
    np.testing.assert_array_equal(model.roll_out(x, inputs, 0.1), compiled[0])


@pytest.mark.parametrize("kind", [np.asfortranarray, lambda a: a[::-1][::-1], np.float32])
def test_arrays_of_any_layout(model, points, kind):
    xs, us = points
    x, u = xs[0].astype(np.float32).astype(float), us[0].astype(np.float32).astype(float)
    np.testing.assert_array_equal(model.derivative(kind(x), kind(u)), model.derivative(x, u))
    read_only = x.copy()
    read_only.setflags(write=False)
    np.testing.assert_array_equal(model.derivative(read_only, u), model.derivative(x, u))


def test_linearisation_equals_autodiff(model, points):
    n = model.num_states
    x, u = points[0][0, 0], points[1][0, 0]
    xu = InitializeAutoDiff(np.concatenate([x, u])).ravel()
    automatic = model.derivative(xu[:n], xu[n:])
    f, A, B = model.linearise(x, u)
    np.testing.assert_allclose(f, ExtractValue(automatic).ravel(), rtol=1e-13)
    np.testing.assert_allclose(np.hstack([A, B]), ExtractGradient(automatic), atol=1e-14)


def test_linearisation_equals_central_differences(model, points):
    x, u = points[0][1, 2], points[1][1, 2]
    _, A, B = model.linearise(x, u)
    h, f = 1e-5, model.derivative
    by_x = [(f(x + e, u) - f(x - e, u)) / (2 * h) for e in h * np.eye(model.num_states)]
    by_u = [(f(x, u + e) - f(x, u - e)) / (2 * h) for e in h * np.eye(4)]
    np.testing.assert_allclose(A, np.transpose(by_x), atol=1e-8)
    np.testing.assert_allclose(B, np.transpose(by_u), atol=1e-8)


def test_symbolic_derivative_has_the_float_value(model, points):
    x, u = points[0][0, 1], points[1][0, 1]
    symbols = np.array([Variable(name) for name in (*model.states, *model.inputs)])
    environment = dict(zip(symbols, np.concatenate([x, u]), strict=True))
    n = model.num_states
    with np.errstate(invalid="ignore"):  # Of Drake's Expression in numpy's object loops.
        expressions = model.derivative(symbols[:n], symbols[n:])
    actual = [e.Evaluate(environment) for e in expressions]
    np.testing.assert_allclose(actual, model.derivative(x, u), rtol=1e-12)


def test_roll_out_equals_repeated_steps(model, points):
    x = points[0][0, 0]
    inputs = points[1].reshape(-1, 4)
    states = [x]
    for u in inputs:
        states.append(model.step(states[-1], u, 0.1))
    rolled = model.roll_out(x, inputs, 0.1)
    assert rolled.shape == (11, model.num_states)
    np.testing.assert_allclose(rolled, states, rtol=0, atol=1e-12)


def test_roll_out_of_no_inputs_is_the_start(model):
    x = np.arange(float(model.num_states))
    np.testing.assert_array_equal(model.roll_out(x, np.empty((0, 4)), 0.1), [x])


def table(**changes) -> dict:
    """A model of three states whose velocity depends on x, for the constructor."""
    content = {
        "name": "small",
        "states": ["x", "y", "theta"],
        "inputs": ["u1"],
        "derivatives": {"x": {"x": -1.0}, "y": {"1": 2.0}, "theta": {"u1": 3.0}},
    }
    return content | changes


def test_roll_out_of_a_model_that_depends_on_position():
    model = SparseModel(**table())
    inputs = np.array([[1.0], [-2.0], [0.5]])
    rolled = model.roll_out(np.array([1.0, 0.0, 0.0]), inputs, 0.1)
    factor = 1 - 0.1 + 0.005 - 0.001 / 6 + 0.0001 / 24
    expected = [[1, 0, 0], [factor, 0.2, 0.3], [factor**2, 0.4, -0.3], [factor**3, 0.6, -0.15]]
    np.testing.assert_allclose(rolled, expected, rtol=1e-14, atol=1e-15)


def test_auxiliaries_are_abbreviations():
    equations = SparseModel(
        **table(
            derivatives={"x": {"v*u1": 2.0}, "y": {"v": 1.0}, "theta": {}},
            auxiliaries={"v": {"sin(theta)*u1": 3.0, "1": -1.0}},
        )
    ).equations
    assert equations[0] == {("sin(theta)", "u1", "u1"): 6.0, ("u1",): -2.0}
    assert equations[1:] == ({("sin(theta)", "u1"): 3.0, (): -1.0}, {})


def test_model_at_rest_has_zero_derivative():
    model = SparseModel(**table(derivatives={"x": {}, "y": {}, "theta": {}}))
    f, A, B = model.linearise(np.ones(3), np.ones(1))
    assert not np.any(f) and not np.any(A) and not np.any(B)
    assert (A.shape, B.shape) == ((3, 3), (3, 1))


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"states": ["y", "x", "theta"]}, "states must begin with x, y, theta"),
        ({"states": ["x", "y"]}, "states must begin with x, y, theta"),
        ({"derivatives": {"x": {}, "y": {}}}, "derivatives must be given for"),
        ({"derivatives": {"x": {}, "y": {}, "theta": {}, "z": {}}}, "derivatives must be given"),
        ({"derivatives": {"x": {"u2": 1.0}, "y": {}, "theta": {}}}, "unknown factor 'u2'"),
        ({"derivatives": {"x": {"u1": np.nan}, "y": {}, "theta": {}}}, "x: .*'u1' must be finite"),
        ({"derivatives": {"x": {"u1": np.inf}, "y": {}, "theta": {}}}, "must be finite, got inf"),
        (
            {"derivatives": {"x": {"x*u1": 1.0, "u1*x": 1.0}, "y": {}, "theta": {}}},
            r"x: term 'u1\*x' stands twice",
        ),
        ({"auxiliaries": {"a": {"b": 1.0}, "b": {"u1": 1.0}}}, "unknown factor 'b'"),
        ({"auxiliaries": {"u1": {"x": 1.0}}}, "u1"),
        ({"inputs": ["u1", "u1"]}, "u1"),
        ({"inputs": ["u1", "x"]}, "x"),
    ],
)
def test_names_and_coefficients_that_do_not_fit(changes, problem):
    with pytest.raises(ValueError, match=problem):
        SparseModel(**table(**changes))
