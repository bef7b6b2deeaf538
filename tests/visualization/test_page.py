import base64
import io
import re
from html.parser import HTMLParser

import pytest
from fontTools.ttLib import TTFont
from jinja2 import UndefinedError
from matplotlib.figure import Figure

from mirte_drake.errors import UserError
from mirte_drake.visualization.page import Page, save_page


def draw():
    figure = Figure(figsize=(3, 2))
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], "o-", color="black", label="Ωmega <&>")
    axes.set_xlabel("$x$ 0.123456 [m]")
    axes.legend()
    return figure


def rendered(page, **values):
    return page.render("base.html", title="A title", kicker="test", **values)


def test_text_in_figures_is_text_as_it_was_given():
    svg = Page().plot(draw, "a line")
    assert "0.123456 [m]" in re.sub(r"<[^>]*>|\s+", "", svg).replace("0.123456[m]", "0.123456 [m]")
    assert "Ωmega &lt;&amp;&gt;" in svg
    assert not re.search(r'[xy]="\d+\.\d{3,}"', svg), "coordinates are short"


def test_figures_say_what_they_show_to_those_who_cannot_see_them():
    svg = Page().plot(draw, 'a "line" & more')
    assert svg.startswith('<svg role="img" aria-label="a &quot;line&quot; &amp; more"')


def test_names_in_a_page_differ_and_references_find_them():
    page = Page()
    text = page.plot(draw, "one") + page.plot(draw, "two")
    names = re.findall(r'\bid="([^"]*)"', text)
    assert len(set(names)) == len(names) > 10
    references = re.findall(r'(?:url\(|href=")#([^")]*)', text)
    assert len(references) > 4 and set(references) <= set(names)


def test_no_marker_has_colours_that_no_style_reaches():
    svg = Page().plot(draw, "a line")
    assert re.search(r'<use [^>]*style="[^"]*stroke: #000000', svg)
    assert not re.search(r'<path id="[^"]*"[^>]*style', svg)


def test_the_font_of_the_figures_travels_in_the_page():
    page = Page()
    page.plot(draw, "a line")
    fonts = re.findall(
        r"font-style: (\w+); src: url\(\"data:font/woff;base64,([^\"]*)", rendered(page)
    )
    assert [style for style, _ in fonts] == ["normal", "italic"]
    letters = TTFont(io.BytesIO(base64.b64decode(fonts[0][1]))).getBestCmap()
    assert {ord(letter) for letter in "Ωmega 0123456[m]"} <= letters.keys()
    assert ord("Q") not in letters
    assert len(fonts[0][1]) < 10_000


def test_a_page_adapts_to_a_dark_screen():
    page = Page()
    page.plot(draw, "a line")
    text = rendered(page)
    assert "color-scheme: light dark" in text
    assert 'figure [style*="stroke: #000000"] {stroke: #' in text


class Outside(HTMLParser):
    """Collects what a page would load, and what would run."""

    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        if tag == "script" or any(name.startswith("on") for name in values):
            self.found.append(tag)
        self.found += [
            values[name]
            for name in ("src", "href", "xlink:href")
            if not values.get(name, "#").startswith(("#", "data:"))
        ]


def test_a_page_asks_for_nothing_and_runs_nothing():
    page = Page()
    page.plot(draw, "a line")
    text = rendered(page)
    parser = Outside()
    parser.feed(text)
    assert parser.found == []
    assert all(url.startswith(("#", '"data:')) for url in re.findall(r"url\(([^)]*)", text))


def test_what_is_filled_in_is_text():
    text = Page().render("base.html", title="<script>alert(1)</script>", kicker="test")
    assert "<script>" not in text and "&lt;script&gt;" in text


def test_a_forgotten_value_is_an_error():
    with pytest.raises(UndefinedError, match="kicker"):
        Page().render("base.html", title="A title")


def test_the_same_page_is_the_same_text():
    def text():
        page = Page()
        page.plot(draw, "a line")
        return rendered(page)

    assert text() == text()


def test_a_page_is_written_or_named(tmp_path):
    path = save_page("<p>θ</p>", tmp_path / "new" / "page.html")
    assert path.read_text(encoding="utf-8") == "<p>θ</p>"
    with pytest.raises(UserError, match="cannot be written"):
        save_page("", type(path)("/dev/null/page.html"))


def test_a_picture_of_another_maker_keeps_its_references():
    svg = '<?xml version="1.0"?><svg><g id="a"/><use href="#a"/><g clip-path="url(#a)"/></svg>'
    picture = Page().picture(svg, "blocks")
    assert picture == (
        '<svg role="img" aria-label="blocks"><g id="f1-a"/><use href="#f1-a"/>'
        '<g clip-path="url(#f1-a)"/></svg>'
    )
