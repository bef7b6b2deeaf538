"""The picture of a Diagram: blocks, signals by name, nested Diagrams as frames.

Drake's own Graphviz text shows every port as a table cell, which is exact but hard to take in.
Here each connection is an arrow labelled with the signal, and parallel connections are one arrow.
The longest way forward is a straight line; feedback runs above and below it. Controller, robot and
wire have their colours.
"""

import dataclasses as dc
import functools
import itertools
import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path

from pydrake.systems.framework import Diagram, InputPortIndex, OutputPortIndex, System

from mirte_drake.files import replacing
from mirte_drake.visualization.dark import with_dark_style

_ACRONYMS = {"nmpc": "NMPC", "dlqr": "DLQR", "sindyc": "SINDYc", "lcm": "LCM", "ros2": "ROS 2"}

Endpoint = tuple[System, int]
Signals = dict[tuple[str, str], list[str]]  # Labels of the arrow between two blocks.


@dc.dataclass(frozen=True)
class _Colors:
    """Of the blocks of one part, and of the frame around them."""

    block: str
    line: str
    frame: str


# By the beginning and end of a system's name, the first that fits. Every block is filled, so that
# it is readable on any background, and parts differ in lightness, for black and white.
_PARTS = (
    (r"(lcm|ros2)_robot$", _Colors("#d5ecd9", "#2c6e3f", "#eff8f0")),  # The wire.
    (r"robot$", _Colors("#fbe3c4", "#96591a", "#fdf4e7")),
    (r"^controller$", _Colors("#dbe6f6", "#33507f", "#f2f6fc")),
    (r"", _Colors("#f1f1ee", "#55585e", "#fafaf8")),
)
_GRAPH = (
    'graph [rankdir=LR, nodesep=0.5, ranksep=0.55, fontname="Helvetica", fontsize=15, '
    'bgcolor="#ffffff", pad=0.25, splines=spline];',
    'node [shape=box, style="filled,rounded", fontname="Helvetica", fontsize=13, '
    'margin="0.22,0.13", penwidth=1.2];',
    'edge [fontname="Helvetica", fontsize=11, color="#33415c", arrowsize=0.8];',
)


def diagram_dot(diagram: Diagram, depth: int = 2) -> str:
    """Returns the DOT text of a Diagram, the same for the same Diagram.

    Args:
        diagram: What to draw.
        depth: 1 shows the Diagram's systems; 2 looks into Diagrams among them; and so on.

    Raises:
        ValueError: when depth < 1.
    """
    if depth < 1:
        raise ValueError(f"depth: must be >= 1, got {depth}")
    names: dict[System, str] = {}
    blocks = _draw(diagram, depth, names, _colors(diagram.get_name()))
    signals: Signals = defaultdict(list)
    for source, target, label in _connections(diagram, depth):
        labels = signals[names[source], names[target]]
        if label not in labels:
            labels.append(label)
    start = f'digraph "{diagram.get_name()}" {{'
    return "\n".join([start, *_GRAPH, *blocks, *_arrows(names.values(), signals), "}"]) + "\n"


def diagram_svg(diagram: Diagram, depth: int = 2) -> str:
    """Returns the picture as SVG; arguments as ``diagram_dot``."""
    return _graphviz(diagram_dot(diagram, depth), "svg").decode()


def save_diagram_picture(diagram: Diagram, stem: Path, depth: int = 2) -> list[Path]:
    """Writes the picture as SVG, PNG and DOT beside each other.

    The SVG adapts itself to a light or a dark screen.

    Args:
        diagram: What to draw.
        stem: Path without suffix.
        depth: As ``diagram_dot``.

    Returns:
        The files written.

    Raises:
        UserError: when the folder cannot be written.
    """
    dot = diagram_dot(diagram, depth)
    pictures = {
        "svg": with_dark_style(_graphviz(dot, "svg").decode()).encode(),
        "png": _graphviz(dot, "png", "-Gdpi=160"),
        "dot": dot.encode(),
    }
    paths = []
    for suffix, picture in pictures.items():
        path = stem.with_name(f"{stem.name}.{suffix}")
        with replacing(path) as temporary:
            temporary.write_bytes(picture)
        paths.append(path)
    return paths


def _graphviz(dot: str, picture_format: str, arguments: str = "") -> bytes:
    import pygraphviz  # Loads Graphviz: only for those who draw.

    # Drawn to memory: pygraphviz cannot open a file under Python 3.11.2, Debian 12's.
    return pygraphviz.AGraph(string=dot).draw(None, picture_format, "dot", arguments)


