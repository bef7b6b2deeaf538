import dataclasses as dc
import itertools

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from mirte_drake.angles import pose_error, rotation
from mirte_drake.assembly import (
    AddController,
    AddReference,
    MakeController,
    MakeDiagram,
)
from mirte_drake.control.inversion_tube import propagate_inversion_tube, required_room
from mirte_drake.control.lagged_tube import ModeTube, input_room, lagged_loop
from mirte_drake.control.pid import PidGains, PidMemory, pid_step, reference_velocity
from mirte_drake.control.plan import Plan, SolveStatus
from mirte_drake.control.reference_paths import CirclePath
from mirte_drake.control.turning_map import turning_map
from mirte_drake.errors import UserError
from mirte_drake.model.model_file import load_model
from mirte_drake.robot_assembly import AddRobot
from mirte_drake.robots.dynamic_robot import DynamicRobotConfig
from mirte_drake.robots.multibody_robot import MultibodyRobotConfig
from mirte_drake.robots.odometry_sensor import OdometrySensorConfig
from mirte_drake.robots.robot_ports import RobotPorts
from mirte_drake.robots.sindyc_robot import SindycRobotConfig
from mirte_drake.run import simulate as simulate_run
from mirte_drake.scenario import Scenario, load_prediction_model
from mirte_drake.scenario_file import load_scenario, scenario_names
from mirte_drake.systems.ancillary_inversion import AncillaryInversionConfig
from mirte_drake.systems.coverage_monitor import CoverageMonitorConfig
from mirte_drake.systems.disturbance_source import CornerDisturbance, NoDisturbance
from mirte_drake.systems.inversion_tube_updater import InversionTubeUpdaterConfig
from mirte_drake.systems.pose_lqr import PoseLqr, PoseLqrConfig
from mirte_drake.systems.pose_pid import PosePidConfig
from mirte_drake.systems.reference_source import ReferenceSource
from mirte_drake.systems.tube_updater import TubeUpdaterConfig
from mirte_drake.systems.velocity_setpoint import VelocitySetpointConfig, VelocitySetpointSource
from mirte_drake.systems.wheel_command_limiter import (
    WheelCommandLimiterConfig,
    limit_wheel_command,
)

TURNING = Scenario(
    reference=CirclePath(radius=0.6, heading="tangent"), disturbance=CornerDisturbance()
)
WITHOUT_TUBE = dc.replace(TURNING, tube_updater=None)
BASELINE = dc.replace(TURNING, tube_updater=None, ancillary_dlqr=None)
RIGOROUS = dc.replace(
    BASELINE,
    ancillary_inversion=AncillaryInversionConfig(),
    inversion_tube_updater=InversionTubeUpdaterConfig(),
)
WATCHED = dc.replace(RIGOROUS, coverage_monitor=CoverageMonitorConfig())
COVERAGE = ["prediction_error", "calibrated_bound", "coverage", "coverage_warning"]
PID = dc.replace(BASELINE, controller=PosePidConfig())
LQR = dc.replace(BASELINE, controller=PoseLqrConfig())
W_MAX = np.array([0.04, 0.03, 0.09])


def input_names(diagram) -> list[str]:
    return [diagram.get_input_port(i).get_name() for i in range(diagram.num_input_ports())]


def output_names(diagram) -> list[str]:
    return [diagram.get_output_port(i).get_name() for i in range(diagram.num_output_ports())]


def advance_to_sample(simulator, k) -> None:
    """Advances to sample k and runs its updates."""
    simulator.AdvanceTo(0.1 * k)
    simulator.AdvancePendingEvents()


def read(simulator, port):
    return simulator.get_system().GetOutputPort(port).Eval(simulator.get_context())


def read_at_samples(simulator, samples, *ports) -> list[tuple]:
    rows = []
    for k in range(samples):
        advance_to_sample(simulator, k)
        rows.append(tuple(read(simulator, port) for port in ports))
    return rows


