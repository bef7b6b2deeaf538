import numpy as np
import pytest
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.symbolic import Evaluate, MakeVectorVariable
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from mirte_drake.angles import rotation
from mirte_drake.errors import UserError
from mirte_drake.model.model_file import load_model, model_names
from mirte_drake.robots.robot_ports import RobotPorts
from mirte_drake.robots.sindyc_robot import (
    AddSindycRobot,
    SindycRobot,
    SindycRobot_,
    SindycRobotConfig,
)

QUARTER_TURN = np.array([1.0, 2.0, np.pi / 2])
TENS = np.full(4, 10.0)
# Sums of the coefficients of the kinematic model: by sin(theta) in x and y,
# and in the yaw rate, times 10 pwm.
X_SIN = 10 * (0.00033047 - 0.00087532 + 0.0010968 - 0.00061986)
Y_SIN = 10 * (0.0015423 + 0.0018272 + 0.0021491 + 0.0018469)
YAW = 10 * (-0.0067258 + 0.0069079 + 0.0065961 - 0.0066846)
COMMAND = np.array([30.0, -20.0, 50.0, 10.0])


def make_state(model) -> np.ndarray:
    return np.array([0.3, -0.4, 0.7, 0.2, -0.1, 0.5])[: model.num_states]


def make_dut(name="kinematic", state=QUARTER_TURN) -> SindycRobot:
    return SindycRobot(load_model(name), state)


def make_context(dut, *, command=TENS, disturbance=None):
    context = dut.CreateDefaultContext()
    dut.GetInputPort("wheel_command").FixValue(context, command)
    if disturbance is not None:
        dut.GetInputPort("disturbance").FixValue(context, disturbance)
    return context


def derivative(dut, context) -> np.ndarray:
    return dut.EvalTimeDerivatives(context).CopyToVector()


def test_ports():
    dut = make_dut("dynamic", np.zeros(6))
    inputs = {name: dut.GetInputPort(name).size() for name in ("wheel_command", "disturbance")}
    outputs = {name: dut.GetOutputPort(name).size() for name in ("pose", "state", "body_velocity")}
    assert inputs == {"wheel_command": 4, "disturbance": 3}
    assert outputs == {"pose": 3, "state": 6, "body_velocity": 3}
    assert (dut.num_input_ports(), dut.num_output_ports()) == (2, 3)


def test_only_the_body_velocity_has_feedthrough():
    dut = make_dut()
    found = {
        (i, o)
        for i in ("wheel_command", "disturbance")
        for o in ("pose", "state", "body_velocity")
        if dut.HasDirectFeedthrough(
            dut.GetInputPort(i).get_index(), dut.GetOutputPort(o).get_index()
        )
    }
    assert found == {("wheel_command", "body_velocity"), ("disturbance", "body_velocity")}


def test_derivative_by_hand_with_the_disturbance_port_open():
    dut = make_dut()
    actual = derivative(dut, make_context(dut))
    np.testing.assert_allclose(actual, [X_SIN, Y_SIN, YAW], atol=1e-15)


def test_disturbance_of_the_body_is_turned_into_the_world():
    dut = make_dut()
    context = make_context(dut, disturbance=[0.04, 0.03, 0.09])
    expected = [X_SIN - 0.03, Y_SIN + 0.04, YAW + 0.09]
    np.testing.assert_allclose(derivative(dut, context), expected, atol=1e-15)


def test_body_velocity_is_the_turned_derivative_by_hand():
    dut = make_dut()
    context = make_context(dut, disturbance=[0.04, 0.03, 0.09])
    actual = dut.GetOutputPort("body_velocity").Eval(context)
    np.testing.assert_allclose(actual, [Y_SIN + 0.04, -X_SIN + 0.03, YAW + 0.09], atol=1e-15)


@pytest.mark.parametrize("name", model_names())
def test_body_velocity_is_the_turned_derivative(name):
    model = load_model(name)
    dut = make_dut(name, make_state(model))
    context = make_context(dut, command=COMMAND, disturbance=[0.1, -0.2, 0.3])
    expected = rotation(0.7).T @ derivative(dut, context)[:3]
    actual = dut.GetOutputPort("body_velocity").Eval(context)
    np.testing.assert_allclose(actual, expected, atol=1e-15)


def test_disturbance_moves_the_pose_of_a_dynamic_model_not_its_velocity():
    dut = make_dut("dynamic", np.array([0.0, 0.0, np.pi / 2, 0.1, 0.2, 0.3]))
    calm = derivative(dut, make_context(dut))
    disturbed = derivative(dut, make_context(dut, disturbance=[0.04, 0.03, 0.09]))
    np.testing.assert_allclose(disturbed - calm, [-0.03, 0.04, 0.09, 0, 0, 0], atol=1e-15)


