import dataclasses as dc
from pathlib import Path

import numpy as np
import pytest
from recordings import changed, moving_run

from mirte_drake.errors import UserError
from mirte_drake.identification.recorded_run import (
    RecordedRun,
    check_excitation,
    load_recorded_run,
    repaired,
)

DATA = Path(__file__).parents[3] / "shared" / "data"


def repair(run: RecordedRun) -> RecordedRun:
    return repaired(run, lambda row: f"row {row + 2}", "run.csv")


def repair_error(run: RecordedRun) -> str:
    with pytest.raises(UserError) as caught:
        repair(run)
    message = str(caught.value)
    assert message.startswith("run.csv: ") and "\n" not in message
    return message


def test_a_good_run_passes_unchanged():
    run = moving_run()
    assert repair(run) == run
    assert repair(run).repairs == ()
    assert repair(run).period == pytest.approx(0.1, abs=1e-15)


def test_runs_are_equal_when_their_samples_are():
    run = moving_run()
    assert run == dc.replace(run, source="elsewhere", sha256="1", repairs=("one",))
    assert run != changed(run, "pose", (3, 1), 9.0)
    assert run != moving_run(60)
    assert run != "a run"


# Numbers.


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300])
@pytest.mark.parametrize(
    ("name", "index", "said"),
    [
        ("time", 5, "row 7: time is"),
        ("pose", (5, 0), "row 7: x is"),
        ("pose", (5, 2), "row 7: yaw is"),
        ("body_velocity", (5, 1), "row 7: vy is"),
        ("wheel_command", (5, 2), "row 7: rear_right is"),
    ],
)
def test_values_must_be_finite(name, index, said, value):
    message = repair_error(changed(moving_run(), name, index, value))
    assert said in message and "finite" in message


@pytest.mark.parametrize("rows", [0, 1, 2, 19])
def test_too_few_rows(rows):
    run = moving_run(30)
    short = [a[:rows] for a in (run.time, run.pose, run.body_velocity, run.wheel_command)]
    assert f"has {rows} rows: at least 20" in repair_error(RecordedRun(*short))


def test_twenty_rows_are_enough():
    assert len(repair(moving_run(20)).time) == 20


def test_commands_beyond_100_percent():
    message = repair_error(changed(moving_run(), "wheel_command", (4, 3), -101.0))
    assert "row 6: rear_left is -101: PWM percent is in +-100" in message


def test_commands_as_fractions():
    run = moving_run()
    message = repair_error(dc.replace(run, wheel_command=run.wheel_command / 100))
    assert "PWM percent" in message and "multiply them by 100" in message


def test_commands_of_zero_are_no_fractions():
    run = moving_run()
    still = dc.replace(run, wheel_command=0 * run.wheel_command)
    assert repair(still) == still


# Time.


def test_time_that_goes_back():
    run = moving_run()
    message = repair_error(changed(run, "time", 50, run.time[48]))
    assert "row 52: time goes back by 0.1 s" in message and "sort the rows" in message


def test_equal_fine_stamps():
    run = moving_run(period=0.1037)
    message = repair_error(changed(run, "time", 50, run.time[49]))
    assert "row 52: has the time of the row before: delete one" in message


def test_time_that_stands_still():
    run = moving_run()
    assert "mean sample time is 0 s" in repair_error(dc.replace(run, time=0 * run.time))


@pytest.mark.parametrize("factor", [1e3, 1e6, 1e-3])
def test_time_in_another_unit(factor):
    run = moving_run()
    message = repair_error(dc.replace(run, time=factor * run.time))
    assert "mean sample time" in message and "in seconds" in message


@pytest.mark.parametrize(("digits", "resolution"), [(0, "1 s"), (1, "0.1 s")])
def test_coarse_stamps_are_rebuilt(digits, resolution):
    run = moving_run(121, period=0.06)
    coarse = dc.replace(run, time=np.floor(run.time * 10**digits + 1e-9) / 10**digits)
    rebuilt = repair(coarse)
    last = coarse.time[-1]
    np.testing.assert_array_equal(rebuilt.time, np.linspace(0.0, last, 121))
    assert rebuilt.repairs == (
        f"time: stamps have a resolution of {resolution}; rebuilt as 121 evenly spaced samples "
        f"over {last:.1f} s",
    )
    np.testing.assert_array_equal(rebuilt.pose, run.pose)


def test_jitter_is_stated_and_kept():
    run = moving_run()
    late = changed(run, "time", 60, run.time[60] + 0.03)
    kept = repair(late)
    np.testing.assert_array_equal(kept.time, late.time)
    assert kept.repairs == (
        "time: 2 of 119 intervals outside 98-102 ms (shortest 70, longest 130 ms); kept, "
        "but derivatives take the samples as evenly spaced",
    )


def test_a_gap():
    run = moving_run()
    message = repair_error(dc.replace(run, time=run.time + 0.25 * (np.arange(120) >= 60)))
    assert "row 62: comes 0.35 s after the row before" in message
    assert "cut the recording there" in message


def test_a_gap_between_coarse_stamps():
    run = moving_run()
    time = np.floor(run.time + 3.0 * (np.arange(120) >= 60) + 1e-9)
    assert "row 62: comes 4 s after the row before" in repair_error(dc.replace(run, time=time))


# Motion.


def test_wrapped_yaw_is_unwrapped():
    run = moving_run()
    wrapped = changed(run, "pose", (slice(None), 2), (run.pose[:, 2] + np.pi) % (2 * np.pi) - np.pi)
    unwrapped = repair(wrapped)
    jumps = int(np.sum(np.abs(np.diff(wrapped.pose[:, 2])) > np.pi))
    assert jumps > 1
    assert unwrapped.repairs == (f"yaw: {jumps} jumps of a turn unwrapped",)
    np.testing.assert_allclose(unwrapped.pose, run.pose, rtol=0, atol=1e-12)