@pytest.mark.parametrize("name", scenario_names())
def test_every_scenario_builds_and_runs_two_samples(name):
    scenario = load_scenario(name)
    simulator = Simulator(MakeDiagram(scenario))
    ports = output_names(simulator.get_system())
    assert ("plan" in ports) == ("solve_status" in ports) == (scenario.controller is None)
    if scenario.controller is None:
        plans = read_at_samples(simulator, 2, "plan")
        assert [plan.sample for (plan,) in plans] == [0, 1]
        assert [plan.status for (plan,) in plans] == [SolveStatus.SOLVED] * 2
    else:
        read_at_samples(simulator, 2)
    assert np.all(np.isfinite(read(simulator, "pose")))
    assert np.max(np.abs(read(simulator, "wheel_command"))) <= scenario.input_limit
    assert np.any(read(simulator, "disturbance") != 0)
    assert ("half_width" in ports) == scenario.has_tube


@pytest.mark.parametrize(
    ("scenario", "further"),
    [
        (TURNING, ["designs", "half_width"]),
        (WITHOUT_TUBE, ["designs"]),
        (BASELINE, []),
        (RIGOROUS, ["reached", "half_width"]),
        (WATCHED, ["reached", "half_width", *COVERAGE]),
    ],
    ids=["tube", "without_tube", "baseline", "rigorous", "watched"],
)
def test_ports_of_controller_and_diagram(scenario, further):
    controller = MakeController(scenario)
    assert input_names(controller) == ["pose", "reference_window"]
    assert output_names(controller) == ["wheel_command", "plan", "solve_status", *further]
    assert controller.GetInputPort("pose").size() == 3
    assert controller.GetInputPort("reference_window").size() == 33
    assert controller.GetOutputPort("wheel_command").size() == 4

    diagram = MakeDiagram(scenario)
    assert input_names(diagram) == []
    assert set(output_names(diagram)) == {
        *("reference", "pose", "body_velocity", "true_pose", "disturbance"),
        *("wheel_command", "plan", "solve_status", *further),
    }


@pytest.mark.parametrize("scenario", [PID, LQR], ids=["pid", "lqr"])
def test_ports_of_a_controller_that_does_not_plan(scenario):
    controller = MakeController(scenario)
    assert input_names(controller) == ["pose", "reference_window"]
    assert output_names(controller) == ["wheel_command"]
    assert controller.GetInputPort("reference_window").size() == 33
    assert set(output_names(MakeDiagram(scenario))) == {
        *("reference", "pose", "body_velocity", "true_pose", "disturbance", "wheel_command")
    }


def test_pid_commands_follow_from_the_poses_of_their_own_instants():
    simulator = Simulator(MakeDiagram(PID))
    rows = read_at_samples(simulator, 6, "pose", "reference", "wheel_command")
    poses = PID.reference.poses(0.1)
    config, memory = PID.controller, PidMemory()
    gains = PidGains(config.proportional, config.integral, config.derivative, config.feedforward)
    for k, (pose, reference, command) in enumerate(rows):
        velocity = reference_velocity(poses[k:], 0.1, config.preview)
        expected, memory = pid_step(
            gains, memory, pose, reference, velocity, period=0.1, input_limit=100.0
        )
        np.testing.assert_allclose(command, expected, atol=1e-9)
    assert np.any(memory.integral != 0.0)


def test_lqr_commands_follow_from_the_poses_of_their_own_instants():
    lqr = PoseLqr(LQR.controller, load_model("extended_kinematic"), period=0.1, horizon=10)
    context, poses = lqr.CreateDefaultContext(), LQR.reference.poses(0.1)
    rows = read_at_samples(Simulator(MakeDiagram(LQR)), 4, "pose", "wheel_command")
    for k, (pose, command) in enumerate(rows):
        lqr.GetInputPort("pose").FixValue(context, pose)
        lqr.GetInputPort("reference_window").FixValue(context, poses[k : k + 11].ravel())
        np.testing.assert_array_equal(command, lqr.GetOutputPort("wheel_command").Eval(context))


