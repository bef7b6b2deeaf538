import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, Integrator
from system_ports import feedthrough, port_table

from mirte_drake.control.plan import Plan, SolveStatus
from mirte_drake.model.model_file import load_model
from mirte_drake.model.sparse_model import SparseModel
from mirte_drake.systems.nominal_nmpc import (
    AddNominalNmpc,
    NominalNmpc,
    NominalNmpcConfig,
    make_tracking_problem,
)

MODEL = load_model("extended_kinematic")
BY_HAND = SparseModel(
    "by hand",
    ["x", "y", "theta"],
    ["u1", "u2", "u3", "u4"],
    {"x": {"u1": 0.01}, "y": {"u2": 0.01}, "theta": {"u3": 0.01}},
)
STATE = np.array([0.1, -0.2, 0.3])
NEAR = STATE + np.array([0.02, 0.01, 0.0])
FAR = STATE + np.array([5.0, 0.0, 0.0])
SOLVED, SHIFTED, STOPPING = SolveStatus.SOLVED, SolveStatus.SHIFTED, SolveStatus.STOPPING
RATE_TOLERANCE = 1e-5  # The solvers' own, on the rate constraints [pwm].


def make_dut(model=MODEL, *, input_limit=100.0, **config) -> NominalNmpc:
    return NominalNmpc(NominalNmpcConfig(**config), model, period=0.1, input_limit=input_limit)


def simulate(dut, *, state=STATE, target=NEAR, **ports) -> Simulator:
    """Returns a simulator; the reference stands at ``target``."""
    simulator = Simulator(dut)
    window = np.tile(target, (dut.problem.horizon + 1, 1))
    fix(simulator, **{"state": state, "reference_window": window} | ports)
    return simulator


def fix(simulator, **ports) -> None:
    for name, value in ports.items():
        port = simulator.get_system().GetInputPort(name)
        port.FixValue(simulator.get_mutable_context(), np.ravel(value).astype(float))


def read(simulator, port="plan") -> Plan | np.ndarray:
    return simulator.get_system().GetOutputPort(port).Eval(simulator.get_context())


def plans(simulator, samples, first=0) -> list[Plan]:
    """Returns the plan of each of the samples ``first``, ``first`` + 1, ..."""
    found = []
    for k in range(first, first + samples):
        simulator.AdvanceTo(0.1 * k + 0.05)
        found.append(read(simulator))
    return found


def first_plan(dut, **ports) -> Plan:
    return plans(simulate(dut, **ports), 1)[0]


def test_ports():
    inputs, outputs = port_table(make_dut())
    assert inputs == {
        "state": 3,
        "reference_window": 33,
        "half_width": 3,
        "input_lower": 40,
        "input_upper": 40,
        "applied_input": 4,
    }
    assert outputs == {
        "plan": "abstract",
        "nominal_state": 3,
        "nominal_next": 3,
        "nominal_input": 4,
        "solve_status": 1,
    }


def test_no_output_has_feedthrough():
    assert feedthrough(make_dut()) == set()


def test_first_move_by_hand():
    # N = 1, x_1 = 0.001 u_1: (Q + P)(0.001 u - 0.02)^2 + (R + R_d) u^2 is least where
    # u = 2000 * 0.001 * 0.02 / (2000e-6 + 0.002) = 10.
    dut = make_dut(BY_HAND, horizon=1, terminal_weight=1000.0 * np.eye(3))
    plan = first_plan(dut, target=STATE + np.array([0.02, 0.0, 0.0]))
    np.testing.assert_allclose(plan.nominal_input, [10.0, 0.0, 0.0, 0.0], atol=1e-3)
    np.testing.assert_allclose(plan.nominal_next, STATE + np.array([0.01, 0.0, 0.0]), atol=1e-6)
    # 2000 * 0.01^2 + 0.002 * 10^2.
    assert plan.cost == pytest.approx(0.4, rel=1e-6)


def test_robot_on_its_reference_stays():
    plan = first_plan(make_dut(), target=STATE)
    np.testing.assert_allclose(plan.inputs, 0.0, atol=1e-4)
    np.testing.assert_allclose(plan.states, np.tile(STATE, (11, 1)), atol=1e-6)


