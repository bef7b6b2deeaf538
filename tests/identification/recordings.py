"""Small recordings for tests, with every kind of motion and known samples."""

import dataclasses as dc

import numpy as np

from mirte_drake.angles import rotation
from mirte_drake.identification.csv_file import save_csv
from mirte_drake.identification.recorded_run import RecordedRun


def moving_run(rows: int = 120, period: float = 0.1, seed: int = 1) -> RecordedRun:
    """A robot that drives, slides and turns by several turns, odometry as the robot makes it."""
    rng = np.random.default_rng(seed)
    command = np.round(np.repeat(rng.uniform(-90, 90, (rows // 3 + 1, 4)), 3, axis=0)[:rows])
    velocity = rng.uniform([-0.4, -0.2, 0.4], [0.6, 0.2, 1.8], (rows, 3))
    velocity[0] = 0.0
    pose = np.empty((rows, 3))
    pose[0] = [1.0, -2.0, 0.3]
    pose[:, 2] = pose[0, 2] + period * np.cumsum(velocity[:, 2])
    turned = np.einsum("nij,nj->ni", rotation(pose[:, 2]), velocity)
    pose[:, :2] = pose[0, :2] + period * np.cumsum(turned[:, :2], axis=0)
    return RecordedRun(np.arange(rows) * period, pose, velocity, command)


def csv_text(path, run: RecordedRun | None = None) -> str:
    """Text of a good file of 40 rows after the header, written at the path."""
    save_csv(run or moving_run(40), path)
    return path.read_text()


def changed(run: RecordedRun, name: str, index, value) -> RecordedRun:
    array = getattr(run, name).copy()
    array[index] = value
    return dc.replace(run, **{name: array})
