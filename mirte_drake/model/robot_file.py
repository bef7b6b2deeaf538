"""Parameters of the dynamic robot as YAML files: the one place that reads and writes them."""

import dataclasses as dc
import os
from importlib.resources import files
from pathlib import Path

from mirte_drake.errors import UserError
from mirte_drake.model.dynamic_model import DynamicParameters
from mirte_drake.model.model_file import Identification, named_file, names_in
from mirte_drake.typed_yaml import load_typed, write_typed

FITTED_ROBOTS = Path(str(files("mirte_drake"))) / "model" / "fitted"


@dc.dataclass
class RobotFile:
    """Content of a robot's YAML file."""

    name: str = ""
    parameters: DynamicParameters = dc.field(default_factory=DynamicParameters)
    identification: Identification = dc.field(default_factory=Identification)
    # By recording and quantity, for example "validation_run vx [m/s]": RMSE, open loop.
    scores: dict[str, float] = dc.field(default_factory=dict)


def robot_names() -> list[str]:
    """Returns the names of the robots that come with the package."""
    return names_in(FITTED_ROBOTS)


def load_robot_file(name_or_path: str | os.PathLike) -> RobotFile:
    """Reads a robot by name (see ``robot_names``) or by the path of a YAML file.

    Raises:
        UserError: when there is no such robot, or the file does not describe one.
    """
    path = named_file("robot", FITTED_ROBOTS, name_or_path)
    content = load_typed(RobotFile, path)
    try:
        content.parameters.validate()
    except ValueError as error:
        raise UserError(f"{path}: parameters.{error}") from None
    return content


def save_robot_file(content: RobotFile, path: str | os.PathLike) -> None:
    """Writes a robot's YAML file, complete or not at all."""
    write_typed(content, Path(path))
