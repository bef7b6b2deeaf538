from pathlib import Path

import numpy as np
import pytest

from mirte_drake.errors import UserError
from mirte_drake.model.lagged_model import LaggedModel
from mirte_drake.model.model_file import (
    IDENTIFIED_MODELS,
    Identification,
    ModelFile,
    load_model,
    load_model_file,
    model_names,
    save_model_file,
)

PUBLISHED = ["dynamic", "extended_kinematic", "kinematic"]


def small_model() -> ModelFile:
    return ModelFile(
        name="small",
        states={"x": "m", "y": "m", "theta": "rad"},
        inputs={"u1": "pwm_percent", "u2": "pwm_percent"},
        auxiliaries={"forward": {"u1": 0.5, "u2": 0.5}},
        derivatives={
            "x": {"cos(theta)*forward": 1 / 3},
            "y": {"sin(theta)*forward": 1 / 3},
            "theta": {"u1": -1e-05, "u1*u2": 2e-17},
        },
        identification=Identification("a test", "0" * 64, "2026-01-01", {"threshold": "1e-4"}),
        training_scores={"r2": 0.9},
    )


def model_error(path: Path, text: str) -> str:
    path.write_text(text)
    with pytest.raises(UserError) as caught:
        load_model(path)
    assert str(path) in str(caught.value)
    return str(caught.value)


def test_published_models_come_with_the_package():
    assert model_names() == sorted([*PUBLISHED, "lagged", "lagged_multibody"])
    for name in PUBLISHED:
        content = load_model_file(name)
        assert content.name == name
        assert list(content.inputs.values()) == 4 * ["pwm_percent"]
        assert content.identification.source
        assert len(content.identification.data_sha256) == 64


def test_the_lagged_model_comes_with_the_package_and_survives_a_file(tmp_path):
    content = load_model_file("lagged")
    assert len(content.identification.data_sha256) == 64
    path = tmp_path / "copy.yaml"
    save_model_file(content, path)
    model, copy = load_model("lagged"), load_model(path)
    assert isinstance(model, LaggedModel) and isinstance(copy, LaggedModel)
    np.testing.assert_equal(vars(copy.parameters), vars(model.parameters))


def test_a_lagged_model_has_no_terms(tmp_path):
    text = "lagged: {deadband: 5}\nstates: {x: m, y: m, theta: rad}\n"
    assert "lagged: " in model_error(tmp_path / "both.yaml", text)
    assert "deadband: " in model_error(tmp_path / "bad.yaml", "lagged: {deadband: -5}\n")
    assert "wheel" in model_error(tmp_path / "unknown.yaml", "lagged: {wheel: 5}\n")


def test_name_and_path_give_the_same_model():
    path = IDENTIFIED_MODELS / "kinematic.yaml"
    assert load_model_file("kinematic") == load_model_file(path) == load_model_file(str(path))
    assert load_model("kinematic").equations == load_model(path).equations


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_model_survives_a_round_trip(tmp_path, name):
    content = load_model_file(name)
    save_model_file(content, tmp_path / "copy.yaml")
    assert load_model_file(tmp_path / "copy.yaml") == content
    assert load_model(tmp_path / "copy.yaml").equations == load_model(name).equations


def test_every_field_survives_a_round_trip(tmp_path):
    path = tmp_path / "new" / "small.yml"
    save_model_file(small_model(), path)
    loaded = load_model_file(path)
    assert loaded == small_model()
    assert list(loaded.states) == ["x", "y", "theta"]
    assert [p.name for p in path.parent.iterdir()] == ["small.yml"]


def test_saved_model_drives(tmp_path):
    path = tmp_path / "small.yaml"
    save_model_file(small_model(), path)
    derivative = load_model(path).derivative(np.array([0.0, 0.0, np.pi / 6]), np.array([6.0, 0.0]))
    np.testing.assert_allclose(derivative, [np.cos(np.pi / 6), 0.5, -6e-5])


@pytest.mark.parametrize("name", ["kinematics", "", "folder/kinematic", "model.json"])
def test_unknown_name_lists_the_known_ones(name):
    with pytest.raises(UserError, match="is not known: use one of dynamic, extended_kinematic, k"):
        load_model(name)


def test_missing_file_is_named(tmp_path):
    with pytest.raises(UserError, match=r"no\.yaml: cannot be read: No such file"):
        load_model(tmp_path / "no.yaml")


def test_unknown_key(tmp_path):
    message = model_error(tmp_path / "model.yaml", "name: a\nderivative: {x: {u1: 1.0}}")
    assert "derivative: " in message and "unknown" in message


def test_empty_model(tmp_path):
    assert "states must begin with x, y, theta" in model_error(tmp_path / "model.yaml", "{}")


@pytest.mark.parametrize(
    ("coefficients", "problem"),
    [
        ("{u1: .nan}", "x: coefficient of 'u1' must be finite, got nan"),
        ("{u1: .inf}", "x: coefficient of 'u1' must be finite, got inf"),
        ("{u1: fast}", "derivatives.x.u1: "),
        ("{u3: 1.0}", "unknown factor 'u3'"),
        ("{u1*u2: 1.0, u2*u1: 1.0}", "x: term 'u2*u1' stands twice"),
        ("{u1*u2: 1.0, u1*u2: 1.0}", "twice"),
    ],
)
def test_bad_coefficients(tmp_path, coefficients, problem):
    text = (
        "states: {x: m, y: m, theta: rad}\n"
        "inputs: {u1: pwm_percent, u2: pwm_percent}\n"
        f"derivatives: {{x: {coefficients}, y: {{}}, theta: {{}}}}\n"
    )
    assert problem in model_error(tmp_path / "model.yaml", text)
