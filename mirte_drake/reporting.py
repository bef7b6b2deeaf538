"""Reports of runs that were saved: of one, or of several beside each other."""

import json
from collections.abc import Sequence
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from mirte_drake.assembly import MakeDiagram
from mirte_drake.campaign.outcome import oscillation, saturation
from mirte_drake.containment import of_successors
from mirte_drake.errors import UserError
from mirte_drake.files import read_text
from mirte_drake.robots.names import robot_name
from mirte_drake.run_summary import REPLAY_FILE, RUN_FILES
from mirte_drake.scenario import Scenario
from mirte_drake.scenario_file import load_scenario
from mirte_drake.systems.pose_lqr import PoseLqrConfig
from mirte_drake.systems.pose_pid import PosePidConfig
from mirte_drake.visualization.comparison_report import comparison_report
from mirte_drake.visualization.diagram_picture import diagram_svg
from mirte_drake.visualization.page import save_page
from mirte_drake.visualization.run_report import ReportedRun, run_report

REPORT_FILE = "report.html"


def load_run(folder: Path) -> ReportedRun:
    """Returns a run that ``save_run`` wrote.

    Raises:
        UserError: when the folder has none, naming the file that is missing or damaged.
    """
    log_file, summary_file, scenario_file = _files(folder)
    for file in (log_file, summary_file, scenario_file):
        if not file.is_file():
            raise UserError(f"{file}: is missing; name the folder that a run was written to")
    scenario = load_scenario(str(scenario_file))
    try:
        summary = json.loads(read_text(summary_file))
        with np.load(log_file) as log:
            arrays = dict(log)
    except (ValueError, OSError, EOFError, BadZipFile) as error:
        file = summary_file if isinstance(error, json.JSONDecodeError) else log_file
        raise UserError(f"{file}: is damaged; run it again") from None
    successors = of_successors(arrays) if scenario.has_tube else None
    return ReportedRun(
        name=summary["scenario"],
        description=scenario.description,
        robot=robot_name(scenario.robot),
        controller=_controller_name(scenario),
        tube=(*successors, successors.outside) if successors else None,
        why_outside=_why_outside(scenario),
        disturbance_bound=scenario.disturbance_bound,
        period=scenario.period,
        input_limit=scenario.input_limit,
        scenario=read_text(scenario_file),
        summary=summary,
        log=arrays,
        saturation=saturation(arrays["applied_input"], scenario.input_limit),
        oscillation=oscillation(arrays["applied_input"], max(arrays["time"][-1], scenario.period)),
    )


def _controller_name(scenario: Scenario) -> str:
    """Returns the controller of a scenario in two words."""
    match scenario.controller:
        case PosePidConfig():
            return "pose PID"
        case PoseLqrConfig():
            return "pose LQR"
    return "tube NMPC" if scenario.has_tube else "baseline NMPC"


def _why_outside(scenario: Scenario) -> str:
    """Returns why a sample may leave the tube of a scenario."""
    if scenario.tube_updater is not None:
        return "the tube bounds the linearised error, so it may happen"
    if scenario.lagged_tube is not None and scenario.lagged_tube.shape == "ellipsoid":
        return "the ellipsoid adds up independent errors, so it may happen"
    return "it happens where the robot does more than the tube assumes"


def save_report(folder: Path, path: Path | None = None) -> Path:
    """Writes the report of a run and returns its path.

    A replay in the folder, ``REPLAY_FILE``, becomes a part of it.

    Args:
        folder: Of the run, as ``save_run`` wrote it.
        path: Where to; None: ``REPORT_FILE`` in the folder.

    Raises:
        UserError: when the folder has no run, or the file cannot be written.
    """
    run = load_run(folder)
    diagram, no_diagram = _picture(load_scenario(str(_files(folder)[2])))
    replay = folder / REPLAY_FILE
    text = run_report(
        run,
        diagram=diagram,
        no_diagram=no_diagram,
        replay=read_text(replay) if replay.is_file() else "",
    )
    return save_page(text, path or folder / REPORT_FILE)


def save_comparison(folders: Sequence[Path], path: Path) -> Path:
    """Writes a report that shows runs beside each other and returns its path.

    Args:
        folders: Of the runs, as ``save_run`` wrote them.
        path: Where to.

    Raises:
        UserError: when a folder has no run, when two are the same, when there is more to tell
            apart than figures can, or when the file cannot be written.
    """
    runs = {str(folder): load_run(folder) for folder in folders}
    if len(runs) < len(folders):
        raise UserError("the same run is named twice; name each once")
    return save_page(comparison_report(runs), path)


def _files(folder: Path) -> tuple[Path, Path, Path]:
    """Returns log, summary and scenario of a run."""
    log, summary, scenario = RUN_FILES
    return folder / log, folder / summary, folder / scenario


def _picture(scenario: Scenario) -> tuple[str, str]:
    """Returns the picture of a scenario's Diagram as SVG, or why there is none."""
    try:
        diagram = MakeDiagram(scenario)
    except UserError as error:  # A robot beyond a wire whose middleware is not on this machine.
        return "", str(error)
    return diagram_svg(diagram), ""
