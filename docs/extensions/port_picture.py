"""Directive ``pydrake_system``: draws a system as a block with its ports.

Drake's docstrings have it, with the content

    name: TubeUpdater
    input_ports:
    - designs
    output_ports:
    - half_width
"""

from html import escape

import yaml
from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx

ROW, CHARACTER, PADDING, WIRE = 26, 7.9, 16, 34  # [px]
ARROW = 7  # [px]


def port_picture(name: str, inputs: list[str], outputs: list[str]) -> str:
    """Returns the SVG of a block; its colours are those of the page."""
    left, right = (max(map(len, ports), default=0) * CHARACTER for ports in (inputs, outputs))
    block = max(left + right + 3 * PADDING, len(name) * 1.15 * CHARACTER + 2 * PADDING)
    height = ROW * (max(len(inputs), len(outputs), 1) + 1.5)
    x0, x1 = WIRE, WIRE + block
    parts = [
        f'<rect x="{x0}" y="1" width="{block:.0f}" height="{height:.0f}" rx="6"/>',
        f'<text class="name" x="{(x0 + x1) / 2:.0f}" y="{0.9 * ROW:.0f}">{escape(name)}</text>',
    ]
    for ports, wire, text, anchor in (
        (inputs, (0, x0), x0 + PADDING, "start"),
        (outputs, (x1, x1 + WIRE), x1 - PADDING, "end"),
    ):
        # Both sides begin at the same height, as far below the name as the last is from the edge.
        for row, port in enumerate(ports):
            y = ROW * (row + 1.75)
            tip = wire[1] - 1
            parts += [
                f'<path d="M{wire[0]:.0f} {y:.0f}H{tip - ARROW:.0f}"/>',
                f'<path class="tip" d="M{tip:.0f} {y:.0f}l-{ARROW + 2} -4v8z"/>',
                f'<text x="{text:.0f}" y="{y + 4:.0f}" text-anchor="{anchor}">'
                f"{escape(port)}</text>",
            ]
    size = f"{x1 + WIRE:.0f} {height + 2:.0f}".split()
    label = f"{name}: inputs {', '.join(inputs) or 'none'}; outputs {', '.join(outputs) or 'none'}"
    return (
        f'<svg class="port-picture" role="img" aria-label="{escape(label)}" '
        f'width="{size[0]}" height="{size[1]}" viewBox="0 0 {size[0]} {size[1]}">'
        f"{''.join(parts)}</svg>"
    )


class PydrakeSystem(Directive):
    """Draws the block; see the module."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Returns the picture."""
        system = yaml.safe_load("\n".join(self.content))
        unknown = set(system) - {"name", "input_ports", "output_ports"}
        if unknown:
            raise self.error(f"pydrake_system: unknown keys {sorted(unknown)}")
        svg = port_picture(
            system["name"], system.get("input_ports", []), system.get("output_ports", [])
        )
        return [nodes.raw("", f'<div class="port-picture">{svg}</div>', format="html")]


def setup(app: Sphinx) -> dict[str, bool]:
    """Adds the directive."""
    app.add_directive("pydrake_system", PydrakeSystem)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
