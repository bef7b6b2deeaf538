import dataclasses as dc

import numpy as np
import pytest

from mirte_drake.control.pid import PidGains, PidMemory, pid_step, reference_velocity
from mirte_drake.geometry import PWM_SPEED, WHEEL_RADIUS, body_velocity

GAINS = PidGains(
    proportional=np.array([2.0, 3.0, 4.0]),
    integral=np.array([0.5, 0.6, 0.7]),
    derivative=np.array([0.1, 0.2, 0.3]),
    feedforward=np.array([1.0, 1.5, 2.0]),
)
MEMORY = PidMemory(np.array([0.01, 0.02, -0.03]), np.array([0.02, 0.0, 0.1]))
POSE = np.array([1.0, 2.0, 0.3])
STILL = np.zeros(3)
FRESH = PidMemory()
DIRECTION = np.array([1.0, 2.0, -1.0])


def step(pose=POSE, reference=POSE, velocity=STILL, memory=FRESH, gains=GAINS, limit=100.0):
    return pid_step(gains, memory, pose, reference, velocity, period=0.1, input_limit=limit)


def asked(command) -> np.ndarray:
    """Returns the body velocity that wheel commands ask for."""
    return body_velocity(PWM_SPEED * command)


def test_reference_velocity_is_that_of_the_sample_ahead():
    window = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.2], [0.1, 0.3, 0.6]])
    np.testing.assert_allclose(reference_velocity(window, 0.1, 0), [1.0, 0.0, 2.0])
    np.testing.assert_allclose(reference_velocity(window, 0.1, 1), [0.0, 3.0, 4.0])


def test_at_the_reference_at_rest_the_wheels_stand():
    command, memory = step()
    np.testing.assert_array_equal(command, np.zeros(4))
    np.testing.assert_array_equal(memory.integral, np.zeros(3))


def test_forward_velocity_turns_all_wheels_by_hand():
    command, _ = step(np.zeros(3), np.zeros(3), np.array([0.1, 0.0, 0.0]))
    np.testing.assert_allclose(command, np.full(4, 0.1 / WHEEL_RADIUS / PWM_SPEED))


def test_every_term_by_hand():
    # At a quarter turn, world x is to the right and world y ahead.
    pose = np.array([1.0, 2.0, np.pi / 2])
    reference = np.add(pose, [0.04, 0.03, -0.05])
    error = np.array([0.03, -0.04, -0.05])
    command, memory = step(pose, reference, np.array([0.02, 0.01, 0.1]), MEMORY)
    expected = (
        [1.0 * 0.01, 1.5 * -0.02, 2.0 * 0.1],
        [2.0 * 0.03, 3.0 * -0.04, 4.0 * -0.05],
        [0.5 * 0.01, 0.6 * 0.02, 0.7 * -0.03],
        [0.1 * 0.01 / 0.1, 0.2 * -0.04 / 0.1, 0.3 * -0.15 / 0.1],
    )
    np.testing.assert_allclose(asked(command), np.sum(expected, axis=0), atol=1e-12)
    np.testing.assert_allclose(memory.error, error, atol=1e-12)
    np.testing.assert_allclose(memory.integral, MEMORY.integral + 0.1 * error, atol=1e-12)


@pytest.mark.parametrize("turns", [-2, 1])
def test_whole_turns_of_yaw_do_not_count(turns):
    expected, _ = step(POSE, POSE + 0.1, memory=MEMORY)
    command, _ = step(POSE, POSE + np.array([0.1, 0.1, 0.1 + 2 * np.pi * turns]), memory=MEMORY)
    np.testing.assert_allclose(command, expected, atol=1e-9)


def test_a_fast_command_keeps_its_direction():
    slow, _ = step(POSE, POSE + 0.01 * DIRECTION)
    fast, _ = step(POSE, POSE + DIRECTION, limit=60.0)
    assert np.max(np.abs(fast)) == pytest.approx(60.0)
    np.testing.assert_allclose(fast / np.linalg.norm(fast), slow / np.linalg.norm(slow), atol=1e-12)


def test_integral_does_not_wind_up_but_unwinds():
    far = np.array([5.0, 0.0, 0.0])
    _, memory = step(np.zeros(3), far, memory=MEMORY)
    assert memory.integral[0] == MEMORY.integral[0]
    # What asks for less is summed up, and so is what is not at fault.
    wound = dc.replace(MEMORY, integral=np.array([50.0, 0.0, 0.0]))
    command, memory = step(np.zeros(3), np.array([-0.5, 0.0, 0.01]), memory=wound)
    assert np.max(np.abs(command)) == pytest.approx(100.0)
    assert memory.integral[0] == pytest.approx(50.0 - 0.05)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_pose_that_is_no_number_leaves_the_memory_alone(bad):
    command, memory = step(np.array([0.0, bad, 0.0]), memory=MEMORY)
    assert not np.all(np.isfinite(command))
    assert memory is MEMORY


def test_integral_takes_a_constant_disturbance_away():
    gains, memory, position = dc.replace(GAINS, derivative=np.zeros(3)), FRESH, np.zeros(3)
    disturbance = np.array([0.02, -0.01, 0.03])
    for _ in range(400):
        command, memory = step(position, np.zeros(3), memory=memory, gains=gains)
        position = position + 0.1 * (asked(command) + disturbance)
    np.testing.assert_allclose(position, np.zeros(3), atol=1e-4)
