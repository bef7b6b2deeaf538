import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from system_ports import port_table

from mirte_drake.control.reference_paths import (
    CirclePath,
    RectanglePath,
    VelocityCirclePath,
    VelocityLegsPath,
)
from mirte_drake.systems.reference_source import AddReferenceSource, ReferenceSource


def make_dut(config=None, *, period=0.1, horizon=2) -> ReferenceSource:
    return ReferenceSource(config or RectanglePath(), period=period, horizon=horizon)


def reference_at(dut, time):
    context = dut.CreateDefaultContext()
    context.SetTime(time)
    return dut.GetOutputPort("reference").Eval(context)


def window_at(dut, time):
    context = dut.CreateDefaultContext()
    context.SetTime(time)
    return dut.GetOutputPort("reference_window").Eval(context).reshape(-1, 3)


def test_ports():
    assert port_table(make_dut(horizon=10)) == ({}, {"reference": 3, "reference_window": 33})


def test_window_at_the_start():
    step = 0.6 * 0.1 / 5.85  # A side of 0.6 m in 6.25 s, of which 0.4 s are rest.
    expected = [[-0.3, -0.2, 0], [-0.3 + step, -0.2, 0], [-0.3 + 2 * step, -0.2, 0]]
    np.testing.assert_allclose(window_at(make_dut(), 0.0), expected, atol=1e-15)


def test_window_on_the_second_side():
    step = 0.4 * 0.1 / 5.85  # The second side leads 0.4 m up and starts at 6.25 s.
    y = -0.2 + step * np.array([0.5, 1.5, 2.5])
    expected = np.column_stack([np.full(3, 0.3), y, np.zeros(3)])
    np.testing.assert_allclose(window_at(make_dut(), 6.3), expected, atol=1e-15)


def test_window_over_the_end_repeats_the_last_pose():
    dut = make_dut(CirclePath(radius=0.6, duration=30.0, heading="tangent"))
    expected = dut.poses[[299, 300, 300]]
    np.testing.assert_array_equal(window_at(dut, 29.9), expected)


def test_path_stands_still_past_its_end():
    dut = make_dut()
    np.testing.assert_allclose(window_at(dut, 1000.0), np.tile([-0.3, -0.2, 0.0], (3, 1)))
    np.testing.assert_allclose(reference_at(dut, 1000.0), [-0.3, -0.2, 0.0])


def test_reference_is_the_first_row_of_the_window():
    dut = make_dut(VelocityLegsPath())
    for time in (0.0, 3.3, 7.04, 21.2, 30.0):
        np.testing.assert_array_equal(reference_at(dut, time), window_at(dut, time)[0])


@pytest.mark.parametrize("period", [0.1, 0.07, 1 / 3])
def test_every_sample_time_gives_its_own_pose(period):
    dut = make_dut(CirclePath(duration=1000 * period, heading="tangent"), period=period)
    assert len(dut.poses) == 1001
    accumulated = 0.0
    for k in range(1001):
        for time in (k * period, np.nextafter(k * period, 0.0), accumulated):
            np.testing.assert_array_equal(reference_at(dut, time), dut.poses[k])
        accumulated += period


def test_pose_is_held_between_samples():
    dut = make_dut()
    for time in (0.51, 0.55, 0.599):
        np.testing.assert_array_equal(reference_at(dut, time), dut.poses[5])


def test_yaw_is_unwrapped():
    dut = make_dut(CirclePath(heading="tangent"))
    assert reference_at(dut, 30.0)[2] == pytest.approx(2.5 * np.pi)
    assert np.all(np.diff(dut.poses[:, 2]) > 0)


def test_poses_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        make_dut().poses[0, 0] = 1.0


def test_contexts_do_not_share_time():
    dut = make_dut()
    first, second = dut.CreateDefaultContext(), dut.CreateDefaultContext()
    first.SetTime(5.0)
    np.testing.assert_array_equal(dut.GetOutputPort("reference").Eval(first), dut.poses[50])
    np.testing.assert_array_equal(dut.GetOutputPort("reference").Eval(second), dut.poses[0])


@pytest.mark.parametrize(
    ("path", "field"),
    [
        (CirclePath(radius=-1.0), "radius"),
        (CirclePath(duration=np.nan), "duration"),
        (CirclePath(heading="sideways"), "heading"),
        (RectanglePath(half_width=0.0), "half_width"),
        (RectanglePath(rest=7.0), "rest"),
        (VelocityLegsPath(legs=[]), "legs"),
        (VelocityLegsPath(start=np.zeros(2)), "start"),
        (VelocityCirclePath(acceleration_limit=0.0), "acceleration_limit"),
    ],
)
def test_rejects_bad_path(path, field):
    with pytest.raises(ValueError, match=f"^{field}: "):
        make_dut(path)


def test_add_names_and_returns_the_system():
    builder = DiagramBuilder()
    dut = AddReferenceSource(builder, CirclePath(), period=0.1, horizon=4, name="circle")
    assert isinstance(dut, ReferenceSource)
    assert builder.Build().GetSubsystemByName("circle") is dut