def test_place_and_whole_turns_of_the_reference_do_not_count():
    expected = first_plan(make_dut()).inputs
    moved = first_plan(
        make_dut(), state=STATE + np.array([7, -3, 0]), target=NEAR + np.array([7, -3, 0])
    ).inputs
    turned = first_plan(make_dut(), target=NEAR + np.array([0, 0, 4 * np.pi])).inputs
    np.testing.assert_allclose(moved, expected, atol=1e-4)
    np.testing.assert_allclose(turned, expected, atol=1e-4)


def test_one_solve_per_sample():
    simulator = simulate(make_dut())
    assert read(simulator).sample == -1
    assert [plan.sample for plan in plans(simulator, 5)] == [0, 1, 2, 3, 4]


def test_plan_is_held_between_samples():
    simulator = simulate(make_dut())
    simulator.AdvanceTo(0.01)
    early = read(simulator)
    simulator.AdvanceTo(0.099)
    assert read(simulator) is early


def test_plan_answers_to_the_state_of_its_own_instant():
    builder = DiagramBuilder()
    velocity = builder.AddSystem(ConstantVectorSource([0.2, -0.1, 0.5]))
    pose = builder.AddSystem(Integrator(3))
    reference = builder.AddSystem(ConstantVectorSource(np.zeros(33)))
    dut = AddNominalNmpc(builder, NominalNmpcConfig(), MODEL, period=0.1)
    builder.Connect(velocity.get_output_port(), pose.get_input_port())
    builder.Connect(pose.get_output_port(), dut.GetInputPort("state"))
    builder.Connect(reference.get_output_port(), dut.GetInputPort("reference_window"))
    simulator = Simulator(builder.Build())
    for k in range(4):
        simulator.AdvanceTo(0.1 * k)
        simulator.AdvancePendingEvents()
        plan = dut.GetOutputPort("plan").Eval(dut.GetMyContextFromRoot(simulator.get_context()))
        assert plan.sample == k
        np.testing.assert_allclose(plan.data.state, 0.1 * k * np.array([0.2, -0.1, 0.5]))


def test_outputs_are_those_of_the_plan():
    half_width = np.array([0.01, 0.01, 0.02])
    simulator = simulate(make_dut(), half_width=half_width)
    (plan,) = plans(simulator, 1)
    np.testing.assert_array_equal(read(simulator, "nominal_state"), plan.states[0])
    np.testing.assert_array_equal(read(simulator, "nominal_next"), plan.states[1])
    np.testing.assert_array_equal(read(simulator, "nominal_input"), plan.inputs[0])
    expected = MODEL.step(plan.states[0], plan.inputs[0], 0.1)
    np.testing.assert_allclose(plan.states[1], expected, atol=1e-12)


def test_without_half_width_the_nominal_state_is_the_measured_one():
    np.testing.assert_array_equal(first_plan(make_dut()).nominal_state, STATE)


def test_with_half_width_the_nominal_state_moves_within_it():
    half_width = np.array([0.01, 0.02, 0.005])
    plan = first_plan(make_dut(), half_width=half_width, target=STATE + np.array([1.0, -1.0, 0.5]))
    # Starting nearer to the reference is free, so the nominal state goes to the edge.
    np.testing.assert_allclose(plan.nominal_state, STATE + half_width * [1, -1, 1], atol=1e-6)
    assert np.all(np.abs(plan.nominal_state - STATE) <= half_width + 1e-15)


def test_first_move_is_limited_against_rest():
    plan = first_plan(make_dut(), target=FAR)
    assert plan.status is SOLVED
    assert np.max(np.abs(plan.nominal_input)) == pytest.approx(30.0, abs=RATE_TOLERANCE)
    assert np.max(np.abs(np.diff(plan.inputs, axis=0))) <= 30.0 + RATE_TOLERANCE


