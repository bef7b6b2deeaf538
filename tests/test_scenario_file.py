import dataclasses as dc

import pytest

from mirte_drake.control.reference_paths import CirclePath
from mirte_drake.errors import UserError
from mirte_drake.model.model_file import IDENTIFIED_MODELS
from mirte_drake.model.robot_file import load_robot_file, save_robot_file
from mirte_drake.robots.odometry_sensor import OdometrySensorConfig
from mirte_drake.scenario import JITTER
from mirte_drake.scenario_file import load_scenario, scenario_stem
from mirte_drake.systems.disturbance_source import CornerDisturbance, NoDisturbance
from mirte_drake.systems.pose_pid import PosePidConfig
from mirte_drake.typed_yaml import write_typed


def test_a_controller_keeps_its_kind_when_a_field_changes():
    scenario = load_scenario("pid_circle", ["controller.preview=5"])
    assert scenario.controller.preview == 5 and isinstance(scenario.controller, PosePidConfig)


def test_overrides_change_numbers_arrays_and_kinds():
    scenario = load_scenario(
        "rectangle",
        [
            "seed=7",
            "tube_updater.disturbance_bound=[0.1, 0.2, 0.3]",
            "disturbance=!CornerDisturbance {bound: [1, 1, 1]}",
            "reference=!CirclePath {radius: 1.5}",
            "nominal_nmpc.terminal_weight=null",
        ],
    )
    assert scenario.seed == 7
    assert scenario.tube_updater.disturbance_bound.tolist() == [0.1, 0.2, 0.3]
    assert isinstance(scenario.disturbance, CornerDisturbance)
    assert isinstance(scenario.reference, CirclePath) and scenario.reference.radius == 1.5
    assert scenario.nominal_nmpc.terminal_weight is None


def test_an_override_inside_a_part_keeps_its_kind():
    scenario = load_scenario(
        "turning_circle", ["reference.radius=0.9", "disturbance.bound=[1,1,1]"]
    )
    assert scenario.reference == CirclePath(radius=0.9, heading="tangent")
    assert scenario.disturbance.bound.tolist() == [1, 1, 1]


@pytest.mark.parametrize(
    ("robot", "fields"),
    [
        ("!DynamicRobotConfig {robot: weak_wheels}", ["robot.payload=2", "robot.delay=0.05"]),
        ("!MultibodyRobotConfig {motors: drifting}", ["robot.floor_friction=0.3"]),
    ],
)
def test_another_robot_keeps_its_kind_and_its_other_values(robot, fields):
    chosen = load_scenario("rectangle", [f"robot={robot}"]).robot
    changed = load_scenario("rectangle", [f"robot={robot}", *fields]).robot
    values = dict(field.removeprefix("robot.").split("=") for field in fields)
    assert type(changed) is type(chosen) and repr(changed) != repr(chosen)
    expected = dc.replace(chosen, **{key: float(value) for key, value in values.items()})
    assert repr(changed) == repr(expected)


@pytest.mark.parametrize("kind", ["Dynamic", "Multibody"])
@pytest.mark.parametrize("override", ["odometry.latency=0.05", "odometry={latency: 0.05}"])
@pytest.mark.parametrize("turn", [1, -1])
def test_changed_odometry_keeps_the_rest_of_the_robots_own(kind, override, turn):
    overrides = [f"robot=!{kind}RobotConfig {{}}", override][::turn]
    changed = load_scenario("rectangle", overrides).measuring_odometry
    assert changed == OdometrySensorConfig(latency=0.05, jitter=JITTER)
    given = load_scenario("rectangle", [*overrides, "odometry.jitter=0"]).measuring_odometry
    assert given == OdometrySensorConfig(latency=0.05)


def test_own_scenario_extends_a_known_one(tmp_path):
    path = tmp_path / "mine.scenario.yaml"
    path.write_text(
        "extends: circle\nreference: !CirclePath {radius: 0.9}\ndisturbance: !NoDisturbance {}\n"
    )
    scenario = load_scenario(str(path))
    assert scenario.reference == CirclePath(radius=0.9, duration=30.0)
    assert scenario.disturbance == NoDisturbance()
    assert scenario_stem(str(path)) == "mine"