@pytest.mark.parametrize("scenario", [PID, LQR], ids=["pid", "lqr"])
def test_a_pose_that_is_no_number_stops_the_wheels(scenario):
    controller = MakeController(scenario)
    simulator = Simulator(controller)
    context = simulator.get_mutable_context()
    controller.GetInputPort("pose").FixValue(context, np.full(3, np.nan))
    controller.GetInputPort("reference_window").FixValue(context, np.tile([0.5, 0, 0], 11))
    ((command,),) = read_at_samples(simulator, 1, "wheel_command")
    np.testing.assert_array_equal(command, np.zeros(4))


@pytest.mark.parametrize("config", [PosePidConfig(preview=10), PoseLqrConfig(preview=10)])
def test_preview_beyond_the_horizon_names_the_controller(config):
    with pytest.raises(UserError, match=r"^controller: preview: must be <= 9"):
        MakeDiagram(dc.replace(BASELINE, controller=config))


def test_a_lagged_model_that_hardly_lags_is_named():
    message = r"^prediction_model: lagged: lag: must be at least 0.165 s, .* got 0.153"
    with pytest.raises(UserError, match=message):
        MakeDiagram(load_scenario("lagged_rectangle", ["period=1.1"]))


def test_a_lagged_controllers_monitor_judges_the_innovation_and_its_bound_reaches_the_tube():
    settings = ["lagged_tube.calibrated=true", "coverage_monitor={window: 5}"]
    scenario = load_scenario("lagged_rectangle", settings)
    ports = ("innovation", "prediction_error", "calibrated_bound", "error_bound")
    rows = read_at_samples(Simulator(MakeDiagram(scenario)), 12, *ports)
    fixed = load_scenario("lagged_rectangle")
    bounds = read_at_samples(Simulator(MakeDiagram(fixed)), 12, "error_bound")
    for innovation, error, _, _ in rows:
        np.testing.assert_allclose(error, innovation / 0.1)
    assert np.all(np.isnan(rows[0][0]))
    first = scenario.lagged_tube.innovation_bound / 0.1
    assert any(not np.allclose(bound, first) for _, _, bound, _ in rows)
    np.testing.assert_allclose(rows[0][-1], bounds[0][0])  # Both begin with the given bound.
    assert not np.allclose(rows[-1][-1], bounds[-1][0])


def test_a_lagged_tube_follows_plan_and_calibrated_bound_of_its_own_sample():
    settings = ["lagged_tube.calibrated=true", "coverage_monitor={window: 5}"]
    scenario = load_scenario("lagged_turning_circle", settings)
    model = load_prediction_model(scenario)
    lag, limit = model.parameters.lag, model.effective_limit(100.0)
    gains, observer = scenario.ancillary_lagged.gains(lag, 0.1), scenario.state_estimator
    loop = lagged_loop(lag, 0.1, gains, observer.gains(lag, 0.1), observer.delay)
    G = model.effective().steady_velocity_jacobian(np.zeros(4))
    tube = ModeTube(loop, np.abs(G) @ (0.5 * model.wheel_shares.max(axis=0)))
    widths, turns, upper = tube.start(), [], None
    rows = read_at_samples(
        Simulator(MakeDiagram(scenario)), 20, "plan", "bias", "calibrated_bound", "error_bound"
    )
    for plan, bias, bound, error_bound in rows:
        shift = np.linalg.pinv(G) @ bias
        if upper is not None:
            for given, room in zip(plan.data.input_upper, upper, strict=True):
                np.testing.assert_allclose(given, np.minimum(limit, shift + room), rtol=1e-9)
        turn, velocities = np.diff(plan.states[:, 2]), plan.inputs @ G.T
        widths = tube.advance(widths, turn[0], 0.1 * bound)
        np.testing.assert_allclose(error_bound, tube.components(widths).T.ravel(), rtol=1e-9)
        following, upper = widths, []
        for stage in [*range(1, len(turn)), len(turn) - 1]:  # The last one is held.
            room = input_room(tube, following, gains, velocities[stage], np.linalg.pinv(G))
            upper.append(np.maximum(limit - room, 0.0))
            following = tube.advance(following, turn[stage], 0.1 * bound)
        turns.append(turn[0])
    assert np.ptp(turns) > 0.01  # So that a plan of another sample would show.


