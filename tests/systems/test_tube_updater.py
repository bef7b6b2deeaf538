import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from system_ports import feedthrough, port_table

from mirte_drake.control.dlqr import DlqrDesign
from mirte_drake.systems.tube_updater import AddTubeUpdater, TubeUpdater, TubeUpdaterConfig

DESIGN = DlqrDesign(
    yaw=np.pi / 2,
    gain=np.array([[10.0, 0.0, -20.0], [0.0, -30.0, 0.0], [1.0, 1.0, 1.0], [0.0, 0.0, 0.0]]),
    closed_loop=np.array([[0.5, -0.1, 0.0], [0.0, 0.4, 0.0], [0.0, 0.2, -0.3]]),
)
LATER = DlqrDesign(yaw=0.0, gain=2.0 * DESIGN.gain, closed_loop=np.diag([0.1, 0.2, 0.3]))
D0 = np.array([0.1, 0.2, 0.3])
# |A - B K| d_0 + 0.1 w_max with the default w_max = (0.04, 0.03, 0.09).
D1 = np.array([0.05 + 0.02 + 0.004, 0.08 + 0.003, 0.04 + 0.09 + 0.009])
ROOM = np.array([1.0 + 6.0, 6.0, 0.6, 0.0])  # |K| d_0.


def make_dut(*, horizon=2, input_limit=100.0, **config) -> TubeUpdater:
    config = TubeUpdaterConfig(**config)
    return TubeUpdater(config, period=0.1, horizon=horizon, input_limit=input_limit)


def simulate(dut, designs=(DESIGN,)) -> Simulator:
    simulator = Simulator(dut)
    dut.GetInputPort("designs").FixValue(simulator.get_mutable_context(), designs)
    return simulator


def read(simulator, port) -> np.ndarray:
    return simulator.get_system().GetOutputPort(port).Eval(simulator.get_context())


def after_one_update(port, *, designs=(DESIGN,), **config) -> np.ndarray:
    simulator = simulate(make_dut(**config), designs)
    simulator.AdvanceTo(0.05)  # Past the update at 0, before the one at 0.1.
    return read(simulator, port)


def test_ports():
    inputs, outputs = port_table(make_dut(horizon=10))
    assert inputs == {"designs": "abstract"}
    assert outputs == {"half_width": 3, "input_lower": 40, "input_upper": 40}


def test_no_output_has_feedthrough():
    assert feedthrough(make_dut()) == set()


def test_first_sample_has_the_initial_width_and_bounds():
    simulator = simulate(make_dut(initial_half_width=D0))
    np.testing.assert_array_equal(read(simulator, "half_width"), D0)
    np.testing.assert_array_equal(read(simulator, "input_lower"), np.full(8, -90.0))
    np.testing.assert_array_equal(read(simulator, "input_upper"), np.full(8, 90.0))


def test_initial_bounds_stay_within_the_input_limit():
    simulator = simulate(make_dut(input_limit=50.0))
    np.testing.assert_array_equal(read(simulator, "input_upper"), np.full(8, 50.0))


def test_one_update_matches_the_recursion():
    np.testing.assert_allclose(after_one_update("half_width", initial_half_width=D0), D1)


def test_two_updates_match_the_recursion():
    simulator = simulate(make_dut(initial_half_width=D0))
    simulator.AdvanceTo(0.15)
    expected = np.abs(DESIGN.closed_loop) @ D1 + [0.004, 0.003, 0.009]
    np.testing.assert_allclose(read(simulator, "half_width"), expected, rtol=1e-15)


def test_converges_to_the_fixed_point_from_below():
    simulator = simulate(make_dut())
    widths = []
    for k in range(100):
        simulator.AdvanceTo(0.1 * k + 0.05)
        widths.append(read(simulator, "half_width"))
    w = np.array([0.004, 0.003, 0.009])
    fixed_point = np.linalg.solve(np.eye(3) - np.abs(DESIGN.closed_loop), w)
    np.testing.assert_allclose(widths[-1], fixed_point, rtol=1e-12)
    assert np.all(np.diff(widths, axis=0) >= -1e-15)


def test_current_half_width_tightens_the_next_bounds():
    upper = after_one_update("input_upper", initial_half_width=D0)
    np.testing.assert_allclose(upper, np.tile(100.0 - ROOM, 2), rtol=1e-15)
    lower = after_one_update("input_lower", initial_half_width=D0)
    np.testing.assert_allclose(lower, np.tile(-100.0 + ROOM, 2), rtol=1e-15)


def test_next_half_width_tightens_the_next_bounds():
    upper = after_one_update(
        "input_upper", initial_half_width=D0, tightening_half_width="next"
    ).reshape(2, 4)
    room = [0.74 + 2.78, 30 * 0.083, 0.074 + 0.083 + 0.139, 0.0]  # |K| d_1.
    np.testing.assert_allclose(upper, np.tile(100.0 - np.array(room), (2, 1)), rtol=1e-15)


