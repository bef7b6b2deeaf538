"""A session at the wire: a guard at the other end, and wheels that stand whenever it ends."""

import secrets
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from mirte_drake.errors import UserError
from mirte_drake.hardware.guard_process import start_guard
from mirte_drake.hardware.link import Link, Role
from mirte_drake.hardware.messages import (
    DriveCommand,
    GuardStatus,
    Odometry,
    OperatorRequest,
    Request,
    WheelCommand,
)
from mirte_drake.hardware.wire_config import open_link
from mirte_drake.pacing import GUARD_TIMEOUT
from mirte_drake.scenario import Scenario, wired_robot
from mirte_drake.vectors import POSE_SIZE, WHEELS

STOP_TIME = 0.5  # [s] For which zeros are repeated where no guard does it.
STOP_PERIOD = 0.05  # [s] Between them.
CONFIRMATION = 0.2  # [s] For the guard to say that the wheels stand.


@contextmanager
def wire_to(scenario: Scenario, *, own_guard: bool = True) -> Iterator[tuple[Link, int]]:
    """Yields the controller's end of the wire and its session, with a guard at the other end.

    However the block ends, the wheels stand afterwards.

    Args:
        scenario: Its robot and the first pose of its path.
        own_guard: Whether to start a guard on this machine; else one runs already.

    Raises:
        UserError: when the robot is simulated, or wire or guard cannot be used.
    """
    robot = wired_robot(scenario)
    session = secrets.randbits(62) + 1
    with open_link(robot.wire, Role.CONTROLLER) as link:
        guard = None
        if own_guard:
            guard = start_guard(robot.wire, robot.governor, scenario.first_pose)
        try:
            yield link, session
        finally:
            stop_wheels(link, session)
            if guard is not None:
                guard.stop()


def stop_wheels(link: Link, session: int, clock: Callable[[], float] = time.monotonic) -> None:
    """Has the wheels stand: by the guard, and where it does not say so, by zeros of one's own.

    Args:
        link: The controller's end of the wire.
        session: Number of this controller.
        clock: [s] that messages' times of arrival are of.
    """
    start = clock()
    nothing = np.zeros(len(WHEELS))
    # Of an end the guard wants to know nothing but whose it is.
    done = DriveCommand(session, 2**31 - 1, nothing, np.zeros(POSE_SIZE), 0, False, done=True)
    link.send(done)
    link.wait(0.0)  # What came before this has perhaps not been looked at.
    heard = link.latest(GuardStatus)
    # Of a guard that is gone there is nothing to wait for while the wheels turn.
    patience = 0.0 if heard is None or start - heard.arrival > GUARD_TIMEOUT else CONFIRMATION
    while clock() - start < patience:
        link.wait(0.01)
        status = link.latest(GuardStatus)
        if status is not None and status.arrival > start and not np.any(status.command):
            return
    while clock() - start < patience + STOP_TIME:
        link.send(WheelCommand(nothing))
        link.wait(STOP_PERIOD)


def stop_all(link: Link, duration: float = 1.5, clock: Callable[[], float] = time.monotonic) -> str:
    """Asks every guard to stop and sends zeros for ``duration`` [s]; returns what is known then.

    Args:
        link: An operator's end of the wire.
        duration: [s], longer than discovery takes.
        clock: [s] that messages' times of arrival are of.
    """
    end = clock() + duration
    while clock() < end:
        link.send(OperatorRequest(Request.STOP))
        link.send(WheelCommand(np.zeros(len(WHEELS))))
        link.wait(STOP_PERIOD)
    status, odometry = link.latest(GuardStatus), link.latest(Odometry)
    guard = "no guard was heard" if status is None else f"the guard has stopped: {status.reason}"
    if odometry is None:
        return f"zeros sent; {guard}; no odometry was heard: look at the robot"
    speed = np.linalg.norm(odometry.body_velocity[:2])
    return f"zeros sent; {guard}; the robot moves at {speed:.2f} m/s"


def reset_guard(
    link: Link, timeout: float = 3.0, clock: Callable[[], float] = time.monotonic
) -> str:
    """Lets a guard that has stopped the robot go on; returns what it says.

    Args:
        link: An operator's end of the wire.
        timeout: [s] for the guard to answer.
        clock: [s] that messages' times of arrival are of.

    Raises:
        UserError: when no guard answers, or it stays stopped.
    """
    end = clock() + timeout
    while clock() < end:
        link.send(OperatorRequest(Request.RESET))
        link.wait(STOP_PERIOD)
        status = link.latest(GuardStatus)
        if status is not None and not status.stopped:
            return "the guard is ready"
    status = link.latest(GuardStatus)
    if status is None:
        raise UserError("stop --reset: no guard was heard; is it running on this wire?")
    raise UserError(f"stop --reset: the guard stays stopped: {status.reason}")