def test_initial_state_is_the_given_one():
    state = np.arange(6.0)
    dut = make_dut("dynamic", state)
    context = dut.CreateDefaultContext()
    np.testing.assert_array_equal(dut.GetOutputPort("state").Eval(context), state)
    np.testing.assert_array_equal(dut.GetOutputPort("pose").Eval(context), state[:3])


def test_initial_state_is_copied():
    state = np.zeros(3)
    dut = make_dut(state=state)
    state[:] = 7.0
    context = dut.CreateDefaultContext()
    np.testing.assert_array_equal(dut.GetOutputPort("state").Eval(context), np.zeros(3))


@pytest.mark.parametrize("name", model_names())
def test_held_input_moves_the_robot_as_the_model_steps(name):
    model = load_model(name)
    dut = make_dut(name, make_state(model))
    simulator = Simulator(dut, make_context(dut, command=COMMAND))
    simulator.get_mutable_integrator().set_target_accuracy(1e-9)
    simulator.AdvanceTo(1.0)
    expected = make_state(model)
    for _ in range(10):
        expected = model.step(expected, COMMAND, 0.1)
    actual = dut.GetOutputPort("state").Eval(simulator.get_context())
    np.testing.assert_allclose(actual, expected, atol=1e-6)
    assert np.linalg.norm(actual - make_state(model)) > 0.1


def test_zero_input_leaves_a_kinematic_robot_where_it_is():
    dut = make_dut("extended_kinematic")
    simulator = Simulator(dut, make_context(dut, command=np.zeros(4)))
    simulator.AdvanceTo(1.0)
    pose = dut.GetOutputPort("pose").Eval(simulator.get_context())
    np.testing.assert_array_equal(pose, QUARTER_TURN)


def test_yaw_is_not_wrapped():
    dut = make_dut()
    context = make_context(dut, command=np.zeros(4), disturbance=[0.0, 0.0, 2.0])
    simulator = Simulator(dut, context)
    simulator.AdvanceTo(5.0)
    yaw = dut.GetOutputPort("pose").Eval(simulator.get_context())[2]
    assert yaw == pytest.approx(np.pi / 2 + 10.0)


@pytest.mark.parametrize("name", model_names())
def test_autodiff_jacobian_is_the_models_linearisation(name):
    model = load_model(name)
    x, n = make_state(model), model.num_states
    dut = make_dut(name, x).ToAutoDiffXd()
    assert isinstance(dut, SindycRobot_[AutoDiffXd])
    variables = InitializeAutoDiff(np.concatenate([x, COMMAND])).ravel()
    context = dut.CreateDefaultContext()
    context.SetContinuousState(variables[:n])
    dut.GetInputPort("wheel_command").FixValue(context, variables[n:])
    actual = derivative(dut, context)
    f, A, B = model.linearise(x, COMMAND)
    np.testing.assert_allclose(ExtractValue(actual).ravel(), f, atol=1e-15)
    np.testing.assert_allclose(ExtractGradient(actual), np.hstack([A, B]), atol=1e-12)


def test_autodiff_of_the_disturbance_is_the_rotation():
    dut = make_dut().ToAutoDiffXd()
    context = dut.CreateDefaultContext()
    dut.GetInputPort("wheel_command").FixValue(context, InitializeAutoDiff(TENS, 7, 3).ravel())
    w = InitializeAutoDiff(np.zeros(3), 7, 0).ravel()
    dut.GetInputPort("disturbance").FixValue(context, w)
    actual = ExtractGradient(derivative(dut, context))[:, :3]
    np.testing.assert_allclose(actual, rotation(np.pi / 2), atol=1e-15)