@pytest.mark.parametrize("scenario", [TURNING, WATCHED, PID, LQR])
def test_controller_has_no_feedthrough(scenario):
    controller = MakeController(scenario)
    direct = {
        output
        for i in range(controller.num_input_ports())
        for o, output in enumerate(output_names(controller))
        if controller.HasDirectFeedthrough(i, o)
    }
    # What the law could do for the pose of that instant, and the set once its error counts.
    assert direct <= {"reached", "calibrated_bound"}


def test_systems_are_named():
    diagram = MakeDiagram(TURNING)
    assert diagram.get_name() == "mirte_drake"
    parts = {system.get_name() for system in diagram.GetSystems()}
    assert parts == {"reference_source", "controller", "sindyc_robot", "disturbance_source"}
    inner = {s.get_name() for s in diagram.GetSubsystemByName("controller").GetSystems()}
    assert inner == {
        *("nominal_nmpc", "ancillary_dlqr", "tube_updater"),
        *("wheel_command_limiter", "command_hold"),
    }


@pytest.mark.parametrize("name", ["rectangle", "turning_circle", "robot_rectangle"])
def test_command_follows_from_the_pose_of_its_own_instant(name):
    scenario = load_scenario(name)
    limiter = scenario.wheel_command_limiter
    simulator = Simulator(MakeDiagram(scenario))
    largest_correction = 0.0
    for k in range(6):
        advance_to_sample(simulator, k)
        plan: Plan = read(simulator, "plan")
        pose = read(simulator, "pose")
        np.testing.assert_array_equal(plan.data.state, pose)
        correction = read(simulator, "designs")[0].gain @ pose_error(pose, plan.nominal_state)
        expected = limit_wheel_command(
            plan.nominal_input - correction,
            limit=scenario.input_limit,
            deadband=limiter.deadband,
            round_to_integer=limiter.round_to_integer,
        )
        np.testing.assert_array_equal(read(simulator, "wheel_command"), expected)
        largest_correction = max(largest_correction, np.max(np.abs(correction)))
    assert largest_correction > 1.0


def test_with_play_a_command_follows_at_its_distance():
    simulator = Simulator(
        MakeDiagram(load_scenario("lagged_rectangle", ["wheel_command_limiter.play=1.5"]))
    )
    controller = simulator.get_system().GetSubsystemByName("controller")
    law = controller.GetSubsystemByName("ancillary_lagged")
    last, stayed = np.zeros(4), 0
    for k in range(20):
        advance_to_sample(simulator, k)
        context = law.GetMyContextFromRoot(simulator.get_context())
        asked = law.GetOutputPort("wheel_command").Eval(context)
        expected = np.rint(np.clip(last, asked - 1.5, asked + 1.5))
        told = read(simulator, "wheel_command")
        np.testing.assert_array_equal(told, expected)
        stayed += np.sum((told == last) & (np.rint(asked) != last))
        last = told.copy()
    assert stayed >= 5


