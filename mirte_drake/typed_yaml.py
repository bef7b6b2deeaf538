"""Typed YAML: dataclasses to text and back, with errors that a user can mend."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from mirte_drake.errors import UserError

T = TypeVar("T")


def parse_typed(schema: type[T], text: str, origin: str, defaults: T | None = None) -> T:
    """Returns a dataclass read from YAML text.

    Args:
        schema: The dataclass.
        text: YAML; missing fields keep their defaults, unknown ones are errors.
        origin: Where the text comes from, for the message.
        defaults: Values of missing fields, instead of the dataclass's own.

    Raises:
        UserError: when the text is no YAML, or does not fit the schema.
    """
    try:
        if not isinstance(yaml.compose(text, Loader=yaml.SafeLoader), yaml.MappingNode):
            raise UserError(f"{origin}: must be a YAML mapping of field: value")
        return yaml_load_typed(schema=schema, data=text, defaults=defaults or schema())
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f", line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or error
        raise UserError(f"{origin}{line}: not valid YAML: {problem}") from None
    except UserError:
        raise
    except (RuntimeError, ValueError, TypeError, AssertionError, KeyError) as error:
        field = _first_field_that_fails(schema, text, defaults)
        raise UserError(f"{origin}: {field}{_one_line(error)}") from None


def load_typed(schema: type[T], path: Path, defaults: T | None = None) -> T:
    """Returns a dataclass read from a YAML file; see ``parse_typed``.

    Raises:
        UserError: when the file cannot be read, or does not fit the schema.
    """
    return parse_typed(schema, read_text(path), str(path), defaults)


def read_text(path: Path) -> str:
    """Returns the text of a file.

    Raises:
        UserError: when it cannot be read.
    """
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise UserError(f"{path}: cannot be read: it is not UTF-8 text") from None


def write_typed(value: Any, path: Path) -> None:  # noqa: ANN401
    """Writes a dataclass as a YAML file, complete or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(yaml_dump_typed(value), encoding="utf-8")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yields a temporary path of the same suffix that becomes ``path`` when the block succeeds.

    Raises:
        UserError: when the folder cannot be made or written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".partial-", dir=path.parent) as folder:
            temporary = Path(folder) / path.name
            yield temporary
            temporary.replace(path)
    except OSError as error:
        raise UserError(f"{path}: cannot be written: {error.strerror or error}") from None


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _first_field_that_fails(schema: type, text: str, defaults: object) -> str:
    """Names the innermost single field that alone reproduces the error, as ``a.b: ``."""
    node = yaml.compose(text, Loader=yaml.SafeLoader)
    path: list[str] = []
    while isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            alone = f"{key.value}: {_render(value)}"
            for parent in reversed(path):
                alone = f"{parent}: {{{alone}}}"
            try:
                yaml_load_typed(schema=schema, data=f"{{{alone}}}", defaults=defaults or schema())
            except Exception:
                path.append(key.value)
                node = value
                break
        else:
            break
    return f"{'.'.join(path)}: " if path else ""


def _render(node: yaml.Node) -> str:
    return " ".join(yaml.serialize(node, default_flow_style=True).replace("\n...", "").split())
