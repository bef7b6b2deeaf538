import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from system_ports import feedthrough, port_table

from mirte_drake.control.pid import PidGains, PidMemory, pid_step
from mirte_drake.systems.pose_pid import AddPosePid, PosePid, PosePidConfig

GAINS = {
    "proportional": np.array([2.0, 3.0, 4.0]),
    "integral": np.array([0.5, 0.6, 0.7]),
    "derivative": np.array([0.1, 0.2, 0.3]),
    "feedforward": np.array([1.0, 1.5, 2.0]),
}
POSE = np.array([0.1, 0.2, 0.3])
WINDOW = POSE + np.array([[0.01, 0.02, 0.03], [0.03, 0.03, 0.03], [0.06, 0.03, 0.04]])


def make_dut(**config) -> PosePid:
    return PosePid(PosePidConfig(**{**GAINS, "preview": 0, **config}), period=0.1, horizon=2)


def fixed(dut, context, pose=POSE, window=WINDOW):
    dut.GetInputPort("pose").FixValue(context, np.asarray(pose, dtype=float))
    dut.GetInputPort("reference_window").FixValue(context, window.ravel())
    return context


def command(dut, context) -> np.ndarray:
    return dut.GetOutputPort("wheel_command").Eval(context)


FRESH = PidMemory()


def expected(memory=FRESH, velocity=(0.2, 0.1, 0.0)):
    return pid_step(
        PidGains(**GAINS),
        memory,
        POSE,
        WINDOW[0],
        np.array(velocity),
        period=0.1,
        input_limit=100.0,
    )


def test_ports():
    inputs, outputs = port_table(make_dut())
    assert inputs == {"pose": 3, "reference_window": 9}
    assert outputs == {"wheel_command": 4}


def test_command_is_that_of_the_pose_of_its_own_instant():
    assert feedthrough(make_dut()) == {
        ("pose", "wheel_command"),
        ("reference_window", "wheel_command"),
    }


def test_first_command_and_those_that_follow():
    dut = make_dut()
    simulator = Simulator(dut)
    context = fixed(dut, simulator.get_mutable_context())
    first, memory = expected()
    np.testing.assert_allclose(command(dut, context), first, atol=1e-12)
    for k in range(1, 4):
        simulator.AdvanceTo(0.1 * k - 0.05)
        nxt, memory = expected(memory)
        np.testing.assert_allclose(command(dut, context), nxt, atol=1e-12)


def test_preview_takes_a_later_velocity():
    dut = make_dut(preview=1)
    context = fixed(dut, dut.CreateDefaultContext())
    np.testing.assert_allclose(
        command(dut, context), expected(velocity=(0.3, 0.0, 0.1))[0], atol=1e-12
    )


def test_contexts_do_not_share_memory():
    dut = make_dut()
    simulator = Simulator(dut)
    fixed(dut, simulator.get_mutable_context())
    simulator.AdvanceTo(1.0)
    fresh = fixed(dut, dut.CreateDefaultContext())
    np.testing.assert_allclose(command(dut, fresh), expected()[0], atol=1e-12)
    assert not np.allclose(command(dut, simulator.get_context()), expected()[0])


def test_a_pose_that_is_no_number_is_forgotten():
    dut = make_dut()
    simulator = Simulator(dut)
    context = fixed(dut, simulator.get_mutable_context(), pose=[np.nan, 0.0, 0.0])
    simulator.AdvanceTo(1.0)
    assert not np.all(np.isfinite(command(dut, context)))
    fixed(dut, context)
    np.testing.assert_allclose(command(dut, context), expected()[0], atol=1e-12)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("proportional", -np.ones(3)),
        ("integral", np.ones(2)),
        ("derivative", np.array([0.0, np.nan, 0.0])),
        ("feedforward", np.full(3, np.inf)),
        ("preview", -1),
        ("preview", 2),
    ],
)
def test_rejects_bad_config(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        make_dut(**{field: value})


def test_add_names_and_returns_the_system():
    builder = DiagramBuilder()
    dut = AddPosePid(builder, PosePidConfig(), period=0.1, horizon=10, name="loops")
    assert isinstance(dut, PosePid)
    assert builder.Build().GetSubsystemByName("loops") is dut