@pytest.mark.parametrize(
    "overrides",
    [
        [],
        ["robot=!DynamicRobotConfig {delay: 0.02}", "odometry={latency: 0.1}"],
        ["robot=!MultibodyRobotConfig {patches: [{size: [1, 2]}], motor_parameters: {}}"],
    ],
)
def test_a_saved_scenario_loads_as_it_was(overrides, tmp_path):
    scenario = load_scenario("baseline_robot_circle", ["seed=3", *overrides])
    write_typed(scenario, tmp_path / "again.scenario.yaml")
    again = load_scenario(str(tmp_path / "again.scenario.yaml"))
    assert repr(again) == repr(scenario)


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("sed=1", ["sed"]),
        ("nominal_nmpc.horizonn=3", ["horizonn"]),
        ("nominal_nmpc.horizon=abc", ["nominal_nmpc.horizon"]),
        ("nominal_nmpc.horizon=0", ["nominal_nmpc.horizon", ">= 1", "got 0"]),
        ("nominal_nmpc.state_weight=[.nan, 1, 1]", ["nominal_nmpc.state_weight", "finite"]),
        ("nominal_nmpc.state_weight=[1, 1]", ["nominal_nmpc.state_weight", "shape (3,)"]),
        ("nominal_nmpc.solver=gurobi", ["nominal_nmpc.solver", "snopt, ipopt", "gurobi"]),
        ("tube_updater.disturbance_bound=[-1, 0, 0]", ["tube_updater.disturbance_bound", ">= 0"]),
        ("tube_updater.disturbance_frame=body", ["disturbance_frame", "published, rotated"]),
        ("ancillary_dlqr=null", ["tube_updater", "needs ancillary_dlqr"]),
        ("controller=!PosePidConfig {}", ["ancillary_dlqr: must be null with", "PosePidConfig"]),
        ("period=0", ["period", "> 0"]),
        ("duration=-1", ["duration", ">= 0.1"]),
        ("seed=-1", ["seed", ">= 0"]),
        ("robot.initial_pose=[1]", ["robot.initial_pose", "shape (3,)"]),
        ("robot=!HoverRobotConfig {}", ["robot", "HoverRobotConfig"]),
        ("robot=!DynamicRobotConfig {robot: magic}", ["robot.robot", "magic", "fitted"]),
        ("robot=!DynamicRobotConfig {payload: -1}", ["robot.payload", ">= 0"]),
        ("robot=!MultibodyRobotConfig {floor_friction: 0}", ["robot.floor_friction", "> 0"]),
        (
            "robot=!MultibodyRobotConfig {motors: drifting, motor_parameters: {delay: 0.1}}",
            ["robot.motor_parameters", "'drifting'", "field delay"],
        ),
        ("odometry.jitter=1", ["odometry.jitter", "<= 0.1"]),
        ("odometry.latency=3", ["odometry.latency", "<= 2", "got 3"]),
        ("odometry={period: 0.0001}", ["odometry.period", ">= 0.001", "got 0.0001"]),
        ("robot=!DynamicRobotConfig {delay: 3}", ["robot.delay", "<= 2", "got 3"]),
        ("robot=!MultibodyRobotConfig {delay: 3}", ["robot.delay", "<= 2", "got 3"]),
        (
            "robot=!MultibodyRobotConfig {motor_parameters: {delay: 3}}",
            ["robot.motor_parameters.delay", "<= 2", "got 3"],
        ),
        (
            "robot=!MultibodyRobotConfig {time_step: 0.00001}",
            ["robot.time_step", ">= 0.0001", "got 1e-05"],
        ),
        ("integration_accuracy=0", ["integration_accuracy", "> 0"]),
        ("reference=!Spiral {}", ["reference", "Spiral"]),
        ("reference=!VelocitySetpointConfig {}", ["duration", "must be given"]),
        ("reference.rest=9", ["reference.rest", "shorter"]),
        ("disturbance=!RecordedDisturbance {file: no.csv}", ["disturbance.file", "no.csv"]),
        ("nominal_nmpc=null", ["nominal_nmpc"]),
        ("extends=circle", ["extends", "run that one"]),
        ("nonsense", ["path.to.field=value"]),
        ("a b=1", ["path.to.field=value"]),
        ("seed=[", ["not valid YAML"]),
    ],
)
def test_bad_overrides_name_option_field_and_remedy(override, words):
    with pytest.raises(UserError) as caught:
        load_scenario("rectangle", [override])
    message = str(caught.value)
    assert "\n" not in message
    for word in [f"--set {override}", *words]:
        assert word in message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("tube_updatr: {}\n", ["tube_updatr"]),
        ("seed: one\n", ["seed"]),
        ("- 1\n- 2\n", ["mapping"]),
        ("seed: [1\n", ["line", "not valid YAML"]),
        ("extends: nowhere\n", ["extends", "nowhere"]),
        ("tube_updater: {disturbance_bound: [1, .inf, 1]}\n", ["disturbance_bound", "finite"]),
    ],
)
def test_bad_files_name_file_and_field(tmp_path, text, words):
    path = tmp_path / "bad.scenario.yaml"
    path.write_text(text)
    with pytest.raises(UserError) as caught:
        load_scenario(str(path))
    for word in [str(path), *words]:
        assert word in str(caught.value)