def test_input_limit_holds_for_plan_and_command():
    pose = np.array([0.0, 0.0, np.pi / 2])  # 0.6 m beside the path: full speed is needed.
    robot = SindycRobotConfig(initial_pose=pose)
    for scenario in (TURNING, BASELINE):
        scenario = dc.replace(scenario, robot=robot, input_limit=25.0)
        simulator = Simulator(MakeDiagram(scenario))
        rows = read_at_samples(simulator, 4, "plan", "wheel_command")
        assert np.max([np.abs(plan.inputs) for plan, _ in rows]) <= 25.0
        assert np.max([np.abs(command) for _, command in rows]) == pytest.approx(25.0, abs=1e-6)
        assert np.max([np.abs(command) for _, command in rows]) <= 25.0


def test_limiter_guards_the_input_limit():
    # A tube this wide lets the plan begin at its reference; the correction is then a large one.
    tube = TubeUpdaterConfig(initial_half_width=np.array([0.5, 0.5, 0.5]))
    scenario = dc.replace(TURNING, tube_updater=tube, input_limit=25.0)
    controller = MakeController(scenario)
    simulator = Simulator(controller)
    context = simulator.get_mutable_context()
    controller.GetInputPort("pose").FixValue(context, np.zeros(3))
    controller.GetInputPort("reference_window").FixValue(context, np.tile([0.5, 0, 0], 11))
    rows = read_at_samples(simulator, 2, "plan", "wheel_command", "designs")
    plan, command, designs = rows[0]
    wanted = plan.nominal_input - designs[0].gain @ pose_error(np.zeros(3), plan.nominal_state)
    assert np.max(np.abs(wanted)) > 50.0
    np.testing.assert_array_equal(command, np.clip(wanted, -25.0, 25.0))


def test_command_is_held_until_the_next_sample():
    simulator = Simulator(MakeDiagram(TURNING))
    advance_to_sample(simulator, 3)
    command = read(simulator, "wheel_command")
    simulator.AdvanceTo(0.399)
    np.testing.assert_array_equal(read(simulator, "wheel_command"), command)
    advance_to_sample(simulator, 4)
    assert np.all(read(simulator, "wheel_command") != command)


def test_stop_ramps_from_the_command_that_the_wheels_were_given():
    controller = MakeController(TURNING)
    simulator = Simulator(controller)
    pose, reference = controller.GetInputPort("pose"), controller.GetInputPort("reference_window")
    pose.FixValue(simulator.get_mutable_context(), np.zeros(3))
    reference.FixValue(simulator.get_mutable_context(), np.tile([0.5, 0.0, 0.0], 11))
    read_at_samples(simulator, 3, "plan")
    pose.FixValue(simulator.get_mutable_context(), np.array([-0.02, 0.0, 0.05]))
    reference.FixValue(simulator.get_mutable_context(), np.full(33, np.nan))
    for k in range(3, 6):
        advance_to_sample(simulator, k)
        assert read(simulator, "solve_status") == [SolveStatus.SHIFTED]
    command = read(simulator, "wheel_command")
    assert not np.allclose(command, read(simulator, "plan").nominal_input, atol=1.0)
    advance_to_sample(simulator, 6)
    assert read(simulator, "solve_status") == [SolveStatus.STOPPING]
    expected = np.sign(command) * np.maximum(np.abs(command) - 30.0, 0.0)
    np.testing.assert_allclose(read(simulator, "wheel_command"), expected)


def test_tube_moves_by_its_recursion():
    simulator = Simulator(MakeDiagram(TURNING))
    rows = read_at_samples(simulator, 6, "plan", "designs", "half_width")
    np.testing.assert_array_equal(rows[0][0].data.half_width, np.zeros(3))
    for k, (plan, designs, next_half_width) in enumerate(rows):
        expected = np.abs(designs[0].closed_loop) @ plan.data.half_width + 0.1 * W_MAX
        np.testing.assert_array_equal(next_half_width, expected)
        if k > 0:
            np.testing.assert_array_equal(plan.data.half_width, rows[k - 1][2])