def test_bounds_follow_the_input_limit():
    upper = after_one_update("input_upper", initial_half_width=D0, input_limit=50.0)
    np.testing.assert_allclose(upper[:4], 50.0 - ROOM)


def test_bounds_meet_when_the_tube_takes_more_than_there_is():
    wide = np.array([0.0, 10.0, 0.0])  # Takes 300 pwm of wheel 2.
    assert after_one_update("input_upper", initial_half_width=wide)[1] == 0.0
    assert after_one_update("input_lower", initial_half_width=wide)[1] == 0.0


def test_rotated_disturbance_bounds_the_turned_box():
    # At a yaw of a quarter turn, body x is world y.
    d = after_one_update("half_width", disturbance_frame="rotated")
    np.testing.assert_allclose(d, [0.003, 0.004, 0.009], atol=1e-15)


def test_rotated_disturbance_is_the_published_one_at_yaw_zero():
    rotated = after_one_update("half_width", designs=(LATER,), disturbance_frame="rotated")
    published = after_one_update("half_width", designs=(LATER,), disturbance_frame="published")
    np.testing.assert_array_equal(rotated, published)


def test_stagewise_bounds_follow_the_tube_along_the_plan():
    stagewise = {"initial_half_width": D0, "tightening_over_horizon": "stagewise"}
    designs = (DESIGN, LATER)
    upper = after_one_update("input_upper", designs=designs, **stagewise).reshape(2, 4)
    np.testing.assert_allclose(upper[0], 100.0 - ROOM)
    np.testing.assert_allclose(upper[1], 100.0 - np.abs(LATER.gain) @ D1)
    # The width itself moves by one sample only.
    np.testing.assert_allclose(after_one_update("half_width", designs=designs, **stagewise), D1)


def test_stagewise_bounds_of_the_next_half_width():
    upper = after_one_update(
        "input_upper",
        designs=(DESIGN, LATER),
        initial_half_width=D0,
        tightening_over_horizon="stagewise",
        tightening_half_width="next",
    ).reshape(2, 4)
    d2 = np.array([0.1, 0.2, 0.3]) * D1 + [0.004, 0.003, 0.009]
    np.testing.assert_allclose(upper[0], 100.0 - np.abs(DESIGN.gain) @ D1)
    np.testing.assert_allclose(upper[1], 100.0 - np.abs(LATER.gain) @ d2)


def test_disturbance_bound_can_be_changed_in_a_context():
    dut = make_dut()
    changed, other = simulate(dut), simulate(dut)
    changed.get_mutable_context().get_mutable_numeric_parameter(0).SetFromVector([0.5, 0.6, 0.7])
    changed.AdvanceTo(0.05)
    other.AdvanceTo(0.05)
    np.testing.assert_allclose(read(changed, "half_width"), [0.05, 0.06, 0.07])
    np.testing.assert_allclose(read(other, "half_width"), [0.004, 0.003, 0.009])


def test_interleaved_simulators_do_not_disturb_each_other():
    dut = make_dut(initial_half_width=D0)
    first, second = simulate(dut, (DESIGN,)), simulate(dut, (LATER,))
    alone = [
        simulate(make_dut(initial_half_width=D0), designs) for designs in [(DESIGN,), (LATER,)]
    ]
    for k in range(5):
        for simulator in (first, second, *alone):
            simulator.AdvanceTo(0.1 * k + 0.05)
    for port in ("half_width", "input_lower", "input_upper"):
        np.testing.assert_array_equal(read(first, port), read(alone[0], port))
        np.testing.assert_array_equal(read(second, port), read(alone[1], port))
    assert not np.array_equal(read(first, "half_width"), read(second, "half_width"))
    fresh = dut.CreateDefaultContext()
    np.testing.assert_array_equal(dut.GetOutputPort("half_width").Eval(fresh), D0)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("disturbance_bound", np.array([0.1, -0.1, 0.1])),
        ("disturbance_bound", np.array([0.1, np.nan, 0.1])),
        ("disturbance_bound", np.ones(2)),
        ("initial_half_width", -np.ones(3)),
        ("initial_half_width", np.ones((3, 1))),
        ("initial_input_limit", -1.0),
        ("initial_input_limit", np.nan),
        ("disturbance_frame", "body"),
        ("tightening_half_width", "last"),
        ("tightening_over_horizon", "sometimes"),
    ],
)
def test_rejects_bad_config(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        make_dut(**{field: value})


def test_add_names_and_returns_the_system():
    builder = DiagramBuilder()
    dut = AddTubeUpdater(builder, TubeUpdaterConfig(), period=0.1, horizon=10, name="tube")
    assert isinstance(dut, TubeUpdater)
    assert builder.Build().GetSubsystemByName("tube") is dut
