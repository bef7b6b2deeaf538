import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import PassThrough
from scripted_link import ScriptedLink

from mirte_drake.hardware.messages import GuardStatus, Odometry
from mirte_drake.pacing import (
    GUARD_TIMEOUT,
    SLICE,
    START_TIMEOUT,
    GuardLost,
    Pace,
    WirePace,
    WireStopped,
)

PERIOD, GRACE = 0.1, 0.02


def odometry(stamp=0):
    return Odometry(stamp, np.zeros(3), np.zeros(3))


def status(**change):
    values = dict(session=1, sequence=0, command=np.zeros(4), stopped=False, reason="")
    return GuardStatus(**{**values, "odometry_age": 0.0, "rejected": 0, **change})


@pytest.fixture
def diagram():
    builder = DiagramBuilder()
    clock = builder.AddSystem(PassThrough(1))
    builder.ExportInput(clock.get_input_port(), "clock")
    builder.ExportOutput(clock.get_output_port(), "odometry_age")
    return builder.Build()


def guarded(until=10.0, start=100.0):
    """Link with a guard that speaks every 0.05 s."""
    link = ScriptedLink()
    for k in range(int(until / 0.05)):
        link.at(start + 0.05 * k, status())
    return link


def paced(diagram, link):
    return WirePace(diagram, link, period=PERIOD, grace=GRACE, clock=link.clock)


def ticks(diagram, link, pace, count):
    context = diagram.CreateDefaultContext()
    times, rows = [], []
    for _ in range(count):
        pace.before(context)
        times.append(link.now - 100.0)
        assert diagram.GetOutputPort("odometry_age").Eval(context)[0] == link.now
        rows.append(pace.after(context))
    return times, rows


def test_simulated_time_waits_for_nothing():
    pace = Pace()
    pace.before(None)
    assert pace.after(None) == {}


def test_samples_come_with_odometry_from_the_second_message_on(diagram):
    link = guarded()
    arrivals = [0.013, 0.113, 0.214, 0.311]
    for t in arrivals:
        link.at(100.0 + t, odometry())
    times, rows = ticks(diagram, link, paced(diagram, link), 3)
    np.testing.assert_allclose(times, arrivals[1:], atol=1e-9)
    assert all(row["fresh_odometry"] for row in rows)
    assert [row["command_latency_s"] for row in rows] == pytest.approx([0, 0, 0])


def test_a_sample_without_odometry_comes_a_little_late_and_the_next_one_on_time(diagram):
    link = guarded()
    for t in (0.0, 0.1, 0.3, 0.4):  # That of 0.2 is lost.
        link.at(100.0 + t, odometry())
    times, rows = ticks(diagram, link, paced(diagram, link), 4)
    np.testing.assert_allclose(times, [0.1, 0.2 + GRACE, 0.3, 0.4], atol=1e-9)
    assert [bool(row["fresh_odometry"]) for row in rows] == [True, False, True, True]


def test_samples_go_on_in_step_while_odometry_is_gone(diagram):
    link = guarded()
    for t in (0.0, 0.1):
        link.at(100.0 + t, odometry())
    times, _ = ticks(diagram, link, paced(diagram, link), 4)
    np.testing.assert_allclose(times, [0.1, 0.2 + GRACE, 0.3 + GRACE, 0.4 + GRACE], atol=1e-9)


def test_a_burst_of_late_messages_does_not_hurry_the_reference(diagram):
    link = guarded()
    for t in (0.0, 0.1, 0.2, 0.201, 0.202, 0.203, 0.3):
        link.at(100.0 + t, odometry())
    times, _ = ticks(diagram, link, paced(diagram, link), 4)
    np.testing.assert_allclose(times, [0.1, 0.2, 0.25, 0.3], atol=1e-9)


def test_odometry_that_came_during_a_long_solve_is_answered_at_once(diagram):
    link = guarded()
    for k in range(5):
        link.at(100.0 + 0.1 * k, odometry())
    pace = paced(diagram, link)
    ticks(diagram, link, pace, 1)
    link.now += 0.15  # The solve: nothing is received meanwhile.
    times, rows = ticks(diagram, link, pace, 1)
    assert times == pytest.approx([0.25])
    # Measured from the message's arrival, which the scripted link stamps as it was due.
    assert rows[0]["command_latency_s"] == pytest.approx(0.05)


def test_a_guard_that_spoke_during_a_long_solve_is_not_lost(diagram):
    link = guarded()
    for k in range(6):
        link.at(100.0 + 0.1 * k, odometry())
    pace = paced(diagram, link)
    ticks(diagram, link, pace, 1)
    link.now += 0.31
    ticks(diagram, link, pace, 1)


def test_a_silent_guard_is_lost_in_time(diagram):
    link = guarded(until=0.5)  # Its last word is at 0.45.
    for k in range(20):
        link.at(100.0 + 0.1 * k, odometry())
    with pytest.raises(GuardLost, match=r"said nothing for 0\.2"):
        ticks(diagram, link, paced(diagram, link), 20)
    assert GUARD_TIMEOUT < link.now - 100.45 <= GUARD_TIMEOUT + SLICE + 1e-9


def test_a_stop_of_the_guard_ends_the_drive_with_its_reason(diagram):
    link = guarded()
    for k in range(20):
        link.at(100.0 + 0.1 * k, odometry())
    link.at(100.333, status(stopped=True, reason="odometry is 0.24 s old"))
    with pytest.raises(WireStopped, match=r"odometry is 0\.24 s old"):
        ticks(diagram, link, paced(diagram, link), 20)
    assert link.now == pytest.approx(100.333)


@pytest.mark.parametrize(("there", "missing"), [("guard", "odometry"), ("odometry", "guard")])
def test_nothing_heard_at_the_start_says_of_whom(diagram, there, missing):
    link = ScriptedLink()
    for k in range(100):
        link.at(100.0 + 0.1 * k, status() if there == "guard" else odometry())
    with pytest.raises(WireStopped, match=f"no {missing} was heard for 5 s"):
        ticks(diagram, link, paced(diagram, link), 1)
    assert link.now - 100.0 == pytest.approx(START_TIMEOUT, abs=0.1)


def test_whoever_watches_can_end_the_drive(diagram):
    link = guarded()
    link.at(100.0, odometry())

    def watch():
        if link.now > 100.05:
            raise WireStopped("interrupted")

    pace = WirePace(diagram, link, period=PERIOD, clock=link.clock, watch=watch)
    with pytest.raises(WireStopped, match="interrupted"):
        ticks(diagram, link, pace, 5)


def test_it_does_not_begin_with_odometry_of_no_use(diagram):
    link = guarded()
    for k in range(100):
        link.at(100.0 + 0.1 * k, odometry(stamp=k))

    def refuse(message):
        return "nan" if message.stamp < 10 else None

    pace = WirePace(diagram, link, period=PERIOD, clock=link.clock, refuse=refuse)
    times, _ = ticks(diagram, link, pace, 1)
    assert times == pytest.approx([1.1])  # It waits for one more, to begin in step.
    pace = WirePace(diagram, link, period=PERIOD, clock=link.clock, refuse=lambda _: "nan")
    with pytest.raises(WireStopped, match=r"odometry was of no use \(nan\) for 5 s"):
        ticks(diagram, link, pace, 1)