@pytest.mark.parametrize("deadband", [0.0, 10.0])
def test_rigorous_tube_moves_by_the_pose_and_the_command_of_its_instant(deadband):
    limiter = WheelCommandLimiterConfig(deadband=deadband, round_to_integer=deadband > 0)
    scenario = dc.replace(RIGOROUS, wheel_command_limiter=limiter)
    model = load_prediction_model(scenario)
    mapping, k = turning_map(model), scenario.ancillary_inversion.feedback
    ports = ("plan", "pose", "wheel_command", "half_width", "reached")
    rows = read_at_samples(Simulator(MakeDiagram(scenario)), 6, *ports)
    for (plan, pose, command, half_width, reached), (later, *_) in itertools.pairwise(rows):
        nominal = plan.nominal_state, plan.nominal_next
        expected = propagate_inversion_tube(
            model, mapping, nominal, pose, command, plan.data.half_width, W_MAX, k, 0.1
        )
        np.testing.assert_allclose(half_width, expected, rtol=0, atol=1e-15)
        np.testing.assert_array_equal(later.data.half_width, half_width)
        room = required_room(
            mapping, plan.nominal_next[2], plan.inputs[1], half_width, k, 0.1, 100.0
        )
        np.testing.assert_allclose(later.data.input_upper, np.tile(100.0 - room, (10, 1)))
        assert reached == [1.0]
        if deadband == 0.0:
            left = pose_error(model.step(pose, command, 0.1), plan.nominal_next)
            error = pose_error(pose, plan.nominal_state)
            np.testing.assert_allclose(left, (1 - 0.1 * k) * error, rtol=0, atol=1e-12)


def test_monitor_judges_the_prediction_from_pose_and_command():
    model = load_prediction_model(WATCHED)
    rows = read_at_samples(
        Simulator(MakeDiagram(WATCHED)), 5, "pose", "wheel_command", "prediction_error"
    )
    for (pose, command, _), (later, _, error) in itertools.pairwise(rows):
        missed = pose_error(later, model.step(pose, command, 0.1)) / 0.1
        np.testing.assert_allclose(rotation(pose[2]) @ error, missed, rtol=0, atol=1e-12)
        assert np.all(np.abs(error) < 1.1 * W_MAX)


def test_bounds_of_a_sample_are_tightened_by_the_tube_of_the_sample_before():
    rows = read_at_samples(Simulator(MakeDiagram(TURNING)), 4, "plan", "designs")
    np.testing.assert_array_equal(rows[0][0].data.input_upper, np.full((10, 4), 90.0))
    for (before, designs), (plan, _) in itertools.pairwise(rows):
        room = np.abs(designs[0].gain) @ before.data.half_width
        np.testing.assert_allclose(plan.data.input_upper, np.tile(100.0 - room, (10, 1)))
        np.testing.assert_allclose(plan.data.input_lower, np.tile(room - 100.0, (10, 1)))


def test_stagewise_tube_uses_a_design_of_every_stage():
    tube = TubeUpdaterConfig(tightening_over_horizon="stagewise")
    simulator = Simulator(MakeDiagram(dc.replace(TURNING, tube_updater=tube)))
    *_, (before, designs), (plan, _) = read_at_samples(simulator, 3, "plan", "designs")
    assert [design.yaw for design in designs] == before.states[:10, 2].tolist()
    d = before.data.half_width
    for upper, design in zip(plan.data.input_upper, designs, strict=True):
        np.testing.assert_allclose(upper, 100.0 - np.abs(design.gain) @ d)
        d = np.abs(design.closed_loop) @ d + 0.1 * W_MAX


@pytest.mark.parametrize("scenario", [WITHOUT_TUBE, BASELINE], ids=["without_tube", "baseline"])
def test_without_tube_the_plan_begins_at_the_pose_and_is_applied_as_it_is(scenario):
    for plan, pose, command in read_at_samples(
        Simulator(MakeDiagram(scenario)), 4, "plan", "pose", "wheel_command"
    ):
        np.testing.assert_array_equal(plan.nominal_state, pose)
        np.testing.assert_array_equal(command, plan.nominal_input)
        np.testing.assert_array_equal(plan.data.input_upper, np.full((10, 4), 100.0))


