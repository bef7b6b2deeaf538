import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput
from system_ports import port_table

from mirte_drake.control.excitation import ExcitationConfig, excitation
from mirte_drake.systems.excitation_source import AddExcitationSource, ExcitationSource


def command_at(dut, time) -> np.ndarray:
    context = dut.CreateDefaultContext()
    context.SetTime(time)
    return dut.GetOutputPort("wheel_command").Eval(context)


def test_ports():
    assert port_table(ExcitationSource(ExcitationConfig())) == ({}, {"wheel_command": 4})


@pytest.mark.parametrize("period", [0.1, 0.07])
def test_port_equals_the_function(period):
    config = ExcitationConfig(duration=12.0, random_duration=6.0)
    dut = ExcitationSource(config, seed=4)
    for k, command in enumerate(excitation(config, 4, period)):
        np.testing.assert_array_equal(command_at(dut, k * period), command)


def test_simulation_plays_the_sequence():
    config = ExcitationConfig(duration=12.0, random_duration=6.0)
    builder = DiagramBuilder()
    dut = AddExcitationSource(builder, config, seed=2)
    sink = LogVectorOutput(dut.GetOutputPort("wheel_command"), builder, 0.1)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(11.95)
    log = sink.FindLog(simulator.get_context()).data().T
    np.testing.assert_array_equal(log, excitation(config, 2, 0.1))


def test_commands_change_at_their_time_despite_round_off():
    dut, accumulated = ExcitationSource(ExcitationConfig()), 0.0
    for command in dut.commands:
        for time in (accumulated, np.nextafter(accumulated, -1.0), accumulated + 0.29):
            if time >= 0:
                np.testing.assert_array_equal(command_at(dut, time), command)
        accumulated += 0.3


def test_wheels_stand_still_past_the_end():
    dut = ExcitationSource(ExcitationConfig())
    for time in (119.99, 120.0, 1e4):
        np.testing.assert_array_equal(command_at(dut, time), np.zeros(4))


def test_contexts_do_not_share_time():
    dut = ExcitationSource(ExcitationConfig())
    first, second = dut.CreateDefaultContext(), dut.CreateDefaultContext()
    first.SetTime(30.0)
    port = dut.GetOutputPort("wheel_command")
    np.testing.assert_array_equal(port.Eval(first), dut.commands[100])
    np.testing.assert_array_equal(port.Eval(second), dut.commands[0])


def test_commands_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        ExcitationSource(ExcitationConfig()).commands[0, 0] = 1.0


def test_rejects_bad_config():
    with pytest.raises(ValueError, match=r"^max_change: "):
        ExcitationSource(ExcitationConfig(max_change=-1.0))


@pytest.mark.parametrize("seed", [-1, np.nan])
def test_rejects_bad_seed(seed):
    with pytest.raises(ValueError, match=r"^seed: "):
        ExcitationSource(ExcitationConfig(), seed=seed)


def test_add_names_and_returns_the_system():
    builder = DiagramBuilder()
    dut = AddExcitationSource(builder, ExcitationConfig(), seed=1, name="drive")
    assert isinstance(dut, ExcitationSource)
    assert builder.Build().GetSubsystemByName("drive") is dut
