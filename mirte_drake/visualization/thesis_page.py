"""Figures of the thesis drawn again: files for a paper, and a page that says what is whose."""

import dataclasses as dc
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from mirte_drake.visualization.page import Page, save_page
from mirte_drake.visualization.style import FORMATS, write_figures

INDEX_FILE = "index.html"


@dc.dataclass(frozen=True)
class Table:
    """Numbers to compare."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]  # The first cell of each is its name.


@dc.dataclass(frozen=True)
class ThesisFigure:
    """A figure with its caption."""

    number: str  # As 4-2.
    title: str
    parts: Mapping[str, tuple[str, Callable[[], Figure]]]  # What it shows and how, by its letter.
    ours: str  # Sentences.
    published: str
    table: Table | None = None

    def files(self) -> list[str]:
        """Names of the files without suffix, one for each part."""
        return [f"figure_{self.number}{letter}" for letter in self.parts]


def figure_files(numbers: Mapping[str, int]) -> list[str]:
    """Returns the names of all files of figures, by their number and how many parts they have."""
    return [
        f"figure_{number}{letter}.{suffix}"
        for number, count in numbers.items()
        for letter in "abcd"[:count]
        for suffix in FORMATS
    ]


def save_thesis_figure(figure: ThesisFigure, folder: Path) -> list[Path]:
    """Writes each part of a figure as PDF, SVG and PNG.

    Raises:
        UserError: when the folder cannot be written.
    """
    draw = [draw for _, draw in figure.parts.values()]
    return write_figures(dict(zip(figure.files(), draw, strict=True)), folder)


def save_thesis_page(
    figures: Sequence[ThesisFigure], missing: Sequence[str], versions: Mapping[str, str],
    folder: Path,
) -> Path:  # fmt: skip
    """Writes the page of figures with their captions and returns its path.

    Args:
        figures: The figures.
        missing: Numbers of those that need recordings which are not there.
        versions: That the numbers depend on.
        folder: Where to.

    Raises:
        UserError: when the folder cannot be written.
    """
    page = Page()
    text = page.render(
        "thesis.html",
        kicker="mirte_drake: the thesis's figures again",
        title="From recordings and from our runs",
        missing=missing,
        versions=versions,
        figures=[
            {
                "number": figure.number,
                "title": figure.title,
                "ours": figure.ours,
                "published": figure.published,
                "table": figure.table,
                "parts": [
                    {
                        "letter": letter,
                        "shows": shows,
                        "svg": page.plot(draw, f"Figure {figure.number}{letter}: {shows}"),
                    }
                    for letter, (shows, draw) in figure.parts.items()
                ],
            }
            for figure in figures
        ],
    )
    return save_page(text, folder / INDEX_FILE)
