import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from mirte_drake.geometry import PWM_SPEED, body_velocity
from mirte_drake.model.drivetrain import DrivetrainParameters, steady_speed
from mirte_drake.model.robot_file import load_robot_file
from mirte_drake.robots.motor import MOTORS, Motor, motor_parameters
from mirte_drake.vectors import YAW

PARAMETERS = DrivetrainParameters(
    gain=np.array([[0.1, 0.2, 0.3, 0.4], [0.5, 0.6, 0.7, 0.8]]),
    deadband=np.array([[10.0, 0.0, 5.0, 20.0], [0.0, 10.0, 5.0, 0.0]]),
    lag=np.array([0.1, 0.2, 0.05, 0.1]),
)
COMMAND = np.array([50.0, -50.0, -3.0, 30.0])
STEADY = np.array([0.1 * 40, -0.6 * 40, 0.0, 0.4 * 10])  # [rad/s]


def simulate(dut: Motor, command=COMMAND) -> Simulator:
    simulator = Simulator(dut)
    dut.GetInputPort("wheel_command").FixValue(simulator.get_mutable_context(), command)
    return simulator


def desired(simulator: Simulator) -> np.ndarray:
    port = simulator.get_system().GetOutputPort("desired_state")
    return port.Eval(simulator.get_context())


def test_ports():
    dut = Motor(PARAMETERS, period=0.01)
    assert dut.GetInputPort("wheel_command").size() == 4
    assert dut.GetOutputPort("desired_state").size() == 8
    assert (dut.num_input_ports(), dut.num_output_ports()) == (1, 1)
    assert not dut.HasAnyDirectFeedthrough()


def test_speed_lags_behind_by_hand():
    simulator = simulate(Motor(PARAMETERS, period=0.01))
    simulator.AdvanceTo(0.025)  # Past the updates at 0, 0.01 and 0.02 s.
    expected = STEADY * (1 - np.exp(-0.03 / PARAMETERS.lag))
    np.testing.assert_allclose(desired(simulator), [*np.zeros(4), *expected], rtol=1e-12)


def test_interleaved_simulators_do_not_disturb_each_other():
    dut = Motor(PARAMETERS, period=0.01)
    both = [simulate(dut, COMMAND), simulate(dut, -COMMAND)]
    alone = [simulate(Motor(PARAMETERS, period=0.01), c) for c in (COMMAND, -COMMAND)]
    for k in range(1, 5):
        for simulator in (*both, *alone):
            simulator.AdvanceTo(0.01 * k)
    for shared, own in zip(both, alone, strict=True):
        np.testing.assert_array_equal(desired(shared), desired(own))
    assert not np.array_equal(desired(both[0]), desired(both[1]))


def test_clean_motors_are_the_ideal_ones():
    np.testing.assert_allclose(
        steady_speed(motor_parameters("clean"), COMMAND), PWM_SPEED * COMMAND, rtol=1e-15
    )


def test_fitted_motors_have_the_gains_of_the_fitted_robot():
    fitted = load_robot_file("fitted").parameters.drivetrain
    motors = motor_parameters("fitted")
    np.testing.assert_array_equal(motors.gain, fitted.gain)
    np.testing.assert_array_equal(motors.friction, fitted.friction)
    np.testing.assert_array_equal(motors.lag, motor_parameters("clean").lag)


@pytest.mark.parametrize("name", MOTORS)
def test_named_sets_are_valid_and_nobody_elses(name):
    motors = motor_parameters(name)
    motors.validate()
    motors.gain *= 2.0
    motors.lag *= 2.0
    assert np.all(motor_parameters(name).gain < motors.gain)
    assert np.all(motor_parameters(name).lag < motors.lag)


def test_rejects_an_unknown_set():
    with pytest.raises(ValueError, match=r"^motors: must be one of clean, drifting, fitted"):
        motor_parameters("dirty")


@pytest.mark.parametrize(
    ("command", "yaw_rate"),  # As recorded for thesis figure 3-4.
    [
        ([50, 50, 50, 50], 0.084),
        ([50, -50, 50, -50], 0.185),
        ([-50, -50, -50, -50], 0.035),
        ([-50, 50, -50, 50], -0.065),
    ],
)
def test_drifting_motors_turn_the_robot_as_recorded(command, yaw_rate):
    speeds = steady_speed(motor_parameters("drifting"), np.array(command, dtype=float))
    assert body_velocity(speeds)[YAW] == pytest.approx(yaw_rate, abs=0.002)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("gain", np.zeros(4)),
        ("gain", -np.ones((2, 4))),
        ("deadband", np.full((2, 4), np.nan)),
        ("deadband", -np.ones((2, 4))),
        ("lag", np.zeros(4)),
        ("lag", np.ones(3)),
    ],
)
def test_rejects_bad_parameters(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        Motor(DrivetrainParameters(**{field: value}), period=0.01)


def test_rejects_bad_period():
    with pytest.raises(ValueError, match=r"^period: "):
        Motor(DrivetrainParameters(), period=0.0)
