"""Scenarios as YAML files, one of which may extend another, and values changed by hand."""

import dataclasses as dc
import difflib
from collections.abc import Sequence
from pathlib import Path

from mirte_drake.errors import UserError
from mirte_drake.files import read_text
from mirte_drake.robots.dynamic_robot import DynamicRobotConfig
from mirte_drake.robots.sindyc_robot import SindycRobotConfig
from mirte_drake.scenario import KINDS, Scenario
from mirte_drake.systems.disturbance_source import RecordedDisturbance
from mirte_drake.typed_yaml import parse_typed, top_level_text

SUFFIX = ".scenario.yaml"


def scenario_folder() -> Path:
    """Returns the folder of the scenarios: inside the installed package, or beside the source."""
    package = Path(__file__).parent
    installed = package / "diagrams"
    return installed if installed.is_dir() else package.parent / "diagrams"


def scenario_names() -> list[str]:
    """Returns the names of the scenarios that come with the package."""
    return sorted(p.name.removesuffix(SUFFIX) for p in scenario_folder().glob(f"*{SUFFIX}"))


def scenario_path(name_or_path: str, folder: Path = Path()) -> Path:
    """Returns the YAML file of a scenario.

    Args:
        name_or_path: Name, or path of a YAML file.
        folder: Where a relative path begins.

    Raises:
        UserError: for an unknown name.
    """
    if name_or_path.endswith((".yaml", ".yml")):
        return folder / name_or_path
    names = scenario_names()
    if name_or_path not in names:
        close = difflib.get_close_matches(name_or_path, names, n=1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        raise UserError(
            f"scenario {name_or_path!r} is not known: {hint}Use one of {', '.join(names)}, "
            "or the path of a .yaml file"
        )
    return scenario_folder() / f"{name_or_path}{SUFFIX}"


def scenario_stem(name_or_path: str) -> str:
    """Returns the name of a scenario for files: of a path, its last part without suffix."""
    return Path(name_or_path).name.removesuffix(SUFFIX).removesuffix(".yaml").removesuffix(".yml")


def load_scenario(name_or_path: str, overrides: Sequence[str] = ()) -> Scenario:
    """Returns a scenario, complete and checked.

    Args:
        name_or_path: A name out of ``scenario_names``, or the path of a YAML file.
        overrides: Later values, each as ``path.to.field=value``, the value in YAML; a relative
            path begins in the working directory.

    Raises:
        UserError: naming file or option, field, value and remedy.
    """
    path = scenario_path(name_or_path)
    scenario = _load_with_bases(path, ())
    error = _problem(scenario)
    if error:
        raise UserError(f"{path}: {error}")
    culprit = ""
    # What the odometry is without change depends on the robot, so that it comes after it.
    for override in sorted(overrides, key=lambda override: override.strip().startswith("odometry")):
        scenario = _override(scenario, override)
        # Two overrides may need each other, so only the last state must be right.
        culprit = (culprit or override) if _problem(scenario) else ""
    error = _problem(scenario)
    if error:
        raise UserError(f"--set {culprit}: {error}")
    return scenario


def _load_with_bases(path: Path, seen: tuple[Path, ...]) -> Scenario:
    if path in seen:
        raise UserError(f"{path}: extends: goes round in a circle; remove one of its links")
    text = read_text(path)
    base = Scenario()
    extends = top_level_text(text, "extends", str(path))
    if extends:
        try:
            base = _load_with_bases(scenario_path(extends, path.parent), (*seen, path))
        except UserError as error:
            raise UserError(f"{path}: extends: {error}") from None
    scenario = parse_typed(Scenario, text, str(path), dc.replace(base, description=""))
    _resolve_paths(scenario, path.parent)
    return dc.replace(scenario, extends="")  # Complete now: it stands for itself.


def _resolve_paths(scenario: Scenario, folder: Path) -> None:
    """Makes paths absolute, so that a scenario as it was run runs again from elsewhere.

    Those in a scenario file are meant from its folder, those of overrides from the working one.
    """

    def resolved(name_or_path: str) -> str:
        is_path = name_or_path.endswith((".yaml", ".yml"))
        return str((folder / name_or_path).resolve()) if is_path else name_or_path

    scenario.prediction_model = resolved(scenario.prediction_model)
    match scenario.robot:
        case SindycRobotConfig():
            scenario.robot.model = resolved(scenario.robot.model)
        case DynamicRobotConfig():
            scenario.robot.robot = resolved(scenario.robot.robot)
    if isinstance(scenario.disturbance, RecordedDisturbance):
        scenario.disturbance.file = (folder / scenario.disturbance.file).resolve()


def _override(scenario: Scenario, override: str) -> Scenario:
    origin = f"--set {override}"
    field, separator, value = override.partition("=")
    keys = [key.strip() for key in field.split(".")]
    if keys == ["extends"]:
        raise UserError(f"{origin}: extends belongs into a scenario file; run that one")
    if not separator or not all(key.isidentifier() for key in keys):
        raise UserError(f"{origin}: must be path.to.field=value")
    # A part that can be of several kinds keeps its kind when one of its fields changes.
    parts: list[object] = [scenario]
    for key in keys[:-1]:
        parts.append(getattr(parts[-1], key, None))
    text = value.strip() or "null"
    for key, part in zip(reversed(keys), reversed(parts), strict=True):
        kind = f"!{type(part).__name__} " if isinstance(part, KINDS) else ""
        text = f"{kind}{{{key}: {text}}}"
    if keys[0] == "odometry":
        scenario = dc.replace(scenario, odometry=scenario.measuring_odometry)
    scenario = parse_typed(Scenario, text, origin, defaults=scenario)
    _resolve_paths(scenario, Path())
    return scenario


def _problem(scenario: Scenario) -> str:
    """Returns what is wrong with a scenario, or nothing."""
    try:
        scenario.validate()
    except ValueError as error:
        return str(error)
    return ""
