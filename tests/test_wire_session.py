import dataclasses as dc

import numpy as np
import pytest
from scripted_link import ScriptedLink

from mirte_drake.errors import UserError
from mirte_drake.hardware.link import Role
from mirte_drake.hardware.messages import (
    DriveCommand,
    GuardStatus,
    Odometry,
    OperatorRequest,
    Request,
    WheelCommand,
)
from mirte_drake.wire_session import STOP_TIME, reset_guard, stop_all, stop_wheels

MOVING = GuardStatus(5, 3, np.full(4, 20.0), False, "", 0.0, 0)
STANDING = dc.replace(MOVING, command=np.zeros(4))
STOPPED = dc.replace(STANDING, stopped=True, reason="odometry is old")


def sent(link, kind):
    return [(time - 100.0, message) for time, message in link.sent if isinstance(message, kind)]


def test_the_guard_is_told_and_believed():
    link = ScriptedLink()
    link.at(99.9, STANDING)  # Of before does not count.
    link.at(100.01, MOVING)
    link.at(100.03, STANDING)
    stop_wheels(link, 5, link.clock)
    assert link.now == pytest.approx(100.03)
    ((_, done),) = sent(link, DriveCommand)
    assert done.done and done.session == 5 and not np.any(done.command)
    assert sent(link, WheelCommand) == []


@pytest.mark.parametrize("guard", [[], [MOVING]])
def test_where_no_guard_says_that_the_wheels_stand_zeros_are_sent_again_and_again(guard):
    link = ScriptedLink()
    for k in range(40):
        for status in guard:
            link.at(100.0 + 0.05 * k, status)
    stop_wheels(link, 5, link.clock)
    zeros = sent(link, WheelCommand)
    assert all(not np.any(message.command) for _, message in zeros)
    times = np.array([time for time, _ in zeros])
    assert times[0] <= 0.25 and np.max(np.diff(times)) <= 0.051
    assert times[-1] - times[0] > 0.8 * STOP_TIME


@pytest.mark.parametrize("last", [None, 99.7])
def test_a_guard_that_is_gone_is_not_waited_for(last):
    """While the wheels turn, and perhaps this process is the next to go."""
    link = ScriptedLink()
    if last is not None:
        link.at(last, MOVING)
    stop_wheels(link, 5, link.clock)
    assert sent(link, WheelCommand)[0][0] == pytest.approx(0.0, abs=1e-3)


def test_stop_tells_guards_and_wheels_and_says_what_it_knows():
    link = ScriptedLink(Role.OPERATOR)
    assert "no odometry was heard: look at the robot" in stop_all(link, clock=link.clock)
    assert {message.request for _, message in sent(link, OperatorRequest)} == {Request.STOP}
    assert all(not np.any(message.command) for _, message in sent(link, WheelCommand))
    link = ScriptedLink(Role.OPERATOR)
    link.at(100.3, STOPPED)
    link.at(100.4, Odometry(1, np.zeros(3), np.array([0.3, 0.4, 0.0])))
    said = stop_all(link, clock=link.clock)
    assert "odometry is old" in said and "0.50 m/s" in said


def test_reset_waits_for_the_guard_to_agree():
    link = ScriptedLink(Role.OPERATOR)
    link.at(100.2, STOPPED)
    link.at(100.4, STANDING)
    assert reset_guard(link, clock=link.clock) == "the guard is ready"
    assert link.now == pytest.approx(100.4)
    assert {message.request for _, message in sent(link, OperatorRequest)} == {Request.RESET}


@pytest.mark.parametrize(
    ("statuses", "words"),
    [([], "no guard was heard"), ([STOPPED], "stays stopped: odometry is old")],
)
def test_a_reset_in_vain_says_why(statuses, words):
    link = ScriptedLink(Role.OPERATOR)
    for status in statuses:
        link.at(100.2, status)
    with pytest.raises(UserError, match=words):
        reset_guard(link, clock=link.clock)