def test_robot_begins_on_the_reference():
    simulator = Simulator(MakeDiagram(TURNING))
    np.testing.assert_array_equal(read(simulator, "pose"), read(simulator, "reference"))
    np.testing.assert_allclose(read(simulator, "pose"), [0.6, 0.0, np.pi / 2])


def test_robot_begins_where_its_config_says():
    robot = SindycRobotConfig(initial_pose=np.array([0.5, 0.1, 1.5]))
    simulator = Simulator(MakeDiagram(dc.replace(TURNING, robot=robot)))
    np.testing.assert_array_equal(read(simulator, "pose"), [0.5, 0.1, 1.5])


def test_disturbance_reaches_the_robot():
    disturbed, calm = (
        Simulator(MakeDiagram(dc.replace(TURNING, disturbance=d)))
        for d in (CornerDisturbance(), NoDisturbance())
    )
    for simulator in (disturbed, calm):
        simulator.AdvanceTo(0.05)
    np.testing.assert_array_equal(np.abs(read(disturbed, "disturbance")), W_MAX)
    moved = read(disturbed, "body_velocity") - read(calm, "body_velocity")
    # The yaws have parted by 4 mrad and the speed is below 0.1 m/s.
    np.testing.assert_allclose(moved, read(disturbed, "disturbance"), atol=5e-4)


def test_interleaved_simulators_with_two_seeds_give_what_each_gives_alone():
    ports = ("pose", "wheel_command", "half_width", "disturbance")
    alone = [
        read_at_samples(Simulator(MakeDiagram(dc.replace(TURNING, seed=seed))), 4, *ports)
        for seed in (0, 1)
    ]
    diagram = MakeDiagram(TURNING)
    simulators = [Simulator(diagram), Simulator(diagram)]
    source = diagram.GetSubsystemByName("disturbance_source")
    context = source.GetMyMutableContextFromRoot(simulators[1].get_mutable_context())
    context.get_mutable_numeric_parameter(0).SetAtIndex(0, 1.0)
    for k in range(4):
        for simulator, expected in zip(simulators, alone, strict=True):
            advance_to_sample(simulator, k)
            for port, value in zip(ports, expected[k], strict=True):
                np.testing.assert_array_equal(read(simulator, port), value)
    assert not np.allclose(read(simulators[0], "pose"), read(simulators[1], "pose"))


SETPOINT = dc.replace(
    TURNING,
    reference=VelocitySetpointConfig(setpoint=np.array([0.1, 0.0, 0.0]), start=np.ones(3)),
    duration=0.3,
)


def test_velocity_setpoint_is_tracked_from_its_start():
    simulator = Simulator(MakeDiagram(SETPOINT))
    np.testing.assert_array_equal(read(simulator, "pose"), np.ones(3))
    plans = [plan for (plan,) in read_at_samples(simulator, 4, "plan")]
    for k, plan in enumerate(plans):
        expected = np.ones(3) + 0.01 * k * np.array([np.cos(1.0), np.sin(1.0), 0.0])
        np.testing.assert_allclose(plan.data.reference[0], expected)


@pytest.mark.parametrize(
    "scenario", [dc.replace(TURNING, duration=0.3), SETPOINT], ids=["path", "setpoint"]
)
def test_logged_reference_is_that_of_its_own_sample(scenario):
    logged = simulate_run(scenario, "test").log["reference"]
    plans = read_at_samples(Simulator(MakeDiagram(scenario)), 4, "plan")
    np.testing.assert_allclose(logged, [plan.data.reference[0] for (plan,) in plans])


def test_add_robot_returns_its_ports():
    builder = DiagramBuilder()
    ports = AddRobot(builder, TURNING)
    assert isinstance(ports, RobotPorts)
    assert ports.pose.get_system() is builder.GetSubsystemByName("sindyc_robot")


