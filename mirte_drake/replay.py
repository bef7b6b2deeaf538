"""A run that is on file, as a page that plays it."""

import dataclasses as dc
import json
import math
import zipfile
from pathlib import Path

import numpy as np

from mirte_drake.angles import pose_error, rotation
from mirte_drake.errors import UserError
from mirte_drake.files import read_text, replacing
from mirte_drake.geometry import wheel_speeds
from mirte_drake.live_view import scene_stage
from mirte_drake.robots.robot_description import robot_sdf
from mirte_drake.run_summary import RUN_FILES
from mirte_drake.scenario import Scenario, load_planning_model
from mirte_drake.scenario_file import load_scenario
from mirte_drake.vectors import POSE, POSE_SIZE, WHEELS, YAW
from mirte_drake.visualization.replay_page import replay_page
from mirte_drake.visualization.scene.frame import Frame, Trail
from mirte_drake.visualization.scene.shapes import read_robot_shapes

MOST_FRAMES = 400  # Of a page, so that it stays below 5 MB: of a longer run every second, ...
MOST_PIECES = 130  # Of each trail.

_SHAPES = {  # Of the arrays of a log that are drawn, without their rows; N is the horizon.
    "reference": (POSE_SIZE,),
    "pose": (POSE_SIZE,),
    "true_pose": (POSE_SIZE,),
    "disturbance": (POSE_SIZE,),
    "applied_input": (len(WHEELS),),
}
_PLAN_SHAPES = {  # Of those of a controller that plans, too.
    "nominal_pose": (POSE_SIZE,),
    "nominal_next": (POSE_SIZE,),
    "half_width": (POSE_SIZE,),
    "nominal_plan": ("N", len(WHEELS)),
}
_LAGGED_SHAPES = {"nominal_next_velocity": (POSE_SIZE,)}  # Of those with a lagged model.


@dc.dataclass(frozen=True)
class SavedRun:
    """What ``save_run`` wrote."""

    name: str
    scenario: Scenario
    log: dict[str, np.ndarray]


def load_run(folder: Path) -> SavedRun:
    """Returns the run of a folder.

    Raises:
        UserError: when one of its files is missing or is not of a run.
    """
    for name in RUN_FILES:
        if not (folder / name).is_file():
            raise UserError(f"{folder}: has no {name}; simulate writes it into its folder")
    log_file, summary_file, scenario_file = (folder / name for name in RUN_FILES)
    try:
        name = json.loads(read_text(summary_file))["scenario"]
    except (json.JSONDecodeError, KeyError, TypeError):
        raise UserError(f"{summary_file}: not the summary of a run; simulate anew") from None
    scenario = load_scenario(str(scenario_file))
    return SavedRun(str(name), scenario, _load_log(log_file, scenario))