def test_moves_are_limited_against_the_previous_nominal_input():
    applied = np.array([100.0, -100.0, 100.0, -100.0])  # Not what the rate starts from.
    simulator = simulate(make_dut(), target=FAR, applied_input=applied)
    inputs = np.array([np.zeros(4), *[plan.nominal_input for plan in plans(simulator, 3)]])
    assert np.max(np.abs(np.diff(inputs, axis=0)), axis=1) == pytest.approx(30, abs=RATE_TOLERANCE)
    assert np.max(np.abs(inputs[-1])) > 80.0


def test_inputs_stay_within_the_limit_while_the_bound_ports_are_open():
    simulator = simulate(make_dut(input_limit=40.0), target=FAR)
    inputs = np.array([plan.inputs for plan in plans(simulator, 3)])
    assert np.max(np.abs(inputs)) == pytest.approx(40.0, abs=1e-6)
    assert np.max(np.abs(inputs)) <= 40.0


def test_every_stage_has_its_own_bounds():
    upper = np.array([[20.0 + i, 15.0, 12.0 + 2 * i, 90.0] for i in range(10)])
    lower = np.tile([-90.0, -90.0, -90.0, -5.0], (10, 1))
    plan = first_plan(make_dut(), target=FAR, input_lower=lower, input_upper=upper)
    assert plan.status is SOLVED
    assert np.all(plan.inputs <= upper)
    assert np.all(plan.inputs >= lower)
    # Forward as fast as possible: the first two wheels drive along their bounds.
    np.testing.assert_allclose(plan.inputs[:, :2], upper[:, :2], atol=1e-5)


def test_failed_solves_shift_the_plan_then_stop_then_recover():
    simulator = simulate(make_dut(), target=FAR)
    solved = plans(simulator, 4)[-1]
    assert np.max(solved.nominal_input) > 85.0
    fix(simulator, state=[np.nan, 0.0, 0.0])
    failed = plans(simulator, 6, first=4)
    fix(simulator, state=STATE)
    recovered = plans(simulator, 1, first=10)[0]

    assert [plan.status for plan in failed] == [SHIFTED] * 3 + [STOPPING] * 3
    assert [plan.failures for plan in failed] == [1, 2, 3, 4, 5, 6]
    assert all("finite" in plan.message for plan in failed)
    for i, plan in enumerate(failed[:3], start=1):
        np.testing.assert_array_equal(plan.inputs[: 10 - i], solved.inputs[i:])
        np.testing.assert_allclose(plan.states[: 11 - i], solved.states[i:], atol=1e-12)
    command = failed[2].nominal_input
    for plan in failed[3:]:
        command = np.sign(command) * np.maximum(np.abs(command) - 30.0, 0.0)
        np.testing.assert_allclose(plan.nominal_input, command, atol=1e-12)
    assert recovered.status is SOLVED
    assert recovered.failures == 0
    np.testing.assert_array_equal(recovered.nominal_state, STATE)


def test_stop_ramps_from_the_applied_input_to_zero():
    simulator = simulate(make_dut(), state=np.full(3, np.nan), applied_input=[80, -20, 30, 0])
    (plan,) = plans(simulator, 1)
    assert plan.status is STOPPING  # There is no plan to shift before the first solve.
    expected = np.zeros((10, 4))
    expected[:2, 0] = [50.0, 20.0]
    np.testing.assert_array_equal(plan.inputs, expected)


def test_stop_at_a_finite_state_begins_there():
    simulator = simulate(make_dut(), half_width=np.full(3, np.nan))
    (plan,) = plans(simulator, 1)
    assert plan.status is STOPPING
    np.testing.assert_array_equal(plan.nominal_state, STATE)


def test_solve_that_recovers_is_limited_against_the_ramp():
    simulator = simulate(make_dut(), target=FAR)
    plans(simulator, 4)
    fix(simulator, state=np.full(3, np.nan))
    stopped = plans(simulator, 5, first=4)[-1]
    fix(simulator, state=STATE)
    recovered = plans(simulator, 1, first=9)[0]
    move = np.abs(recovered.nominal_input - stopped.nominal_input)
    assert np.max(move) == pytest.approx(30.0, abs=RATE_TOLERANCE)


