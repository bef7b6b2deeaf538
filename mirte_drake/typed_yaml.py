"""Typed YAML: dataclasses to text and back, with errors that a user can mend."""

import dataclasses as dc
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from mirte_drake.errors import UserError
from mirte_drake.files import read_text, replacing

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
    except yaml.YAMLError as error:
        raise UserError(f"{origin}: not valid YAML: {_one_line(error)}") from None
    except (
        RuntimeError,
        ValueError,
        TypeError,
        AssertionError,
        LookupError,
        AttributeError,
    ) as error:
        field = _field_that_fails(schema, root, defaults or schema())
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


def write_typed(value: Any, path: Path) -> None:  # noqa: ANN401
    """Writes a dataclass as a YAML file, complete or not at all."""
    root = yaml.compose(yaml_dump_typed(value), Loader=yaml.SafeLoader)
    _complete(root, value)
    with replacing(path) as temporary:
        temporary.write_text(yaml.serialize(root), encoding="utf-8")


def _complete(node: yaml.MappingNode, value: Any) -> None:  # noqa: ANN401
    """Adds the fields that are None, and restores the order of dictionaries.

    Drake leaves the former out, except where the field can be of several kinds, and would load
    their defaults; the latter it sorts by name.
    """
    children = {key.value: child for key, child in node.value}
    if isinstance(value, dict):
        order = list(value)
        node.value.sort(key=lambda item: order.index(item[0].value))
        items: Any = value.items()
    else:
        items = [(field.name, getattr(value, field.name)) for field in dc.fields(value)]
    for name, item in items:
        if item is None and name not in children:
            key = yaml.ScalarNode("tag:yaml.org,2002:str", name)
            node.value.append((key, yaml.ScalarNode("tag:yaml.org,2002:null", "null")))
        elif isinstance(children.get(name), yaml.MappingNode):
            _complete(children[name], item)


def _compose(text: str, origin: str) -> yaml.MappingNode:
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f", line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or _one_line(error)
        raise UserError(f"{origin}{line}: not valid YAML: {problem}") from None
    except RecursionError:
        raise UserError(f"{origin}: not valid YAML: nested too deeply") from None
    if not isinstance(root, yaml.MappingNode):
        raise UserError(f"{origin}: must be a YAML mapping of field: value")
    _check_keys(root, origin, ())
    return root


def _check_keys(node: yaml.Node, origin: str, parents: tuple[yaml.Node, ...]) -> None:
    """Checks that keys are names, that none stands twice, and that no node contains itself."""
    if node in parents:
        raise UserError(f"{origin}: not valid YAML: a value contains itself")
    if not isinstance(node, yaml.CollectionNode):
        return
    children = node.value
    if isinstance(node, yaml.MappingNode):
        names = []
        for key, _ in node.value:
            if key.tag != "tag:yaml.org,2002:str":
                raise UserError(f"{origin}, line {key.start_mark.line + 1}: a key must be a name")
            if key.value in names:
                raise UserError(f"{origin}: {key.value}: stands twice; remove one")
            names.append(key.value)
        children = [value for _, value in node.value]
    for child in children:
        _check_keys(child, origin, (*parents, node))


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _field_that_fails(schema: type, root: yaml.MappingNode, defaults: object) -> str:
    """Names the innermost field that alone brings the error about, as ``a.b: ``."""
    path: list[yaml.Node] = []

    def fails(key: yaml.Node, value: yaml.Node) -> bool:
        for name in reversed([*path, key]):
            value = yaml.MappingNode("tag:yaml.org,2002:map", [(name, value)])
        try:
            yaml_load_typed(schema=schema, data=yaml.serialize(value), defaults=defaults)
        except Exception:
            return True
        return False

    node: yaml.Node = root
    while isinstance(node, yaml.MappingNode):
        found = next(((key, value) for key, value in node.value if fails(key, value)), None)
        if found is None:
            break
        key, node = found
        # Where not even an empty mapping fits, the field itself is wrong, not what is in it.
        wrong = isinstance(node, yaml.MappingNode) and fails(key, yaml.MappingNode(node.tag, []))
        path.append(key)
        if wrong:
            break
    return ".".join(key.value for key in path) + ": " if path else ""