@pytest.mark.parametrize("wrap", [False, True])
def test_yaw_in_degrees(wrap):
    run = moving_run()
    degrees = np.degrees(run.pose[:, 2])
    degrees = (degrees + 180) % 360 - 180 if wrap else degrees
    message = repair_error(changed(run, "pose", (slice(None), 2), degrees))
    assert "yaw changes by" in message and "degrees for radians" in message


def test_yaw_rate_in_degrees():
    run = moving_run()
    degrees = np.degrees(run.body_velocity[:, 2])
    message = repair_error(changed(run, "body_velocity", (slice(None), 2), degrees))
    assert "yaw changes by" in message and "degrees for radians" in message


def test_yaw_and_yaw_rate_in_degrees():
    run = moving_run()
    run = changed(run, "pose", (slice(None), 2), np.degrees(run.pose[:, 2]))
    run = changed(run, "body_velocity", (slice(None), 2), np.degrees(run.body_velocity[:, 2]))
    message = repair_error(run)
    assert "yaw rate is" in message and "give it in rad/s" in message


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "mm for m"), (1e2, "cm for m")])
def test_lengths_in_another_unit(factor, unit):
    run, positions = moving_run(), (slice(None), slice(0, 2))
    for name, array in (("pose", run.pose), ("body_velocity", run.body_velocity)):
        message = repair_error(changed(run, name, positions, factor * array[positions]))
        assert "x, y changes by" in message and unit in message
    both = changed(run, "pose", positions, factor * run.pose[positions])
    both = changed(both, "body_velocity", positions, factor * run.body_velocity[positions])
    assert "give it in m/s" in repair_error(both)


@pytest.mark.parametrize("name", ["pose", "body_velocity"])
def test_a_pose_or_velocity_that_was_not_recorded(name):
    run = moving_run()
    assert "both must be recorded" in repair_error(changed(run, name, slice(None), 0.0))


def test_velocity_in_the_world_frame():
    run = moving_run()
    world = np.diff(run.pose, axis=0, prepend=run.pose[:1]) / run.period
    assert "body frame" in repair_error(dc.replace(run, body_velocity=world))


def test_yaw_counted_clockwise():
    run = moving_run()
    clockwise = changed(run, "pose", (slice(None), 2), -run.pose[:, 2])
    assert "another direction" in repair_error(clockwise)


@pytest.mark.parametrize(("entry", "said"), [(0, "x, y jumps by"), (2, "yaw jumps by")])
def test_a_reset_of_the_odometry(entry, said):
    run = moving_run()
    pose = run.pose.copy()
    pose[70:, entry] += 1.0
    message = repair_error(dc.replace(run, pose=pose))
    assert f"row 72: {said}" in message and "cut the recording there" in message


def test_standstill_is_stated():
    run = moving_run()
    still = dc.replace(
        run,
        pose=np.vstack([run.pose[:100], np.repeat(run.pose[99:100], 20, axis=0)]),
        body_velocity=np.vstack([run.body_velocity[:100], np.zeros((20, 3))]),
        wheel_command=np.vstack([run.wheel_command[:100], np.zeros((20, 4))]),
    )
    assert repair(still).repairs == ("19 rows equal to the row before (standstill); kept",)


def test_a_robot_that_stands_still_tells_nothing_about_units():
    run = moving_run()
    noise = np.random.default_rng(2).normal(0.0, 1e-3, (120, 3))
    still = dc.replace(run, pose=0 * run.pose, body_velocity=noise)
    assert repair(still) == still


# Excitation.


def test_excitation():
    run = moving_run()
    check_excitation(run)
    constant = dc.replace(run, wheel_command=np.full((120, 4), 50.0), source="run.csv")
    repair(constant)  # A validation run may be like that.
    with pytest.raises(UserError, match=r"run\.csv: .*constant .*nothing can be identified"):
        check_excitation(constant)
    with pytest.raises(UserError, match=r"constant \(rear_right\)"):
        check_excitation(changed(run, "wheel_command", (slice(None), 2), 7.0))


# The recordings behind the thesis; no copies of them are in the project.


@pytest.mark.skipif(not DATA.exists(), reason=f"the recordings are not in {DATA}")
@pytest.mark.parametrize(
    ("name", "rows", "period", "repairs"),
    [
        (
            "training_data",
            800,
            0.0999997,
            (
                "time: 19 of 799 intervals outside 98-102 ms (shortest 18.4, longest 181 ms); "
                "kept, but derivatives take the samples as evenly spaced",
                "30 rows equal to the row before (standstill); kept",
            ),
        ),
        (
            "validation_const_rect",
            121,
            0.1,
            (
                "time: stamps have a resolution of 1 s; rebuilt as 121 evenly spaced samples over "
                "12.0 s",
            ),
        ),
        (
            "validation_turn_rect",
            220,
            0.1004566,
            (
                "time: stamps have a resolution of 1 s; rebuilt as 220 evenly spaced samples over "
                "22.0 s",
            ),
        ),
    ],
)
def test_reports_of_the_recordings(name, rows, period, repairs):
    path = DATA / f"{name}.csv"
    run = load_recorded_run(path)
    check_excitation(run)
    assert len(run.time) == rows and run.time[0] == 0
    assert run.period == pytest.approx(period, abs=5e-8)
    assert run.repairs == repairs
    assert run.source == f"{name}.csv" and len(run.sha256) == 64
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    np.testing.assert_array_equal(run.pose, table[:, 1:4])
    np.testing.assert_array_equal(run.body_velocity, table[:, 4:7])
    np.testing.assert_array_equal(run.wheel_command, table[:, [7, 8, 10, 9]])
