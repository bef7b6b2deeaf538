"""Models as YAML files: the one place that reads and writes them."""

import dataclasses as dc
import functools
import os
from importlib.resources import files
from pathlib import Path

from mirte_drake.errors import UserError
from mirte_drake.model.lagged_model import LaggedModel, LaggedParameters
from mirte_drake.model.prediction_model import PredictionModel
from mirte_drake.model.sparse_model import SparseModel
from mirte_drake.typed_yaml import load_typed, write_typed

IDENTIFIED_MODELS = Path(str(files("mirte_drake"))) / "model" / "identified"


@dc.dataclass
class Identification:
    """How a model came about."""

    source: str = ""  # Where the numbers come from.
    data_sha256: str = ""  # Checksum of the recording.
    date: str = ""  # ISO date of the identification.
    settings: dict[str, str] = dc.field(default_factory=dict)


@dc.dataclass
class ModelFile:
    """Content of a model's YAML file: a table of terms, or a lagged model's parameters."""

    name: str = ""
    lagged: LaggedParameters | None = None  # Then the four below stay empty.
    states: dict[str, str] = dc.field(default_factory=dict)  # Name to unit, in order.
    inputs: dict[str, str] = dc.field(default_factory=dict)  # Name to unit, in order.
    auxiliaries: dict[str, dict[str, float]] = dc.field(default_factory=dict)
    derivatives: dict[str, dict[str, float]] = dc.field(default_factory=dict)
    identification: Identification = dc.field(default_factory=Identification)
    training_scores: dict[str, float] = dc.field(default_factory=dict)


def model_names() -> list[str]:
    """Returns the names of the identified models that come with the package."""
    return names_in(IDENTIFIED_MODELS)


def names_in(folder: Path) -> list[str]:
    """Returns the names of the YAML files in a folder of the package."""
    return sorted(path.stem for path in folder.glob("*.yaml"))


def named_file(kind: str, folder: Path, name_or_path: str | os.PathLike) -> Path:
    """Returns the YAML file of a name, see ``names_in``, or of a path.

    Raises:
        UserError: when it is neither a name nor the path of a YAML file; names the ``kind``.
    """
    if str(name_or_path) in names_in(folder):
        return folder / f"{name_or_path}.yaml"
    path = Path(name_or_path)
    if path.suffix not in (".yaml", ".yml"):
        raise UserError(
            f"{kind} {str(name_or_path)!r} is not known: use one of {', '.join(names_in(folder))} "
            "or the path of a .yaml file"
        )
    return path


def load_model_file(name_or_path: str | os.PathLike) -> ModelFile:
    """Reads a model by name (see ``model_names``) or by the path of a YAML file.

    Raises:
        UserError: when there is no such model, or the file is not a model.
    """
    return load_typed(ModelFile, named_file("model", IDENTIFIED_MODELS, name_or_path))


def load_sparse_model(name_or_path: str | os.PathLike) -> SparseModel:
    """Returns the model of a name or YAML file, which must be a table of terms.

    Raises:
        UserError: when there is no such model, or it is another kind.
    """
    model = load_model(name_or_path)
    if not isinstance(model, SparseModel):
        raise UserError(
            f"model {str(name_or_path)!r} is lagged: must be a table of terms, such as "
            "extended_kinematic"
        )
    return model


def load_model(name_or_path: str | os.PathLike) -> PredictionModel:
    """Returns the model of a name or YAML file.

    Raises:
        UserError: when there is no such model, or the file is not a model.
    """
    if name_or_path in model_names():
        return _identified_model(str(name_or_path))
    return _build(name_or_path)


@functools.cache
def _identified_model(name: str) -> PredictionModel:
    """Returns a model of the package, read once: its file and the model never change."""
    return _build(name)


def _build(name_or_path: str | os.PathLike) -> PredictionModel:
    content = load_model_file(name_or_path)
    try:
        if content.lagged is not None:
            if content.states or content.inputs or content.auxiliaries or content.derivatives:
                raise ValueError(
                    "lagged: a model with it has no states, inputs or terms of its own"
                )
            return LaggedModel(content.name, content.lagged)
        return SparseModel(
            content.name,
            list(content.states),
            list(content.inputs),
            content.derivatives,
            content.auxiliaries,
        )
    except ValueError as error:
        raise UserError(f"model {name_or_path}: {error}") from None


def save_model_file(content: ModelFile, path: str | os.PathLike) -> None:
    """Writes a model's YAML file, complete or not at all."""
    write_typed(content, Path(path))
