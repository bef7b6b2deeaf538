import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pydrake.systems.framework import DiagramBuilder
from system_ports import feedthrough, port_table

from mirte_drake.systems.wheel_command_limiter import (
    AddWheelCommandLimiter,
    WheelCommandLimiter,
    WheelCommandLimiterConfig,
    limit_wheel_command,
    with_play,
)

ANY_COMMAND = st.lists(st.floats(), min_size=4, max_size=4).map(np.array)
ANY_CONFIG = {
    "limit": st.floats(0.0, 200.0),
    "deadband": st.floats(0.0, 50.0),
    "round_to_integer": st.booleans(),
}


def limited(command, last=(0.0, 0.0, 0.0, 0.0), *, input_limit=100.0, **config) -> list[float]:
    dut = WheelCommandLimiter(WheelCommandLimiterConfig(**config), input_limit=input_limit)
    context = dut.CreateDefaultContext()
    dut.GetInputPort("wheel_command").FixValue(context, np.array(command))
    dut.GetInputPort("last_command").FixValue(context, np.array(last))
    return dut.GetOutputPort("limited_command").Eval(context).tolist()


def test_ports_and_feedthrough():
    dut = WheelCommandLimiter(WheelCommandLimiterConfig())
    inputs = {"wheel_command": 4, "last_command": 4}
    assert port_table(dut) == (inputs, {"limited_command": 4})
    assert feedthrough(dut) == {(name, "limited_command") for name in inputs}


def test_saturates_each_wheel():
    assert limited([120.0, -250.0, 99.5, -0.25]) == [100.0, -100.0, 99.5, -0.25]


def test_saturates_at_the_given_limit():
    assert limited([50.0, -50.0, 40.0, 39.0], input_limit=40.0) == [40.0, -40.0, 40.0, 39.0]


def test_command_below_the_deadband_becomes_zero():
    assert limited([9.99, -9.99, 10.0, -10.0], deadband=10.0) == [0.0, 0.0, 10.0, -10.0]


def test_rounds_to_the_nearest_integer():
    assert limited([12.4, -12.6, 99.9, 0.2], round_to_integer=True) == [12.0, -13.0, 100.0, 0.0]


def test_command_that_is_not_finite_stops_its_wheel_alone():
    assert limited([np.nan, np.inf, -np.inf, 30.0]) == [0.0, 0.0, 0.0, 30.0]


def test_a_command_moves_no_farther_than_to_within_the_play():
    asked, last = [11.0, 14.0, 7.5, -1.0], [10.0, 10.0, 10.0, 10.0]
    assert limited(asked, last, play=2.0) == [10.0, 12.0, 9.5, 1.0]
    assert limited(asked, last, play=2.0, round_to_integer=True) == [10.0, 12.0, 10.0, 1.0]
    assert limited(asked, last) == asked


def test_play_keeps_no_wheel_from_stopping():
    assert limited([0.0, 0.5, np.nan, np.inf], [1.0] * 4, play=1.0) == [0.0, 1.0, 0.0, 0.0]
    assert limited([8.5, -9.0, 10.5, 0.0], [12.0] * 4, play=2.0, deadband=10.0) == [0, 0, 12, 0]


def test_where_the_last_command_is_not_known_there_is_no_play():
    dut = WheelCommandLimiter(WheelCommandLimiterConfig(play=5.0))
    context = dut.CreateDefaultContext()
    dut.GetInputPort("wheel_command").FixValue(context, [1.0, 2.0, 3.0, 4.0])
    assert dut.GetOutputPort("limited_command").Eval(context).tolist() == [1.0, 2.0, 3.0, 4.0]


def test_noise_within_the_play_turns_no_command_around():
    noise = np.random.default_rng(0).uniform(-1, 1, (200, 4))
    command, commands = np.zeros(4), []
    for k, n in enumerate(noise):
        command = with_play(0.1 * k + 20.0 + n, command, play=1.0, deadband=0.0)
        commands.append(command)
    assert np.all(np.diff(commands, axis=0) >= 0)  # As what is asked for without the noise.


def test_the_error_is_that_of_play_and_rounding():
    config = WheelCommandLimiterConfig(play=1.5, round_to_integer=True)
    assert config.command_error == 2.0
    assert WheelCommandLimiterConfig().command_error == 0.0


LAST = st.lists(st.integers(-100, 100).map(float), min_size=4, max_size=4)
ASKED = st.lists(st.floats(-99, 99), min_size=4, max_size=4)


@given(asked=ASKED, last=LAST, play=st.floats(0, 5), round_to_integer=st.booleans())
def test_play_and_rounding_miss_by_the_error_at_most_and_settle(asked, last, **config):
    error = WheelCommandLimiterConfig(**config).command_error
    once = limited(asked, last, **config)
    assert np.all(np.abs(np.subtract(once, asked)) <= error + 1e-9)
    assert limited(asked, once, **config) == pytest.approx(once, abs=1e-12)


@given(command=ANY_COMMAND, **ANY_CONFIG)
@example(command=np.full(4, 2.0), limit=1.5, deadband=0.0, round_to_integer=True)
def test_any_command_becomes_finite_and_within_the_limit(command, **config):
    result = limit_wheel_command(command, **config)
    assert np.all(np.isfinite(result))
    assert np.all(np.abs(result) <= config["limit"])


@given(command=ANY_COMMAND, **ANY_CONFIG)
def test_limiting_twice_changes_nothing_when_nothing_is_rounded(command, **config):
    config["round_to_integer"] = False
    once = limit_wheel_command(command, **config)
    np.testing.assert_array_equal(limit_wheel_command(once, **config), once)


@given(command=ANY_COMMAND, **ANY_CONFIG)
def test_both_directions_are_limited_alike(command, **config):
    np.testing.assert_array_equal(
        limit_wheel_command(-command, **config), -limit_wheel_command(command, **config)
    )


def test_contexts_do_not_share_commands():
    dut = WheelCommandLimiter(WheelCommandLimiterConfig())
    port, output = dut.GetInputPort("wheel_command"), dut.GetOutputPort("limited_command")
    first, second = dut.CreateDefaultContext(), dut.CreateDefaultContext()
    for context in (first, second):
        dut.GetInputPort("last_command").FixValue(context, np.zeros(4))
    port.FixValue(first, np.full(4, 20.0))
    port.FixValue(second, np.full(4, -30.0))
    assert output.Eval(first).tolist() == [20.0] * 4
    assert output.Eval(second).tolist() == [-30.0] * 4


@pytest.mark.parametrize(
    ("field", "value"),
    [*((field, v) for field in ("deadband", "play") for v in (-1.0, np.nan, np.inf)), ("play", 21)],
)
def test_rejects_bad_config(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        WheelCommandLimiter(WheelCommandLimiterConfig(**{field: value}))


@pytest.mark.parametrize("input_limit", [-1.0, np.nan])
def test_rejects_bad_input_limit(input_limit):
    with pytest.raises(ValueError, match=r"^input_limit: "):
        WheelCommandLimiter(WheelCommandLimiterConfig(), input_limit=input_limit)


def test_add_names_and_returns_the_system():
    builder = DiagramBuilder()
    dut = AddWheelCommandLimiter(builder, WheelCommandLimiterConfig(), name="guard")
    assert isinstance(dut, WheelCommandLimiter)
    assert builder.Build().GetSubsystemByName("guard") is dut
