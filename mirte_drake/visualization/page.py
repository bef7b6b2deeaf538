"""Pages that stand for themselves: one HTML file, figures as SVG with text, no request, no script.

Figures keep their font, since it travels in the page, and adapt to a light or a dark screen.
"""

import base64
import html
import io
import itertools
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jinja2
import matplotlib
from markupsafe import Markup
from matplotlib.figure import Figure

from mirte_drake.files import replacing
from mirte_drake.visualization.dark import dark_media, dark_rules
from mirte_drake.visualization.style import RC_PARAMS

# All text is filled in as text: a template says what is more than that.
_TEMPLATES = jinja2.Environment(
    loader=jinja2.FileSystemLoader(Path(__file__).parent / "templates"),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_FACES = (("STIXGeneral", "normal"), ("STIXGeneralItalic", "italic"))  # Of RC_PARAMS.


class Page:
    """A page that is being filled: makes its figures, whose colours and letters it remembers."""

    def __init__(self) -> None:
        """Begins without figures."""
        self._figures = ""
        self._count = itertools.count(1)

    def plot(self, draw: Callable[[], Figure], label: str) -> Markup:
        """Returns a Matplotlib figure as SVG with selectable text.

        Args:
            draw: Draws it.
            label: What it shows, for those who cannot see it.
        """
        file = io.StringIO()
        nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        with matplotlib.rc_context({**RC_PARAMS, "svg.fonttype": "none"}):
            draw().savefig(file, format="svg", metadata=nothing, bbox_inches="tight")
        svg = re.sub("<[^>]*>", _shorter, file.getvalue())
        # A marker has its colours where it is used. Those of its definition no style could reach.
        svg = re.sub(r'(<path id="[^"]*" d="[^"]*") style="[^"]*"', r"\1", svg)
        return self.picture(svg, label)

    def picture(self, svg: str, label: str) -> Markup:
        """Returns an SVG file as a part of the page.

        Args:
            svg: The file's text.
            label: As in ``plot``.
        """
        svg = svg[svg.index("<svg") :]
        # Names in a page must differ from figure to figure.
        name = f"f{next(self._count)}-"
        svg = re.sub(r'\bid="', f'id="{name}', svg)
        svg = re.sub(r'(url\(|href=")#', rf"\1#{name}", svg)
        svg = svg.replace("<svg", f'<svg role="img" aria-label="{html.escape(label)}"', 1)
        self._figures += svg
        return Markup(svg)

    def render(self, template: str, **values: Any) -> str:  # noqa: ANN401 what templates show
        """Returns the page of a template in ``templates``, filled in with ``values``."""
        text = _TEMPLATES.get_template(template).render(values, page=self)
        return re.sub(r"\n\s*\n", "\n", text)

    @property
    def figure_style(self) -> Markup:
        """CSS of the figures: their font and their colours on a dark screen."""
        return Markup(_font_faces(self._figures) + dark_media(dark_rules(self._figures, "figure")))


def save_page(text: str, path: Path) -> Path:
    """Writes a page, complete or not at all, and returns its path.

    Raises:
        UserError: when it cannot be written.
    """
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def _shorter(tag: re.Match[str]) -> str:
    """Returns a tag whose numbers end at a hundredth of a point, finer than any screen."""
    return re.sub(r"(\d\.\d\d)\d+", r"\1", tag.group())


def _font_faces(figures: str) -> str:
    """Returns CSS with those letters of the figures' fonts that the figures need."""
    from fontTools import subset

    letters = {ord(letter) for letter in html.unescape(re.sub("<[^>]*>", "", figures))}
    rules = []
    for name, style in _FACES:
        options = subset.Options(flavor="woff", hinting=False, layout_features=[])
        options.drop_tables += ["FFTM"]
        font = subset.load_font(f"{matplotlib.get_data_path()}/fonts/ttf/{name}.ttf", options)
        subsetter = subset.Subsetter(options)
        subsetter.populate(unicodes=letters)
        subsetter.subset(font)
        file = io.BytesIO()
        subset.save_font(font, file, options)
        data = base64.b64encode(file.getvalue()).decode()
        rules.append(
            f'@font-face {{font-family: "{_FACES[0][0]}"; font-style: {style}; '
            f'src: url("data:font/woff;base64,{data}") format("woff")}}\n'
        )
    return "".join(rules)
