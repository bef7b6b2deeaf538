import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from system_ports import feedthrough, port_table

from mirte_drake.control.state_observer import correct, innovation, predict
from mirte_drake.model.lagged_model import LaggedModel, LaggedParameters
from mirte_drake.systems.state_estimator import (
    AddStateEstimator,
    StateEstimator,
    StateEstimatorConfig,
)

MODEL = LaggedModel(
    "robot",
    LaggedParameters(
        axis_gain=np.array([1.0, 0.5, 0.8]), deadband=5.0, lag=np.array([0.3, 0.15, 0.2]), delay=1
    ),
)
EFFECTIVE = MODEL.effective()
START, LATER = np.array([0.1, 0.2, 0.3]), np.array([0.105, 0.195, 0.31])
U = np.array([40.0, -30.0, 20.0, 55.0])


def make_dut(**config) -> StateEstimator:
    return StateEstimator(StateEstimatorConfig(**config), MODEL, period=0.1)


def simulate(dut) -> Simulator:
    simulator = Simulator(dut)
    tell(simulator, START, U)
    return simulator


def next_sample(simulator, pose) -> None:
    """Goes to just after 0.1 s, where the sample's outputs hold."""
    tell(simulator, pose, U)
    simulator.AdvanceTo(0.15)


def tell(simulator, pose, command) -> None:
    context = simulator.get_mutable_context()
    simulator.get_system().GetInputPort("pose").FixValue(context, pose)
    simulator.get_system().GetInputPort("wheel_command").FixValue(context, command)


def read(simulator, port) -> np.ndarray:
    return simulator.get_system().GetOutputPort(port).Eval(simulator.get_context())


def test_ports():
    inputs, outputs = port_table(make_dut())
    assert inputs == {"pose": 3, "wheel_command": 4}
    assert outputs == {"state": 6, "bias": 3, "innovation": 3}


@pytest.mark.parametrize("delay", [0, 2])
def test_outputs_follow_from_the_pose_not_from_the_command_that_they_lead_to(delay):
    assert feedthrough(make_dut(delay=delay)) == {
        ("pose", "state"),
        ("pose", "bias"),
        ("pose", "innovation"),
    }


def test_the_first_measurement_is_the_pose_of_a_robot_at_rest():
    simulator = simulate(make_dut())
    np.testing.assert_array_equal(read(simulator, "state"), [*START, 0, 0, 0])
    np.testing.assert_array_equal(read(simulator, "bias"), np.zeros(3))
    # Nothing has been predicted for it.
    np.testing.assert_array_equal(read(simulator, "innovation"), np.full(3, np.nan))


def test_without_delay_a_sample_predicts_and_corrects():
    dut = make_dut(delay=0)
    simulator = simulate(dut)
    simulator.AdvanceTo(0.05)
    next_sample(simulator, LATER)
    w = MODEL.effective_command(U)
    prior = predict(EFFECTIVE, np.array([*START, 0.0, 0.0, 0.0]), np.zeros(3), w, 0.1)
    state, bias = correct(prior, np.zeros(3), LATER, dut.gains)
    np.testing.assert_allclose(read(simulator, "state"), state, rtol=1e-13)
    np.testing.assert_allclose(read(simulator, "bias"), bias, rtol=1e-13)
    np.testing.assert_allclose(read(simulator, "innovation"), innovation(prior, LATER))


def test_delay_is_the_models_and_the_commands_sent_are_predicted_with():
    dut = make_dut()
    assert dut.delay == MODEL.delay == 1
    simulator = simulate(dut)
    simulator.AdvanceTo(0.05)
    # At the next sample the command has not acted; it is what the prediction goes ahead with.
    state, bias = correct(np.array([*START, 0.0, 0.0, 0.0]), np.zeros(3), LATER, dut.gains)
    next_sample(simulator, LATER)
    np.testing.assert_allclose(read(simulator, "bias"), bias, rtol=1e-13)
    ahead = predict(EFFECTIVE, state, bias, MODEL.effective_command(U), 0.1)
    np.testing.assert_allclose(read(simulator, "state"), ahead, rtol=1e-13)


@pytest.mark.parametrize("delay", [0, 3])
def test_estimate_meets_a_robot_with_that_delay_and_a_bias(delay):
    dut, bias = make_dut(delay=delay), np.array([0.04, -0.02, 0.08])
    simulator = simulate(dut)
    rng, poses, waiting = np.random.default_rng(0), [START], [np.zeros(4)] * delay
    state = np.array([*START, 0.0, 0.0, 0.0])
    states = [state]
    for k in range(80):
        command = U + rng.uniform(-10, 10, 4)
        tell(simulator, poses[-1], command)
        simulator.AdvanceTo(0.1 * k + 0.05)
        if k > 60:
            expected = state
            for w in waiting:
                expected = predict(EFFECTIVE, expected, bias, w, 0.1)
            np.testing.assert_allclose(read(simulator, "state"), expected, atol=5e-3)
            np.testing.assert_allclose(read(simulator, "bias"), bias, atol=5e-3)
        waiting = [*waiting, MODEL.effective_command(command)]
        state = predict(EFFECTIVE, state, bias, waiting.pop(0), 0.1)
        states.append(state)
        poses.append(state[:3])


def test_without_a_bias_it_stays_zero():
    simulator = simulate(make_dut(estimates_bias=False))
    for k in range(5):
        tell(simulator, START + 0.01 * k, U)
        simulator.AdvanceTo(0.1 * k + 0.05)
    np.testing.assert_array_equal(read(simulator, "bias"), np.zeros(3))


def test_a_measurement_that_is_not_finite_shows_but_does_not_stay():
    simulator = simulate(make_dut())
    simulator.AdvanceTo(0.05)
    next_sample(simulator, np.array([0.1, np.nan, 0.3]))
    assert not np.all(np.isfinite(read(simulator, "state")))
    tell(simulator, LATER, U)
    simulator.AdvanceTo(0.25)
    assert np.all(np.isfinite(read(simulator, "state")))


def test_interleaved_simulators_do_not_disturb_each_other():
    dut = make_dut()
    first, second = simulate(dut), simulate(dut)
    alone = [simulate(make_dut()) for _ in range(2)]
    for k in range(5):
        for i, simulator in enumerate((first, second, *alone)):
            tell(simulator, START + 0.01 * k * (i % 2), U)
            simulator.AdvanceTo(0.1 * k + 0.05)
    for port in ("state", "bias"):
        np.testing.assert_array_equal(read(first, port), read(alone[0], port))
        np.testing.assert_array_equal(read(second, port), read(alone[1], port))
    assert not np.array_equal(read(first, "state"), read(second, "state"))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("pose_noise", np.zeros(3)),
        ("position_drift", np.ones(2)),
        ("velocity_drift", np.array([0.1, np.nan, 0.1])),
        ("bias_drift", -np.ones(3)),
        ("delay", -1),
    ],
)
def test_rejects_bad_config(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        make_dut(**{field: value})


def test_add_names_and_returns_the_system():
    builder = DiagramBuilder()
    dut = AddStateEstimator(builder, StateEstimatorConfig(), MODEL, period=0.1, name="observer")
    assert isinstance(dut, StateEstimator)
    assert builder.Build().GetSubsystemByName("observer") is dut