# NumPy reads stray floating-point flags after calls on Expression objects.
@pytest.mark.filterwarnings("ignore:invalid value encountered:RuntimeWarning")
@pytest.mark.parametrize("name", model_names())
def test_symbolic_derivative_evaluates_to_the_numeric_one(name):
    model = load_model(name)
    x, w = make_state(model), np.array([0.1, -0.2, 0.3])
    numeric = make_dut(name, x)
    dut = numeric.ToSymbolic()
    symbols = [
        MakeVectorVariable(len(v), letter) for v, letter in ((x, "x"), (COMMAND, "u"), (w, "w"))
    ]
    context = dut.CreateDefaultContext()
    context.SetContinuousState(symbols[0])
    dut.GetInputPort("wheel_command").FixValue(context, symbols[1])
    dut.GetInputPort("disturbance").FixValue(context, symbols[2])
    values = dict(zip(np.concatenate(symbols), np.concatenate([x, COMMAND, w]), strict=True))
    numeric_context = make_context(numeric, command=COMMAND, disturbance=w)
    np.testing.assert_allclose(
        Evaluate(derivative(dut, context), values).ravel(),
        derivative(numeric, numeric_context),
        atol=1e-14,
    )
    np.testing.assert_allclose(
        Evaluate(dut.GetOutputPort("body_velocity").Eval(context), values).ravel(),
        numeric.GetOutputPort("body_velocity").Eval(numeric_context),
        atol=1e-14,
    )


@pytest.mark.parametrize(
    ("convert", "value_of"), [("ToAutoDiffXd", ExtractValue), ("ToSymbolic", Evaluate)]
)
def test_conversion_keeps_the_initial_state(convert, value_of):
    dut = getattr(make_dut(), convert)()
    pose = dut.GetOutputPort("pose").Eval(dut.CreateDefaultContext())
    np.testing.assert_array_equal(value_of(pose).ravel(), QUARTER_TURN)


def test_interleaved_simulators_do_not_disturb_each_other():
    dut = make_dut()
    commands = (COMMAND, -TENS)
    both = [Simulator(dut, make_context(dut, command=c)) for c in commands]
    others = [make_dut(), make_dut()]
    alone = [
        Simulator(other, make_context(other, command=c))
        for other, c in zip(others, commands, strict=True)
    ]
    for k in range(1, 5):
        for simulator in (*both, *alone):
            simulator.AdvanceTo(0.1 * k)
    states = [s.get_context().get_continuous_state_vector().CopyToVector() for s in (*both, *alone)]
    np.testing.assert_array_equal(states[:2], states[2:])
    assert not np.allclose(states[0], states[1])
    pose = dut.GetOutputPort("pose").Eval(dut.CreateDefaultContext())
    np.testing.assert_array_equal(pose, QUARTER_TURN)


@pytest.mark.parametrize("state", [np.zeros(6), np.array([0.0, np.nan, 0.0])])
def test_rejects_bad_initial_state(state):
    with pytest.raises(ValueError, match=r"^initial_state: "):
        make_dut(state=state)


@pytest.mark.parametrize("pose", [np.zeros(2), np.array([0.0, np.inf, 0.0])])
def test_rejects_bad_initial_pose(pose):
    config = SindycRobotConfig(initial_pose=pose)
    with pytest.raises(ValueError, match=r"^initial_pose: "):
        AddSindycRobot(DiagramBuilder(), config, start=np.zeros(3))


def test_rejects_unknown_model():
    with pytest.raises(UserError, match="'rocket'"):
        AddSindycRobot(DiagramBuilder(), SindycRobotConfig(model="rocket"), start=np.zeros(3))


def test_add_names_the_system_and_returns_its_ports():
    builder = DiagramBuilder()
    ports = AddSindycRobot(builder, SindycRobotConfig(), start=QUARTER_TURN, name="mirte")
    assert isinstance(ports, RobotPorts)
    dut = builder.Build().GetSubsystemByName("mirte")
    assert isinstance(dut, SindycRobot)
    offered = {name: port for name, port in vars(ports).items() if port is not None}
    assert set(vars(ports)) - set(offered) == {"wheel_angles"}  # It has no wheels.
    for name, port in offered.items():
        assert port.get_name() == name.removeprefix("true_")
        assert port.get_system() is dut


def test_add_begins_at_the_start_at_rest():
    builder = DiagramBuilder()
    AddSindycRobot(builder, SindycRobotConfig(model="dynamic"), start=QUARTER_TURN)
    dut = builder.Build().GetSubsystemByName("sindyc_robot")
    state = dut.GetOutputPort("state").Eval(dut.CreateDefaultContext())
    np.testing.assert_array_equal(state, [*QUARTER_TURN, 0, 0, 0])


def test_initial_pose_of_the_config_goes_before_the_start():
    builder = DiagramBuilder()
    config = SindycRobotConfig(initial_pose=np.array([4.0, 5.0, 6.0]))
    AddSindycRobot(builder, config, start=QUARTER_TURN)
    dut = builder.Build().GetSubsystemByName("sindyc_robot")
    pose = dut.GetOutputPort("pose").Eval(dut.CreateDefaultContext())
    np.testing.assert_array_equal(pose, [4.0, 5.0, 6.0])
