import numpy as np
import pytest

from mirte_drake.campaign.grid import (
    CONTROLLERS,
    Trial,
    Variation,
    cells,
    parse_variation,
    trials,
    with_controllers,
)
from mirte_drake.errors import UserError
from mirte_drake.robots.multibody_robot import MultibodyRobotConfig
from mirte_drake.robots.sindyc_robot import SindycRobotConfig
from mirte_drake.scenario_file import scenario_names


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a.b=[1, 2.50]", Variation("a.b", ("1", "2.50"))),
        (" a.b = [x]", Variation("a.b", ("x",))),
        ("a=[!B {c: [1], d: 'e, f'}, null]", Variation("a", ("!B {c: [1], d: 'e, f'}", "null"))),
        ("a=[[1, 2], [3, 4]]", Variation("a", ("[1, 2]", "[3, 4]"))),
        ("a=[1, 2, 1]", Variation("a", ("1", "2"))),
    ],
)  # fmt: skip
def test_values_are_taken_as_they_were_given(text, expected):
    assert parse_variation(text) == expected


@pytest.mark.parametrize("text", ["a", "a=1", "a=[]", "a=[1", "a={b: 1}", "=", "a=[1] [2]"])
def test_what_is_no_list_is_one_clear_line(text):
    with pytest.raises(UserError) as error:
        parse_variation(text)
    assert str(error.value) == f"--vary {text}: must be path.to.field=[value, value, ...]"


def test_the_seed_is_not_varied():
    with pytest.raises(UserError, match="--runs"):
        parse_variation("seed=[1, 2]")


def test_cells_are_all_combinations():
    variations = [Variation("input_limit", ("50", "60")), Variation("duration", ("1", "2", "3"))]
    grid = cells(["rectangle", "circle"], variations)
    assert len(grid) == 12
    assert [cell.name for cell in grid] == ["rectangle"] * 6 + ["circle"] * 6
    for cell in grid:
        assert [str(round(cell.scenario.input_limit)), str(round(cell.scenario.duration))] == list(
            cell.values
        )
    assert len({cell.values for cell in grid}) == 6


def test_without_variations_a_cell_is_a_scenario_with_the_overrides():
    (cell,) = cells(["circle", "circle"], (), ["duration=3"])
    assert cell.values == () and cell.scenario.duration == 3.0


def test_a_part_comes_before_its_fields():
    robots = Variation(
        "robot", ("!MultibodyRobotConfig {}", "!MultibodyRobotConfig {motors: fitted}")
    )
    grid = cells(["circle"], [robots], ["robot.floor_friction=0.3"])
    assert [cell.scenario.robot.motors for cell in grid] == ["clean", "fitted"]
    assert [cell.scenario.robot.floor_friction for cell in grid] == [0.3, 0.3]
    frictions = Variation("robot.floor_friction", ("0.1", "0.2"))
    grid = cells(["circle"], [frictions], ["robot=!MultibodyRobotConfig {}"])
    assert [cell.scenario.robot for cell in grid] == [
        MultibodyRobotConfig(floor_friction=0.1, slope=grid[0].scenario.robot.slope),
        MultibodyRobotConfig(floor_friction=0.2, slope=grid[1].scenario.robot.slope),
    ]


def test_trials_are_every_cell_with_the_same_seeds():
    grid = cells(["circle", "rectangle"])
    todo = trials(grid, range(3, 5))
    assert todo == [Trial(cell, seed) for cell in grid for seed in (3, 4)]
    assert [trial.scenario.seed for trial in todo] == [3, 4, 3, 4]
    assert isinstance(todo[0].scenario.robot, SindycRobotConfig)
    np.testing.assert_array_equal(todo[0].scenario.first_pose, grid[0].scenario.first_pose)


@pytest.mark.parametrize(
    ("names", "variations", "overrides", "words"),
    [
        (["squircle"], [], [], "did you mean 'circle'"),
        (["circle"], [Variation("speed", ("1",))], [], "speed"),
        (["circle"], [Variation("input_limit", ("1", "-1"))], [], "input_limit"),
        (["circle"], [Variation("period", ("1",))] * 2, [], "--vary period: stands twice"),
        (["circle"], [], ["robot=!Ros2RobotConfig {}"], "circle: robot: is beyond a wire"),
    ],
)
def test_what_cannot_be_run_is_named_before_anything_runs(names, variations, overrides, words):
    with pytest.raises(UserError, match=words):
        cells(names, variations, overrides)


def test_controllers_of_a_path():
    family = with_controllers(["circle", "robot_circle", "circle"])
    assert family == [*with_controllers(["circle"]), *with_controllers(["robot_circle"])]
    assert {"circle", "baseline_circle", "rigorous_circle", "baseline_robot_circle"} <= set(family)
    assert set(family) <= set(scenario_names())
    assert len(set(family)) == len(family)
    assert family == sorted(family, key=lambda name: "robot" in name)
    assert "" in CONTROLLERS


def test_controllers_of_an_own_file_are_not_known(tmp_path):
    file = tmp_path / "mine.scenario.yaml"
    file.write_text("extends: circle\n")
    with pytest.raises(UserError, match="with --controllers it must be one of"):
        with_controllers([str(file)])
    with pytest.raises(UserError, match="did you mean 'circle'"):
        with_controllers(["squircle"])
