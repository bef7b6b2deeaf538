"""Typed YAML: dataclasses to text and back, with errors that a user can mend."""

import dataclasses as dc
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
    root = _compose(text, origin)
    try:
        return yaml_load_typed(schema=schema, data=text, defaults=defaults or schema())
    except (RuntimeError, ValueError, TypeError, AssertionError, KeyError) as error:
        field = _field_that_fails(schema, root, defaults)
        raise UserError(f"{origin}: {field}{_one_line(error)}") from None


def top_level_text(text: str, key: str, origin: str) -> str:
    """Returns the value of one top-level key as text; empty where it is not given.

    Raises:
        UserError: when the text is no YAML mapping.
    """
    for name, value in _compose(text, origin).value:
        if name.value == key and isinstance(value, yaml.ScalarNode):
            return value.value
    return ""


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
    root = yaml.compose(yaml_dump_typed(value), Loader=yaml.SafeLoader)
    _add_nulls(root, value)
    with replacing(path) as temporary:
        temporary.write_text(yaml.serialize(root), encoding="utf-8")


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


def _add_nulls(node: yaml.MappingNode, value: Any) -> None:  # noqa: ANN401
    """Adds the fields that are None: Drake leaves them out, and would load their defaults."""
    children = {key.value: child for key, child in node.value}
    for field in dc.fields(value):
        item = getattr(value, field.name)
        if item is None:
            key = yaml.ScalarNode("tag:yaml.org,2002:str", field.name)
            node.value.append((key, yaml.ScalarNode("tag:yaml.org,2002:null", "null")))
        elif dc.is_dataclass(item) and field.name in children:
            _add_nulls(children[field.name], item)


def _compose(text: str, origin: str) -> yaml.MappingNode:
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f", line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or _one_line(error)
        raise UserError(f"{origin}{line}: not valid YAML: {problem}") from None
    if not isinstance(root, yaml.MappingNode):
        raise UserError(f"{origin}: must be a YAML mapping of field: value")
    return root


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _field_that_fails(schema: type, root: yaml.MappingNode, defaults: object) -> str:
    """Names the innermost field that alone brings the error about, as ``a.b: ``."""
    path: list[yaml.Node] = []
    node: yaml.Node = root
    while isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            alone = value
            for parent in reversed([*path, key]):
                alone = yaml.MappingNode("tag:yaml.org,2002:map", [(parent, alone)])
            try:
                yaml_load_typed(
                    schema=schema, data=yaml.serialize(alone), defaults=defaults or schema()
                )
            except Exception:
                path.append(key)
                node = value
                break
        else:
            break
    return ".".join(str(key.value) for key in path) + ": " if path else ""