def _load_log(path: Path, scenario: Scenario) -> dict[str, np.ndarray]:
    shapes: dict[str, tuple[object, ...]] = dict(_SHAPES)
    if scenario.controller is None:
        shapes |= _PLAN_SHAPES
        shapes |= _LAGGED_SHAPES if scenario.state_estimator is not None else {}
    try:
        with np.load(path) as file:
            log = {name: np.asarray(file[name], dtype=float) for name in shapes}
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (KeyError, ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise UserError(f"{path}: not the log of a run: {error}; simulate anew") from None
    horizon, rows = scenario.nominal_nmpc.horizon, len(log["pose"])
    for name, shape in shapes.items():
        wanted = (rows, *(horizon if size == "N" else size for size in shape))
        if log[name].shape != wanted or not rows:
            raise UserError(
                f"{path}: {name} must have shape {wanted}, got {log[name].shape}; simulate anew"
            )
        if not np.all(np.isfinite(log[name])):
            raise UserError(f"{path}: {name} must have finite numbers only; simulate anew")
    return log


def rolled_wheel_angles(poses: np.ndarray) -> np.ndarray:
    """Returns the angles (N, 4) [rad] that wheels without slip have turned along poses (N, 3).

    Between two poses the body velocity is constant, so that the way is an arc; (2-2).
    """
    yaw, turn = poses[:-1, YAW], np.diff(poses[:, YAW])
    chord = np.diff(poses, axis=0) / np.sinc(turn / (2 * np.pi))[:, None]
    chord[:, YAW] = turn
    moved = np.einsum("kji,kj->ki", rotation(yaw + turn / 2), chord)
    return np.vstack([np.zeros(len(WHEELS)), np.cumsum(wheel_speeds(moved), axis=0)])


def frames(run: SavedRun) -> list[Frame]:
    """Returns what is seen at each sample.

    The tube ahead is the one that came, so that it is known; past the end it stays as it is. Of a
    controller that does not plan, the plan is where the robot is, without a tube.
    Wheels turn as the measured pose says: odometry is what they did, and where there is none, the
    robot has no wheels of its own.
    """
    log = run.log
    horizon, last = run.scenario.nominal_nmpc.horizon, len(log["pose"]) - 1
    plans = _plans(run)
    half_width = log.get("half_width", np.zeros((last + 1, POSE_SIZE)))
    angles = rolled_wheel_angles(log["pose"])
    return [
        Frame(
            pose=log["pose"][k],
            true_pose=log["true_pose"][k],
            reference=log["reference"][k],
            plan=plans[k],
            half_widths=half_width[np.minimum(np.arange(k, k + horizon + 1), last)],
            disturbance=log["disturbance"][k],
            wheel_command=log["applied_input"][k],
            wheel_angles=angles[k],
        )
        for k in range(last + 1)
    ]


def _plans(run: SavedRun) -> np.ndarray:
    """Returns the nominal poses (K, N + 1, 3) of all samples."""
    log, horizon = run.log, run.scenario.nominal_nmpc.horizon
    if "nominal_plan" not in log:
        return np.repeat(log["pose"][:, None], horizon + 1, axis=1)
    model, begins = load_planning_model(run.scenario), [log["nominal_next"]]
    if "nominal_next_velocity" in log:
        begins.append(log["nominal_next_velocity"])
    later = [
        model.roll_out(begin, inputs[1:], run.scenario.period)[:, POSE]
        for begin, inputs in zip(np.hstack(begins), log["nominal_plan"], strict=True)
    ]
    return np.concatenate([log["nominal_pose"][:, None], later], axis=1)


def trails(run: SavedRun, length: int) -> list[Trail]:
    """Returns what the run leaves behind, in pieces of so many samples."""
    log = run.log
    before, after, half_width = log["pose"], log["pose"][1:], np.zeros(log["pose"].shape)
    if "nominal_plan" in log:
        before, after, half_width = log["nominal_pose"], log["nominal_next"], log["half_width"]
    steps = len(log["pose"]) - 1
    nominal = np.stack([before[:steps], after[:steps]], axis=1)
    half_widths = np.stack([half_width[:-1], half_width[1:]], axis=1)
    return [
        Trail(
            log["pose"][i : i + length + 1],
            log["true_pose"][i : i + length + 1],
            nominal[i : i + length],
            half_widths[i : i + length],
        )
        for i in range(0, len(nominal), length)
    ]


def run_page(run: SavedRun) -> str:
    """Returns the HTML text of a page that plays a run; see ``replay_page``."""
    log, scenario = run.log, run.scenario
    samples = len(log["pose"])
    stride = math.ceil(samples / MOST_FRAMES)
    stage = scene_stage(scenario)
    path = stage.path if len(stage.path) else log["reference"][:, :2]
    places = np.vstack([log["pose"], log["true_pose"]])[:, :2]
    robot = type(scenario.robot).__name__.removesuffix("RobotConfig").lower()
    x, y, yaw = 1e3 * np.sqrt(np.mean(pose_error(log["pose"], log["reference"]) ** 2, axis=0))
    return replay_page(
        dc.replace(stage, path=path, places=places),
        read_robot_shapes(robot_sdf()),
        frames(run)[::stride],
        trails(run, math.ceil(samples / MOST_PIECES)),
        period=scenario.period * stride,
        title=run.name,
        caption=f"{robot} robot, seed {scenario.seed}, "
        f"RMSE in x, y and yaw {x:.0f} mm, {y:.0f} mm, {yaw:.0f} mrad",
    )


def write_replay(folder: Path, path: Path) -> None:
    """Writes the page that plays the run of a folder, complete or not at all.

    Raises:
        UserError: when the run cannot be read, or the page not be written.
    """
    page = run_page(load_run(folder))
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
