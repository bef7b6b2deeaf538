import numpy as np
import pytest

from mirte_drake.errors import UserError
from mirte_drake.model.dynamic_model import DynamicParameters
from mirte_drake.model.fleet import fleet_files
from mirte_drake.model.robot_file import (
    RobotFile,
    load_robot_file,
    robot_names,
    save_robot_file,
)


def flat(parameters) -> dict:
    return {**vars(parameters), **vars(parameters.drivetrain), "drivetrain": None}


def test_what_is_saved_is_loaded(tmp_path):
    content = load_robot_file("mixed_1")
    save_robot_file(content, tmp_path / "copy.yaml")
    again = load_robot_file(tmp_path / "copy.yaml")
    np.testing.assert_equal(flat(again.parameters), flat(content.parameters))
    assert again.identification == content.identification and again.scores == content.scores


def test_package_holds_the_fitted_robot_and_its_fleet_as_generated():
    files = fleet_files(load_robot_file("fitted"))
    assert robot_names() == sorted(["fitted", *(file.name for file in files)])
    for file in files:
        stored = load_robot_file(file.name)
        assert stored.name == file.name and stored.identification == file.identification
        expected, actual = flat(file.parameters), flat(stored.parameters)
        for key, value in expected.items():
            if key != "drivetrain":
                np.testing.assert_allclose(actual[key], value, rtol=1e-12)


def test_unknown_name_lists_the_known_ones():
    with pytest.raises(UserError, match="robot 'rocket' is not known: use one of clean, fitted"):
        load_robot_file("rocket")


def test_bad_value_is_named_with_its_file(tmp_path):
    path = tmp_path / "heavy.yaml"
    save_robot_file(RobotFile(parameters=DynamicParameters(mass=-1.0)), path)
    with pytest.raises(UserError, match=r"heavy\.yaml: parameters\.mass: must be > 0"):
        load_robot_file(path)


def test_unknown_key_is_an_error(tmp_path):
    path = tmp_path / "odd.yaml"
    path.write_text("parameters: {wheels: 6}\n")
    with pytest.raises(UserError, match="wheels"):
        load_robot_file(path)