def _draw(
    diagram: Diagram, depth: int, names: dict[System, str], outer: _Colors, path: str = ""
) -> list[str]:
    """Returns the lines that draw the systems, and enters their names."""
    lines = []
    for system in diagram.GetSystems():
        names[system] = name = f"{path}{system.get_name()}"
        title = _title(system.get_name())
        colors = outer if path else _colors(system.get_name(), outer)
        if isinstance(system, Diagram) and depth > 1:
            inner = _draw(system, depth - 1, names, colors, f"{name}/")
            lines += [
                f'subgraph "cluster_{name}" {{',
                f'label="{title}"; labeljust=l; style="filled,rounded"; '
                f'fillcolor="{colors.frame}"; color="{colors.line}"; fontcolor="{colors.line}";',
                *inner,
                "}",
            ]
        else:
            kind = re.sub(r"(_\[|<).*", "", re.split(r"::|\.", system.GetSystemType())[-1])
            lines.append(
                f'"{name}" [label=<<b>{title}</b><br/><font point-size="10" color="#4a5568">'
                f'{kind}</font>>, fillcolor="{colors.block}", color="{colors.line}"];'
            )
    return lines


def _colors(name: str, otherwise: _Colors = _PARTS[-1][1]) -> _Colors:
    found = [colors for pattern, colors in _PARTS[:-1] if re.search(pattern, name)]
    return found[0] if found else otherwise


def _arrows(blocks: Iterable[str], signals: Signals) -> list[str]:
    """Returns the lines that draw the connections, and align the longest way forward."""
    feedback = _feedback(blocks, signals)
    forward = sorted(signals.keys() - feedback)
    row = _longest_way(forward)
    lines = [f'"{name}" [group=row];' for name in row]
    for (source, target), labels in sorted(signals.items()):
        label = "\\n".join(label.replace("_", " ") for label in labels)
        if (source, target) in feedback:
            # Drawn as if it ran forward: so it gets its own way between the blocks, and does not
            # decide who stands where.
            lines.append(f'"{target}" -> "{source}" [label="{label}", dir=back, weight=0];')
        else:
            straight = ", weight=100" if (source, target) in itertools.pairwise(row) else ""
            lines.append(f'"{source}" -> "{target}" [label="{label}"{straight}];')
    return lines


def _longest_way(arrows: Sequence[tuple[str, str]]) -> tuple[str, ...]:
    """Returns the blocks on the longest way along arrows that close no loop."""

    @functools.cache
    def way(name: str) -> tuple[str, ...]:
        ways = [way(target) for source, target in arrows if source == name]
        return (name, *max(ways, key=len, default=()))

    return max((way(source) for source, _ in arrows), key=len, default=())


def _connections(diagram: Diagram, depth: int) -> list[tuple[System, System, str]]:
    """Returns (source, target, signal) for all connections down to a depth."""
    result = []
    for (system, index), (source, output) in diagram.connection_map().items():
        leaf, port = _resolve_output(source, output, depth)
        for target in _resolve_inputs(system, index, depth):
            label = leaf.get_output_port(OutputPortIndex(port)).get_name()
            if label in ("y0", "y", "message"):  # Says nothing: take the name of what it feeds.
                label = target[0].get_input_port(InputPortIndex(target[1])).get_name()
            result.append((leaf, target[0], label))
    for system in diagram.GetSystems():
        if isinstance(system, Diagram) and depth > 1:
            result += _connections(system, depth - 1)
    return result


def _resolve_output(system: System, index: int, depth: int) -> Endpoint:
    while isinstance(system, Diagram) and depth > 1:
        system, index = system.get_output_port_locator(OutputPortIndex(index))
        depth -= 1
    return system, int(index)


def _resolve_inputs(system: System, index: int, depth: int) -> list[Endpoint]:
    if not isinstance(system, Diagram) or depth <= 1:
        return [(system, int(index))]
    locators = system.GetInputPortLocators(InputPortIndex(index))
    return [end for inner, port in locators for end in _resolve_inputs(inner, port, depth - 1)]


def _feedback(names: Iterable[str], signals: Iterable[tuple[str, str]]) -> set[tuple[str, str]]:
    """Returns the arrows that close a loop.

    Those are what a robot gives to a controller, and beside them what closes a loop seen from the
    blocks that nothing feeds.
    """
    back = {(source, target) for source, target in signals if _measures(source, target)}
    successors: dict[str, list[str]] = {name: [] for name in names}
    for source, target in set(signals) - back:
        successors[source].append(target)
    fed = {target for targets in successors.values() for target in targets}
    done: set[str] = set()

    def visit(name: str, path: tuple[str, ...]) -> None:
        for target in sorted(successors[name]):
            if target in path:
                back.add((name, target))
            elif target not in done:
                visit(target, (*path, target))
        done.add(name)

    for name in sorted(successors, key=lambda name: name in fed):
        if name not in done:
            visit(name, (name,))
    return back


def _measures(source: str, target: str) -> bool:
    """Tells whether an arrow goes from a robot to a controller."""
    outer_source, outer_target = source.split("/")[0], target.split("/")[0]
    return outer_source.endswith("robot") and outer_target == "controller"


def _title(name: str) -> str:
    words = [_ACRONYMS.get(word, word) for word in name.split("_")]
    return " ".join([words[0][0].upper() + words[0][1:], *words[1:]])
