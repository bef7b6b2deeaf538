"""Directive ``example``: shows a script of the folder ``examples`` with its text and its output.

The script's docstring says what it does; what it prints is the indented block at its end, after a
line ``Prints:``. Tests run the script and compare.
"""

import os
from pathlib import Path

from docutils import nodes
from example_parts import parts
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

EXAMPLES = Path(__file__).parents[2] / "examples"


class Example(SphinxDirective):
    """Shows a script; the argument is its name without suffix."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Returns text, code and output."""
        path = EXAMPLES / f"{self.arguments[0]}.py"
        if not path.is_file():
            raise self.error(f"example: there is no {path}")
        self.env.note_dependency(str(path))
        text, code, output = parts(path.read_text())
        here = Path(self.env.doc2path(self.env.docname)).parent
        link = f"{{download}}`examples/{path.name} <{os.path.relpath(path, here)}>`:"
        return [
            *self.parse_text_to_nodes(f"{text}\n\n{link}"),
            _block(code, "python"),
            *([nodes.paragraph("", "It prints"), _block(output, "text")] if output else []),
        ]


def _block(text: str, language: str) -> nodes.literal_block:
    return nodes.literal_block(text, text, language=language)


def setup(app: Sphinx) -> dict[str, bool]:
    """Adds the directive."""
    app.add_directive("example", Example)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
