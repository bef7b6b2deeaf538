import dataclasses as dc

import numpy as np
import pytest

from mirte_drake.assembly import MakeDiagram
from mirte_drake.control.reference_paths import RectanglePath, VelocityLegsPath
from mirte_drake.errors import UserError
from mirte_drake.robots.odometry_sensor import OdometrySensorConfig
from mirte_drake.robots.sindyc_robot import SindycRobotConfig
from mirte_drake.scenario import JITTER, Scenario
from mirte_drake.scenario_file import load_scenario, scenario_names
from mirte_drake.systems.ancillary_inversion import AncillaryInversionConfig
from mirte_drake.systems.inversion_tube_updater import InversionTubeUpdaterConfig
from mirte_drake.systems.pose_lqr import PoseLqrConfig
from mirte_drake.systems.pose_pid import PosePidConfig
from mirte_drake.systems.velocity_setpoint import VelocitySetpointConfig

STUDIES = ("rectangle", "circle", "turning_circle")
PUBLISHED = ("rectangle", "circle", "turning_circle", "robot_rectangle", "robot_circle")


def test_the_contract_names_are_there():
    prefixes = ("", "baseline_", "lagged_", "pid_", "lqr_")
    assert set(scenario_names()) == {
        *(f"{prefix}{name}" for prefix in prefixes for name in PUBLISHED),
        *(f"rigorous_{name}" for name in STUDIES),
    }


def test_the_rectangle_is_the_default_scenario():
    loaded = dc.replace(load_scenario("rectangle"), description="")
    assert repr(loaded) == repr(Scenario())


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_baseline_differs_in_tube_and_ancillary_law_alone(name):
    baseline, full = load_scenario(f"baseline_{name}"), load_scenario(name)
    assert baseline.tube_updater is None and baseline.ancillary_dlqr is None
    same = dc.replace(
        baseline,
        description=full.description,
        tube_updater=full.tube_updater,
        ancillary_dlqr=full.ancillary_dlqr,
    )
    assert repr(same) == repr(full)


@pytest.mark.parametrize("name", STUDIES)
def test_a_rigorous_scenario_differs_in_tube_and_ancillary_law_alone(name):
    rigorous, published = load_scenario(f"rigorous_{name}"), load_scenario(name)
    assert rigorous.tube_updater is None and rigorous.ancillary_dlqr is None
    assert rigorous.has_tube and published.has_tube
    tube = rigorous.inversion_tube_updater
    np.testing.assert_array_equal(tube.disturbance_bound, published.tube_updater.disturbance_bound)
    same = dc.replace(
        rigorous,
        description=published.description,
        ancillary_inversion=None,
        inversion_tube_updater=None,
        tube_updater=published.tube_updater,
        ancillary_dlqr=published.ancillary_dlqr,
    )
    assert repr(same) == repr(published)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ancillary_dlqr": None}, "^tube_updater: needs ancillary_dlqr"),
        ({"inversion_tube_updater": InversionTubeUpdaterConfig()}, "needs ancillary_inversion"),
        ({"ancillary_inversion": AncillaryInversionConfig()}, "stands in for ancillary_dlqr"),
    ],
)
def test_tubes_and_laws_go_in_pairs(changes, message):
    with pytest.raises(ValueError, match=message):
        dc.replace(Scenario(), **changes).validate()


def test_a_baseline_has_no_tube():
    assert not load_scenario("baseline_rectangle").has_tube


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_lagged_scenario_has_the_same_task(name):
    lagged, published = load_scenario(f"lagged_{name}"), load_scenario(name)
    for field in ("reference", "disturbance", "robot", "odometry", "duration", "period"):
        assert repr(getattr(lagged, field)) == repr(getattr(published, field))
    assert lagged.lagged_tube is not None and lagged.tube_updater is None
    assert lagged.delay == 1  # Of those with which a robot may have 0 to 2.


