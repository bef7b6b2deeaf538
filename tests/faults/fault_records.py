"""Records of trials that never took place: a drive at 10 Hz from 0 s on, a fault at 1 s."""

import numpy as np

from mirte_drake.faults.record import Record, SentOdometry
from mirte_drake.hardware.messages import GuardStatus, Odometry, WheelCommand

FAULT, END = 1.0, 2.2
DRIVING = np.array([20.0, 15.0, 15.0, 10.0])
STILL = np.zeros(4)


def odometry(measured, *, late=0.001, good=True, pose=None, altered=False):
    """One message, of a robot that goes along x at 0.1 m/s."""
    place = np.array([0.1 * measured, 0.0, 0.0]) if pose is None else np.asarray(pose, dtype=float)
    message = Odometry(round(1e9 * measured), place, np.array([0.1, 0.0, 0.0]))
    return SentOdometry(message, measured, measured + late, good, altered)


def command(time, values=DRIVING):
    return WheelCommand(np.asarray(values, dtype=float), time)


def status(time, reason=""):
    return GuardStatus(5, 0, STILL, bool(reason), reason, 0.0, 0, time)


def every(period, begin, end):
    return np.arange(round((end - begin) / period) + 1) * period + begin


def drive(**more):
    """A drive on which nothing happens."""
    record = {
        "odometry": [odometry(t) for t in every(0.1, -0.5, END)],
        "commands": [command(t) for t in every(0.1, 0.0, END)],
        "statuses": [status(t) for t in every(0.05, 0.0, END)],
        "start": 0.0,
        "fault": FAULT,
        "end": END,
    }
    return Record(**(record | more))


def stopped(at, reason="odometry is old: 0.23 s", last=0.9):
    """A drive that the guard stops at a time, zeros repeated."""
    zeros = [command(t, STILL) for t in every(0.05, at, END)]
    return drive(
        odometry=[odometry(t) for t in every(0.1, -0.5, last)],
        commands=[command(t) for t in every(0.1, 0.0, last)] + zeros,
        statuses=[status(0.0), status(at, reason)],
    )
