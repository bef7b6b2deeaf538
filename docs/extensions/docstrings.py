"""Makes our docstrings what Sphinx expects, and gives dataclasses a list of their fields.

Docstrings are written to be read in the source: |K| d is an absolute value there, and an indented
block a formula or an example. What a field means is said in a comment beside it.
"""

import ast
import dataclasses as dc
import importlib
import inspect
import io
import re
import textwrap
import tokenize
from typing import Any

import numpy as np
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

INDENT = "    "


@dc.dataclass(frozen=True)
class Field:
    """One field of a dataclass, as its source has it."""

    name: str
    annotation: str
    default: str  # Empty: it must be given.
    comment: str


def dataclass_fields(cls: type) -> list[Field]:
    """Returns the public fields that a dataclass or NamedTuple declares itself."""
    source = textwrap.dedent(inspect.getsource(cls))
    comments = {
        token.start[0]: (token.string.lstrip("# "), not token.line[: token.start[1]].strip())
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type == tokenize.COMMENT and not token.string.startswith("# noqa")
    }
    tree = ast.parse(source).body[0]
    assert isinstance(tree, ast.ClassDef)
    declared = defaults(cls)
    fields = []
    for node in tree.body:
        if not isinstance(node, ast.AnnAssign) or not isinstance(node.target, ast.Name):
            continue
        name = node.target.id
        if name.startswith("_") or name not in declared:
            continue
        first = node.lineno
        while comments.get(first - 1, ("", False))[1]:
            first -= 1
        said = [comments[line][0] for line in range(first, node.end_lineno + 1) if line in comments]
        annotation = re.sub(r"\b(np|dc)\.", "", ast.unparse(node.annotation))
        fields.append(Field(name, annotation, declared[name], " ".join(said)))
    return fields


def defaults(cls: type) -> dict[str, str]:
    """Returns the default of every field as one would write it in YAML, where it is short."""
    if has_named_fields(cls):
        given = getattr(cls, "_field_defaults", {})
        return {name: yaml_text(given[name]) if name in given else "" for name in cls._fields}
    found = {}
    for field in dc.fields(cls):
        value = field.default_factory() if callable(field.default_factory) else field.default
        found[field.name] = "" if value is dc.MISSING else yaml_text(value)
    return found


def has_named_fields(item: object) -> bool:
    """Whether a class is a NamedTuple."""
    return isinstance(item, type) and issubclass(item, tuple) and hasattr(item, "_fields")


def has_fields(item: object) -> bool:
    """Whether a class is a dataclass or NamedTuple."""
    return isinstance(item, type) and (dc.is_dataclass(item) or has_named_fields(item))


def yaml_text(value: Any) -> str:  # noqa: ANN401
    """Returns a value in YAML; of a dataclass only its name."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, np.ndarray):
        return yaml_text(value.tolist())
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {yaml_text(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(yaml_text, value)) + "]"
    if dc.is_dataclass(value):
        return type(value).__name__
    if isinstance(value, float):
        return f"{value:.6g}"
    return str(value) if value != "" else '""'


def field_list(cls: type) -> list[str]:
    """Returns reStructuredText that lists the fields of a dataclass."""
    lines = []
    for field in dataclass_fields(cls):
        default = f", default ``{field.default}``" if field.default else ""
        lines += [f"``{field.name}`` : ``{field.annotation}``{default}"]
        lines += [INDENT + (escaped(field.comment.replace("*", r"\*")) or "\\ "), ""]
    return ["", ".. rst-class:: fields", "", *lines] if lines else []


def escaped(line: str) -> str:
    """Returns a line in which bars are bars, outside of ``literals``."""
    parts = line.split("``")
    parts[::2] = [re.sub(r"(?<!\\)\|", r"\|", part) for part in parts[::2]]
    return "``".join(parts)


def prepared(lines: list[str]) -> list[str]:
    """Returns a docstring in which indented blocks are literal and bars are bars."""
    out: list[str] = []
    before, literal, verbatim = "", False, False
    for line in lines:
        indented = line.startswith(INDENT)
        if line.strip() and not indented:
            literal = verbatim = False
        elif indented and not (literal or verbatim):
            # Content of a directive, or of a section as `Args:`, is no block of its own.
            verbatim = before.lstrip().startswith("..") or bool(out and out[-1].strip())
            if not verbatim:
                out += ["::", ""]
                literal = True
        out.append(line if literal else escaped(line))
        if not literal:  # A dash alone in a cell of a table begins no list.
            out[-1] = re.sub(r"(?<=  )- (?= )", r"\\-", out[-1])
        before = line if line.strip() else before
    return out


def process_docstring(
    app: Sphinx, what: str, name: str, item: object, options: object, lines: list[str]
) -> None:
    """Prepares the docstring, before other extensions see it."""
    lines[:] = prepared(lines)
    if what == "class" and has_fields(item):
        lines += field_list(item)


def set_dashes(app: Sphinx, doctree: nodes.document) -> None:
    """Sets the dashes behind parameters and exceptions, which Sphinx writes as two hyphens."""
    for text in list(doctree.findall(nodes.Text)):
        if text == " -- ":
            text.parent.replace(text, nodes.Text(" – "))


def process_signature(
    app: Sphinx, what: str, name: str, item: object, options: object, signature: str, result: str
) -> tuple[str, str] | None:
    """Leaves out the signature of a dataclass: its fields are listed."""
    if what == "class" and has_fields(item):
        return "", ""
    return None


def skip_member(
    app: Sphinx, what: str, name: str, item: object, skip: bool, options: object
) -> bool | None:
    """Leaves out what Python says about the fields of a NamedTuple."""
    return True if (getattr(item, "__doc__", None) or "").startswith("Alias for field") else None


class Fields(SphinxDirective):
    """Directive ``fields``: lists the fields of dataclasses, given by their dotted names."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        """Returns for each the name, what it says about itself, and its fields."""
        lines = []
        for name in self.arguments[0].split():
            module, _, member = name.rpartition(".")
            cls = getattr(importlib.import_module(module), member)
            says = escaped((inspect.getdoc(cls) or "").partition("\n\n")[0].replace("\n", " "))
            lines += [f":py:class:`{member} <{name}>`", INDENT + says, ""]
            lines += [INDENT + line if line else "" for line in field_list(cls)]
        return self.parse_text_to_nodes("\n".join(lines))


def setup(app: Sphinx) -> dict[str, bool]:
    """Connects both to autodoc."""
    app.setup_extension("sphinx.ext.autodoc")
    app.add_directive("fields", Fields)
    app.connect("autodoc-process-docstring", process_docstring, priority=400)
    app.connect("doctree-read", set_dashes)
    app.connect("autodoc-process-signature", process_signature)
    app.connect("autodoc-skip-member", skip_member)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
