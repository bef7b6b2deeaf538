"""One message of each kind with entries that differ, and ways to compare and to open wires."""

import dataclasses as dc
import itertools
import os

import numpy as np
import pytest

from mirte_drake.errors import UserError
from mirte_drake.hardware.lcm_link import open_lcm
from mirte_drake.hardware.messages import (
    DriveCommand,
    GuardStatus,
    Odometry,
    OperatorRequest,
    PlanView,
    Request,
    WheelCommand,
)

MESSAGES = {
    type(message): message
    for message in (
        Odometry(1_756_120_957_123_456_789, np.array([1.5, -2.5, 3.0]), np.array([0.1, -0.2, 0.3])),
        WheelCommand(np.array([1.0, -20.0, 100.0, -100.0])),
        DriveCommand(
            session=2**63 - 1,
            sequence=7,
            command=np.array([0.25, -1.0, 2.0, 99.5]),
            reference=np.array([1.0, 2.0, -3.0]),
            odometry_stamp=1_756_120_957_123_456_789,
            solve_failed=True,
        ),
        GuardStatus(
            session=5,
            sequence=6,
            command=np.array([1.0, 2.0, 3.0, 4.0]),
            stopped=True,
            reason="odometry is older than 0.25 s – stop",
            odometry_age=0.26,
            rejected=3,
        ),
        OperatorRequest(Request.RESET),
        PlanView(
            reference=np.arange(33.0).reshape(11, 3),
            nominal=-np.arange(33.0).reshape(11, 3),
            half_width=np.array([0.1, 0.2, 0.3]),
        ),
    )
}

_counter = itertools.count()


def check_equal(actual, expected, *, arrived_after=None):
    """Every field alike; of the arrival only that it was not sent but read from the clock."""
    assert type(actual) is type(expected)
    for field in dc.fields(expected):
        value = getattr(actual, field.name)
        if field.name == "arrival" and arrived_after is not None:
            assert value >= arrived_after
        else:
            np.testing.assert_array_equal(value, getattr(expected, field.name), strict=True)


def multicast_url() -> str:
    """A udpm URL that no other test uses; skips where there is no multicast."""
    port = 20_000 + (os.getpid() * 50 + next(_counter)) % 40_000
    url = f"udpm://239.255.76.67:{port}?ttl=0"
    try:
        open_lcm(url)
    except UserError as error:
        pytest.skip(f"there is no multicast on this machine: {error}")
    return url
