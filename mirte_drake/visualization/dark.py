"""Pictures on a dark screen: hue and colourfulness stay, lightness is turned round."""

import colorsys
import re

_PAPER, _INK = 0.10, 0.93  # Lightness of what is white and of what is black on a light screen.


def dark_color(color: str) -> str:
    """Returns the colour on a dark screen of one on a light screen; both as #rrggbb."""
    rgb = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    hue, lightness, _ = colorsys.rgb_to_hls(*rgb)
    lightness = _INK + (_PAPER - _INK) * lightness
    # As colourful as before: saturation would make what is pale glow.
    saturation = min((max(rgb) - min(rgb)) / (1 - abs(2 * lightness - 1)), 1.0)
    turned = colorsys.hls_to_rgb(hue, lightness, saturation)
    return "#" + "".join(f"{round(255 * part):02x}" for part in turned)


def dark_rules(svg: str, scope: str = "") -> str:
    """Returns the CSS rules that show an SVG picture's colours as ``dark_color`` has them.

    Args:
        svg: One picture, or several behind each other. Colours stand as #rrggbb in attributes
            (``fill="#ffffff"``, Graphviz) or styles (``fill: #ffffff``, Matplotlib).
        scope: Selector of what the rules are for.
    """
    # Of what says no colour, which is black.
    rules = [f":where({scope or 'svg'}) :is(text, use) {{fill: {dark_color('#000000')}}}"]
    for what, color in sorted(set(re.findall(r'\b(fill|stroke)(?:="|: ?)(#[0-9a-f]{6})', svg))):
        selectors = (f'[{what}="{color}"]', f'[style*="{what}: {color}"]')
        both = ", ".join(f"{scope} {selector}".lstrip() for selector in selectors)
        rules.append(f"{both} {{{what}: {dark_color(color)} !important}}")
    return "\n".join(rules)


def dark_media(rules: str) -> str:
    """Returns CSS rules made to hold on a dark screen only, not on paper."""
    return f"@media screen and (prefers-color-scheme: dark) {{\n{rules}\n}}\n"


def with_dark_style(svg: str) -> str:
    """Returns an SVG file that adapts itself to a light or a dark screen."""
    start = svg.index(">", svg.index("<svg")) + 1
    style = f"\n<style>\n{dark_media(dark_rules(svg))}</style>"
    return f"{svg[:start]}{style}{svg[start:]}"