@pytest.mark.parametrize(
    ("robot", "name"),
    [
        (SindycRobotConfig(), "sindyc_robot"),
        (DynamicRobotConfig(), "dynamic_robot"),
        (MultibodyRobotConfig(), "multibody_robot"),
    ],
)
def test_every_robot_is_a_part_of_its_name_with_the_odometry_in_it(robot, name):
    scenario = dc.replace(TURNING, robot=robot, odometry=OdometrySensorConfig())
    diagram = MakeDiagram(scenario)
    parts = {system.get_name() for system in diagram.GetSystems()}
    with_source = set() if name == "multibody_robot" else {"disturbance_source"}
    assert parts == {"reference_source", "controller", name} | with_source
    assert diagram.HasOutputPort("disturbance") == bool(with_source)
    simulator = Simulator(diagram)
    plans = read_at_samples(simulator, 3, "plan", "pose")
    for plan, pose in plans:
        assert plan.status is SolveStatus.SOLVED
        np.testing.assert_array_equal(plan.data.state, pose)  # Planned from what is measured.
    np.testing.assert_array_equal(plans[0][1], scenario.first_pose)
    assert diagram.GetSubsystemByName(name).HasSubsystemNamed("odometry_sensor")


def test_seed_of_the_scenario_is_that_of_the_odometry():
    robot = MultibodyRobotConfig()
    first, again, other = (
        read_at_samples(
            Simulator(MakeDiagram(dc.replace(TURNING, robot=robot, seed=seed))), 8, "pose"
        )
        for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, again)
    assert np.any(np.array(first) != np.array(other))


def test_add_controller_returns_it_by_name():
    builder = DiagramBuilder()
    controller = AddController(builder, TURNING)
    assert builder.GetSubsystemByName("controller") is controller


@pytest.mark.parametrize(
    ("scenario", "kind", "name"),
    [
        (TURNING, ReferenceSource, "reference_source"),
        (SETPOINT, VelocitySetpointSource, "velocity_setpoint_source"),
    ],
)
def test_add_reference_has_the_ports_that_the_controller_needs(scenario, kind, name):
    builder = DiagramBuilder()
    source = AddReference(builder, scenario)
    assert isinstance(source, kind)
    assert builder.GetSubsystemByName(name) is source
    assert source.GetOutputPort("reference").size() == 3
    assert source.GetOutputPort("reference_window").size() == 33


def test_dynamic_prediction_model_is_a_user_error():
    with pytest.raises(UserError, match=r"^prediction_model: 'dynamic'"):
        MakeDiagram(dc.replace(TURNING, prediction_model="dynamic"))


def test_dynamic_robot_is_driven_by_the_kinematic_prediction():
    robot = SindycRobotConfig(model="dynamic")
    simulator = Simulator(MakeDiagram(dc.replace(TURNING, robot=robot)))
    plans = read_at_samples(simulator, 2, "plan")
    assert [plan.status for (plan,) in plans] == [SolveStatus.SOLVED] * 2


def test_unknown_prediction_model_is_a_user_error():
    with pytest.raises(UserError, match="'rocket'"):
        MakeDiagram(dc.replace(TURNING, prediction_model="rocket"))


@pytest.mark.parametrize("make", [MakeDiagram, MakeController])
@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"period": 0.0}, "period"),
        ({"input_limit": np.nan}, "input_limit"),
        ({"ancillary_dlqr": None}, "tube_updater: needs ancillary_dlqr"),
        ({"tube_updater": TubeUpdaterConfig(disturbance_bound=-np.ones(3))}, "disturbance_bound"),
    ],
    ids=["period", "input_limit", "tube_without_ancillary", "disturbance_bound"],
)
def test_rejects_bad_scenario(make, changes, field):
    with pytest.raises(ValueError, match=field):
        make(dc.replace(TURNING, **changes))
