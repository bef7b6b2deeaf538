import re

import pytest

from mirte_drake.visualization.dark import dark_color, dark_media, dark_rules, with_dark_style


def parts(color):
    return [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]


def luminance(color):
    """Relative luminance as WCAG defines it."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts(color)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, other):
    high, low = sorted((luminance(one), luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_black_and_white_change_places():
    assert luminance(dark_color("#ffffff")) < 0.02
    assert luminance(dark_color("#000000")) > 0.8


# Of text and lines: the figures' lines, the diagrams' lines and texts.
@pytest.mark.parametrize(
    "color",
    ["#000000", "#b2182b", "#2166ac", "#1b7837", "#762a83", "#b35806", "#d6604d", "#33507f",
     "#96591a", "#2c6e3f", "#4a5568"],
)  # fmt: skip
def test_what_is_readable_on_white_is_readable_on_dark_paper(color):
    assert contrast(color, "#ffffff") >= 3
    assert contrast(dark_color(color), dark_color("#ffffff")) >= 3


def test_a_colour_stays_as_colourful_and_of_its_hue():
    light, dark = parts("#dbe6f6"), parts(dark_color("#dbe6f6"))
    assert max(dark) - min(dark) == pytest.approx(max(light) - min(light), abs=0.01)
    assert sorted(range(3), key=light.__getitem__) == sorted(range(3), key=dark.__getitem__)


def test_rules_are_for_attributes_and_styles():
    svg = '<path fill="#ffffff" stroke="#33415c"/><path style="fill: #ffffff; stroke: #e0e0e0"/>'
    rules = dark_rules(svg, ".plot").splitlines()
    assert rules[0].startswith(":where(.plot) :is(text, use) {fill: ")
    fill = dark_color("#ffffff")
    assert (
        f'.plot [fill="#ffffff"], .plot [style*="fill: #ffffff"] {{fill: {fill} !important}}'
        in rules
    )
    assert [re.findall("(fill|stroke): #", rule)[0] for rule in rules[1:]] == [
        "fill", "stroke", "stroke"
    ]  # fmt: skip


def test_a_file_adapts_itself_on_a_screen():
    svg = '<?xml version="1.0"?>\n<svg width="8pt">\n<path fill="#ffffff"/>\n</svg>\n'
    adaptive = with_dark_style(svg)
    style = dark_media(dark_rules(svg))
    assert style.startswith("@media screen and (prefers-color-scheme: dark)")
    assert adaptive == svg.replace('"8pt">', f'"8pt">\n<style>\n{style}</style>')
