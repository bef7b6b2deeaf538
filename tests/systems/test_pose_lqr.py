import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from system_ports import feedthrough, port_table

from mirte_drake.control.dlqr import discretise_euler, solve_dlqr
from mirte_drake.model.model_file import load_model
from mirte_drake.model.sparse_model import SparseModel
from mirte_drake.systems.pose_lqr import AddPoseLqr, PoseLqr, PoseLqrConfig

MODEL = load_model("extended_kinematic")
WINDOW = np.array([[0.1, 0.2, 0.3], [0.12, 0.21, 0.3], [0.15, 0.21, 0.31]])
ZERO = np.zeros(3)


def make_dut(model=MODEL, limit=100.0, **config) -> PoseLqr:
    config = PoseLqrConfig(**{"preview": 0, **config})
    return PoseLqr(config, model, period=0.1, horizon=2, input_limit=limit)


def make_model(**derivatives) -> SparseModel:
    names = {"x": {"u1": 0.01}, "y": {"u2": 0.01}, "theta": {"u3": 0.01}} | derivatives
    return SparseModel("by hand", ["x", "y", "theta"], ["u1", "u2", "u3", "u4"], names)


def command(dut, error=ZERO, window=WINDOW, context=None) -> np.ndarray:
    context = context or dut.CreateDefaultContext()
    dut.GetInputPort("pose").FixValue(context, window[0] + error)
    dut.GetInputPort("reference_window").FixValue(context, window.ravel())
    return dut.GetOutputPort("wheel_command").Eval(context)


def test_ports():
    inputs, outputs = port_table(make_dut())
    assert inputs == {"pose": 3, "reference_window": 9}
    assert outputs == {"wheel_command": 4}
    assert feedthrough(make_dut()) == {
        ("pose", "wheel_command"),
        ("reference_window", "wheel_command"),
    }


def test_command_by_hand():
    # Each axis alone: a = 1, b = 0.001, q = 1000, r = 0.001. The Riccati equation is
    # p^2 - 1000 p - 1e6 = 0, so p = 1000 (1 + sqrt 5) / 2 and k = b p / (r + b^2 p).
    k = 1000 * (np.sqrt(5) - 1) / 2
    dut = make_dut(make_model(), state_weight=np.full(3, 1000.0), input_weight=np.full(4, 0.001))
    actual = command(dut, np.array([0.02, -0.01, 0.05]))
    # 0.2 m/s, 0.1 m/s and no turn in the first sample.
    expected = [20 - k * 0.02, 10 + k * 0.01, -k * 0.05, 0.0]
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("preview", "velocity"), [(0, [0.2, 0.1, 0.0]), (1, [0.3, 0.0, 0.1])])
def test_without_error_the_model_drives_as_fast_as_the_reference(preview, velocity):
    u = command(make_dut(preview=preview))
    np.testing.assert_allclose(MODEL.derivative(WINDOW[0], u), velocity, atol=1e-10)


def test_feedback_is_the_dlqr_at_the_reference():
    Q, R = np.diag([1000.0, 2000.0, 3000.0]), np.diag([1e-3, 2e-3, 3e-3, 4e-3])
    dut = make_dut(state_weight=np.diag(Q), input_weight=np.diag(R))
    forward = command(dut)
    _, A, B = MODEL.linearise(WINDOW[0], forward)
    K, _ = solve_dlqr(*discretise_euler(A, B, 0.1), Q, R)
    error = np.array([0.01, 0.02, -0.03])
    np.testing.assert_allclose(command(dut, error), forward - K @ error, rtol=1e-10)


@pytest.mark.parametrize("turns", [-3, 1])
def test_whole_turns_of_yaw_do_not_count(turns):
    dut, error = make_dut(), np.array([0.01, 0.0, 0.02])
    turned = error + np.array([0.0, 0.0, 2 * np.pi * turns])
    np.testing.assert_allclose(command(dut, turned), command(dut, error), atol=1e-9)


def test_feedforward_keeps_to_the_limit():
    dut = make_dut(limit=20.0)
    assert np.max(np.abs(command(dut))) <= 20.0 < np.max(np.abs(command(make_dut())))


def test_where_nothing_can_be_stabilised_the_feedforward_is_left():
    # Yaw rate u3/64 + u3 u3/4096: at u3 = -32 no input moves the yaw to first order.
    model = make_model(theta={"u3": 1 / 64, "u3*u3": 1 / 4096})
    window = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -0.025], [0.0, 0.0, 0.0]])
    dut = make_dut(model, limit=32.0)
    still = command(dut, window=window)
    assert still[2] == pytest.approx(-32.0, abs=1e-3)


def test_a_pose_that_is_no_number_gives_no_number():
    assert not np.all(np.isfinite(command(make_dut(), np.array([np.nan, 0.0, 0.0]))))


def test_contexts_do_not_share_anything():
    dut = make_dut()
    first, second = dut.CreateDefaultContext(), dut.CreateDefaultContext()
    alone = command(dut)
    assert not np.allclose(command(dut, np.full(3, 0.1), context=second), alone)
    np.testing.assert_array_equal(command(dut, context=first), alone)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("state_weight", np.array([1.0, 0.0, 1.0])),
        ("state_weight", np.ones(4)),
        ("input_weight", np.full(4, -1.0)),
        ("input_weight", np.ones(3)),
        ("preview", -1),
        ("preview", 2),
    ],
)
def test_rejects_bad_config(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        make_dut(**{field: value})


def test_rejects_a_model_with_body_velocity():
    with pytest.raises(ValueError, match=r"^dynamic: its state must be the pose$"):
        make_dut(load_model("dynamic"))


def test_add_names_and_returns_the_system():
    builder = DiagramBuilder()
    dut = AddPoseLqr(builder, PoseLqrConfig(), MODEL, period=0.1, horizon=10, name="feedback")
    assert isinstance(dut, PoseLqr)
    assert builder.Build().GetSubsystemByName("feedback") is dut