def test_solve_status_port_follows_the_plan():
    simulator = simulate(make_dut())
    seen = [read(simulator, "solve_status")[0]]
    for k, x in enumerate([0.0, np.nan, np.nan, np.inf, -np.inf, np.nan, 0.0]):
        fix(simulator, state=[x, 0.0, 0.0])
        plans(simulator, 1, first=k)
        seen.append(read(simulator, "solve_status")[0])
    assert seen == [2, 0, 1, 1, 1, 2, 2, 0]


@pytest.mark.parametrize(("bound", "reached"), [(50.0, 50.0), (1e10, 100.0), (1e200, 100.0)])
def test_bounds_out_of_reach_are_met_at_once_and_within_the_limit(bound, reached):
    """From rest, at 30 PWM per sample: the rate gives way, the input limit does not."""
    simulator = simulate(make_dut())
    fix(simulator, input_lower=np.full(40, bound), input_upper=np.full(40, bound))
    (plan,) = plans(simulator, 1)
    assert plan.status is SolveStatus.RELAXED
    assert plan.message == f"bounds ask for a move of {reached:g} pwm"
    np.testing.assert_array_equal(plan.inputs, np.full((10, 4), reached))


@pytest.mark.filterwarnings("ignore:overflow encountered", "ignore:invalid value encountered")
@pytest.mark.parametrize(
    "ports",
    [
        {"state": np.full(3, np.inf)},
        {"state": np.full(3, 1e300)},
        {"state": np.full(3, 1e17)},
        {"reference_window": np.full(33, np.nan)},
        {"reference_window": np.full(33, 1e200)},
        {"half_width": -np.ones(3)},
        {"half_width": np.full(3, np.inf)},
        {"input_lower": np.full(40, 10.0), "input_upper": np.full(40, -10.0)},
        {"applied_input": np.full(4, np.nan), "state": np.full(3, np.nan)},
    ],
)
def test_problem_that_cannot_be_solved_stops_the_wheels(ports):
    try:
        plan = first_plan(make_dut(), **ports)
    except SystemExit as error:  # Drake's own, which pytest would pass on.
        pytest.fail(f"ended the process: {error}")
    assert plan.status is STOPPING
    assert plan.message
    np.testing.assert_array_equal(plan.inputs, np.zeros((10, 4)))


def test_solve_over_its_time_limit_ends_early_with_an_iterate():
    plan = first_plan(make_dut(time_limit=1e-9))
    assert plan.status is SolveStatus.EARLY
    assert "time limit" in plan.message


@pytest.mark.parametrize("solver", ["snopt", "ipopt"])
def test_program_over_its_time_limit_has_failed(solver):
    plan = first_plan(make_dut(solver=solver, time_limit=1e-6))
    assert plan.status is STOPPING
    assert "time limit" in plan.message.lower() or "TimeLimit" in plan.message


def test_interleaved_simulators_do_not_disturb_each_other():
    dut = make_dut()
    targets = (NEAR, STATE + np.array([-0.3, 0.4, 1.0]))
    alone = [[p.inputs for p in plans(simulate(make_dut(), target=t), 4)] for t in targets]
    simulators = [simulate(dut, target=t) for t in targets]
    for k in range(4):
        for simulator, expected in zip(simulators, alone, strict=True):
            np.testing.assert_array_equal(plans(simulator, 1, first=k)[0].inputs, expected[k])


def test_advancing_one_context_leaves_another_unchanged():
    dut = make_dut()
    other = dut.CreateDefaultContext()
    plans(simulate(dut), 2)
    assert dut.GetOutputPort("plan").Eval(other).sample == -1


def test_robot_settings_count_the_rate_per_second():
    config = NominalNmpcConfig(
        rate_unit="pwm_per_s",
        rate_limit=30.0,
        rate_weight=np.array([0.1, 0.2, 0.3, 0.4]),
        stage_cost_factor=0.1,
    )
    problem = make_tracking_problem(config, MODEL, 0.1)
    np.testing.assert_allclose(problem.rate_limit, np.full(4, 3.0))
    # T_s * 0.1 / T_s^2 = 1.
    np.testing.assert_allclose(problem.rate_weight, np.diag([1.0, 2.0, 3.0, 4.0]))
    plan = first_plan(make_dut(rate_unit="pwm_per_s"), target=FAR)
    assert np.max(np.abs(plan.nominal_input)) == pytest.approx(3.0, abs=RATE_TOLERANCE)