def test_unknown_name_suggests_a_near_one():
    with pytest.raises(UserError, match="did you mean 'rectangle'"):
        load_scenario("rectangel")


def test_a_circle_of_extends_is_found(tmp_path):
    one, two = tmp_path / "one.yaml", tmp_path / "two.yaml"
    one.write_text(f"extends: {two}\n")
    two.write_text(f"extends: {one}\n")
    with pytest.raises(UserError, match="round in a circle"):
        load_scenario(str(one))


def test_a_missing_file_is_named():
    with pytest.raises(UserError, match=r"nowhere\.yaml: cannot be read"):
        load_scenario("nowhere.yaml")


@pytest.mark.parametrize("turn", [1, -1])
def test_overrides_that_need_each_other_may_come_in_any_order(turn):
    for overrides in (
        ["ancillary_dlqr=null", "tube_updater=null"],
        ["reference=!VelocitySetpointConfig {setpoint: [0.1, 0, 0]}", "duration=3"],
    ):
        scenario = load_scenario("rectangle", overrides[::turn])
        assert scenario.tube_updater is None or scenario.duration == 3.0


def test_the_override_that_brought_the_error_is_named():
    with pytest.raises(UserError, match=r"--set period=0: period: must be > 0"):
        load_scenario("rectangle", ["seed=3", "period=0", "input_limit=90"])


def test_paths_in_a_file_are_meant_from_its_folder(tmp_path, monkeypatch):
    folder = tmp_path / "deep"
    folder.mkdir()
    (folder / "base.yaml").write_text("seed: 9\n")
    (folder / "noise.csv").write_text("0.01,0,0\n")
    (folder / "mine.yaml").write_text(
        "extends: base.yaml\ndisturbance: !RecordedDisturbance {file: noise.csv}\n"
    )
    monkeypatch.chdir(tmp_path)
    scenario = load_scenario("deep/mine.yaml")
    assert scenario.seed == 9
    assert scenario.disturbance.file == (folder / "noise.csv").resolve()


def test_paths_of_robots_are_meant_from_the_files_folder(tmp_path, monkeypatch):
    folder = tmp_path / "deep"
    folder.mkdir()
    save_robot_file(load_robot_file("clean"), folder / "own.yaml")
    (folder / "mine.yaml").write_text("robot: !DynamicRobotConfig {robot: own.yaml}\n")
    monkeypatch.chdir(tmp_path)
    assert load_scenario("deep/mine.yaml").robot.robot == str((folder / "own.yaml").resolve())


def test_paths_of_overrides_hold_from_another_folder(tmp_path, monkeypatch):
    there, elsewhere = tmp_path / "there", tmp_path / "elsewhere"
    for folder in (there, elsewhere):
        folder.mkdir()
    (there / "own.yaml").write_text((IDENTIFIED_MODELS / "kinematic.yaml").read_text())
    save_robot_file(load_robot_file("clean"), there / "robot.yaml")
    (there / "noise.csv").write_text("0.01,0,0\n")
    for robot in (["robot.model=own.yaml"], ["robot=!DynamicRobotConfig {robot: robot.yaml}"]):
        monkeypatch.chdir(there)
        scenario = load_scenario(
            "rectangle",
            [
                *robot,
                "prediction_model=own.yaml",
                "disturbance=!RecordedDisturbance {file: ../there/noise.csv}",
            ],
        )
        write_typed(scenario, elsewhere / "as_run.scenario.yaml")
        monkeypatch.chdir(elsewhere)
        again = load_scenario("as_run.scenario.yaml")
        assert repr(again) == repr(scenario)
        assert again.prediction_model == str((there / "own.yaml").resolve())
        assert again.disturbance.file == (there / "noise.csv").resolve()