def test_a_delay_is_the_estimators_or_the_models():
    assert load_scenario("lagged_circle", ["state_estimator.delay=2"]).delay == 2
    assert load_scenario("circle").delay == 0


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["prediction_model=extended_kinematic"], "state_estimator: must be null"),
        (["state_estimator=null"], "state_estimator: must be given"),
        (["ancillary_lagged=null"], "ancillary_lagged: must be given"),
        (["ancillary_dlqr={}"], "ancillary_dlqr: must be null"),
        (
            ["lagged_tube.calibrated=true", "coverage_monitor=null"],
            "lagged_tube.calibrated: needs a coverage_monitor",
        ),
        (
            ["lagged_tube=null", "coverage_monitor={}"],
            "coverage_monitor.disturbance_bound: must be given without a tube",
        ),
        (["controller=!PosePidConfig {}"], "prediction_model: 'lagged' is a lagged one, which con"),
        (
            ["lagged_tube.innovation_bound=[0, 0, 0]"],
            "lagged_tube.innovation_bound: every entry must be",
        ),
        (["lagged_tube.shape=box"], "lagged_tube.shape: must be one of"),
        (
            ["wheel_command_limiter.deadband=10"],
            "wheel_command_limiter.deadband: must be 0 with lagged_tube",
        ),
    ],
)
def test_the_parts_of_a_controller_fit_its_model(overrides, message):
    with pytest.raises(UserError, match=message):
        load_scenario("lagged_rectangle", overrides)


@pytest.mark.parametrize("name", PUBLISHED)
@pytest.mark.parametrize(
    ("prefix", "controller"), [("pid_", PosePidConfig()), ("lqr_", PoseLqrConfig())]
)
def test_other_controllers_drive_the_path_of_the_baseline(name, prefix, controller):
    scenario, baseline = load_scenario(f"{prefix}{name}"), load_scenario(f"baseline_{name}")
    same = dc.replace(baseline, description=scenario.description, controller=controller)
    assert repr(same) == repr(scenario)


def test_robot_settings_are_the_published_programs():
    scenario = load_scenario("robot_circle")
    nmpc = scenario.nominal_nmpc
    assert nmpc.state_weight.tolist() == [1000, 7000, 10000]
    assert (nmpc.rate_limit, nmpc.rate_unit) == (30, "pwm_per_s")
    assert scenario.tube_updater.disturbance_bound.tolist() == [0.05, 0.05, 0.05]
    assert scenario.wheel_command_limiter.deadband == 10


def test_a_robot_without_a_kind_is_the_studies():
    scenario = load_scenario("rectangle", ["robot.model=kinematic"])
    assert repr(scenario.robot) == repr(SindycRobotConfig(model="kinematic"))


def test_null_odometry_is_the_robots_own():
    assert load_scenario("rectangle").measuring_odometry is None
    for kind in ("Dynamic", "Multibody"):
        scenario = load_scenario("rectangle", [f"robot=!{kind}RobotConfig {{}}"])
        assert scenario.measuring_odometry == OdometrySensorConfig(jitter=JITTER)
    given = load_scenario("rectangle", ["odometry.latency=0.05"])
    assert given.measuring_odometry == OdometrySensorConfig(latency=0.05)


def test_null_accuracy_is_the_robots_own():
    kinds = {"Sindyc": 1e-6, "Dynamic": 1e-2, "Multibody": 1e-6}
    for kind, accuracy in kinds.items():
        robot = f"robot=!{kind}RobotConfig {{}}"
        assert load_scenario("rectangle", [robot]).accuracy == accuracy
        given = load_scenario("rectangle", [robot, "integration_accuracy=0.1"])
        assert given.accuracy == 0.1


def test_duration_and_steps():
    assert Scenario().steps == 251
    assert Scenario(duration=1.0).steps == 11
    assert Scenario(reference=RectanglePath(duration=10.0)).steps == 101
    assert Scenario(reference=VelocityLegsPath()).first_pose.tolist() == [0, 0, 0]
    setpoint = VelocitySetpointConfig(start=np.array([1.0, 2.0, 3.0]))
    assert Scenario(reference=setpoint, duration=1.0).first_pose.tolist() == [1, 2, 3]


def test_models_that_do_not_fit_the_wheels_or_cannot_be_driven(tmp_path):
    text = (
        "name: bad\nstates: {{x: m, y: m, theta: rad}}\ninputs: {{{inputs}}}\n"
        "derivatives: {{x: {{u1: 0.01}}, y: {{u2: 0.01}}, theta: {{{yaw}}}}}\n"
    )
    three = tmp_path / "three.yaml"
    three.write_text(text.format(inputs="u1: pwm, u2: pwm, u3: pwm", yaw="u3: 0.01"))
    lame = tmp_path / "lame.yaml"
    lame.write_text(text.format(inputs="u1: pwm, u2: pwm, u3: pwm, u4: pwm", yaw=""))
    for field in ("prediction_model", "robot.model"):
        with pytest.raises(UserError, match=r"must have 4 inputs.* got 3"):
            load_scenario("rectangle", [f"{field}={three}"])
    scenario = load_scenario("rectangle", [f"prediction_model={lame}"])
    with pytest.raises(UserError, match=r"ancillary_dlqr: .*cannot be stabilised"):
        MakeDiagram(scenario)