def test_stage_cost_factor_scales_all_but_the_terminal_cost():
    config = NominalNmpcConfig(stage_cost_factor=0.1)
    problem = make_tracking_problem(config, MODEL, 0.1)
    np.testing.assert_allclose(problem.state_weight, 100.0 * np.eye(3))
    np.testing.assert_allclose(problem.input_weight, 1e-4 * np.eye(4))
    np.testing.assert_allclose(problem.rate_weight, 1e-4 * np.eye(4))
    np.testing.assert_array_equal(problem.terminal_weight, config.terminal_weight)


def test_scaling_all_costs_changes_no_input():
    P = np.diag([3000.0, 7000.0, 1400.0])
    plain = first_plan(make_dut(terminal_weight=P))
    scaled = first_plan(make_dut(terminal_weight=0.1 * P, stage_cost_factor=0.1))
    np.testing.assert_allclose(scaled.inputs, plain.inputs, atol=2e-3)
    assert scaled.cost == pytest.approx(0.1 * plain.cost, rel=1e-6)


def test_without_terminal_weight_the_riccati_matrix_is_taken():
    dut = make_dut(BY_HAND, terminal_weight=None)
    # Each axis alone: p^2 - q p - q r / b^2 = 0 with q = 1000, r = 0.001, b = 0.001.
    P = 1000 * (1 + np.sqrt(5)) / 2 * np.eye(3)
    np.testing.assert_allclose(dut.problem.terminal_weight, P, rtol=1e-9)
    assert first_plan(dut).status is SOLVED


def test_alignment_chooses_the_references_that_count():
    window = np.tile(NEAR, (11, 1))
    first, last = window.copy(), window.copy()
    first[0, 0] += 0.1
    last[-1, 0] += 0.1

    def inputs(alignment, reference_window):
        dut = make_dut(reference_alignment=alignment)
        return first_plan(dut, reference_window=reference_window).inputs

    np.testing.assert_array_equal(inputs("published", last), inputs("published", window))
    np.testing.assert_array_equal(inputs("aligned", first), inputs("aligned", window))
    assert np.max(np.abs(inputs("published", first) - inputs("published", window))) > 0.1
    assert np.max(np.abs(inputs("aligned", last) - inputs("aligned", window))) > 0.1


def test_solvers_agree():
    snopt = first_plan(make_dut(solver="snopt"), half_width=np.full(3, 0.005))
    ipopt = first_plan(make_dut(solver="ipopt"), half_width=np.full(3, 0.005))
    assert ipopt.status is SOLVED
    np.testing.assert_allclose(ipopt.inputs, snopt.inputs, atol=0.01)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("horizon", 0),
        ("state_weight", np.zeros(3)),
        ("state_weight", np.ones(4)),
        ("input_weight", np.array([1.0, 1.0, np.nan, 1.0])),
        ("input_weight", np.zeros(4)),
        ("input_weight", np.full(4, 1e-7)),
        ("rate_weight", -np.ones(4)),
        ("rate_limit", 0.0),
        ("rate_limit", np.inf),
        ("rate_unit", "pwm"),
        ("terminal_weight", np.ones(3)),
        ("terminal_weight", np.full((3, 3), np.nan)),
        ("terminal_weight", np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])),
        ("terminal_weight", -np.eye(3)),
        ("stage_cost_factor", 0.0),
        ("reference_alignment", "late"),
        ("solver", "magic"),
        ("tolerance", 0.0),
        ("time_limit", -1.0),
    ],
)
def test_rejects_bad_config(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        make_dut(**{field: value})


def test_add_names_and_returns_the_system():
    builder = DiagramBuilder()
    dut = AddNominalNmpc(builder, NominalNmpcConfig(), MODEL, period=0.1, name="planner")
    assert isinstance(dut, NominalNmpc)
    assert builder.Build().GetSubsystemByName("planner") is dut
