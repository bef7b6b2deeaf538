"""Formulas as SVG, drawn while the site is built: pages need no script, font or network for them.

A label is the number that a formula carries, as the thesis has it: ``$$ a = b $$ (4-19)``.
"""

from html import escape

import ziamath
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

SIZE = 17  # [px]

ziamath.config.svg2 = False  # Paths stand for themselves, so that many may be on one page.


def formula(latex: str, *, inline: bool) -> str:
    """Returns the SVG of a formula in the colour of the text around it."""
    drawn = ziamath.Latex(latex, size=SIZE, color="currentColor", inline=inline)
    svg = drawn.svg().replace('xmlns:xlink="http://www.w3.org/1999/xlink" ', "")
    style = f' style="vertical-align:{drawn.getyofst():.2f}px"' if inline else ""
    return svg.replace(
        "<svg ", f'<svg class="math" role="img" aria-label="{escape(latex)}"{style} '
    )


def visit_inline(writer: HTML5Translator, node: nodes.math) -> None:
    """Writes a formula within text."""
    writer.body.append(formula(node.astext(), inline=True))
    raise nodes.SkipNode


def visit_block(writer: HTML5Translator, node: nodes.math_block) -> None:
    """Writes a formula on a line of its own, with its number."""
    writer.body.append('<div class="math">' + formula(node.astext(), inline=False))
    if node.get("label"):
        writer.body.append(f'<span class="number">({escape(node["label"])})</span>')
    writer.body.append("</div>")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Adds the renderer and uses it."""
    app.add_html_math_renderer("static", (visit_inline, None), (visit_block, None))
    app.config.html_math_renderer = "static"
    return {"parallel_read_safe": True, "parallel_write_safe": True}
