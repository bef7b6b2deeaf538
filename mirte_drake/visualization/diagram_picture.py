"""The picture of a Diagram: blocks, signals by name, nested Diagrams as frames.

Drake's own Graphviz text shows every port as a table cell, which is exact but hard to take in.
Here each connection is an arrow labelled with the signal, and parallel connections are one arrow.
Systems with continuous states, the robots, have another colour.
"""

import re
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

from pydrake.systems.framework import Diagram, InputPortIndex, OutputPortIndex, System

from mirte_drake.files import replacing

FORMATS = ("svg", "png", "dot")

_ACRONYMS = {"nmpc": "NMPC", "dlqr": "DLQR", "sindyc": "SINDYc"}

Endpoint = tuple[System, int]

# Readable in black and white, on light and on dark backgrounds: every block is filled.
_GRAPH = (
    'graph [rankdir=LR, nodesep=0.55, ranksep=0.6, fontname="Helvetica", fontsize=15, '
    'bgcolor="white", pad=0.25, splines=spline];',
    'node [shape=box, style="filled,rounded", fillcolor="#e8eef7", color="#33415c", '
    'fontname="Helvetica", fontsize=13, margin="0.22,0.13", penwidth=1.2];',
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
    lines = ["digraph {", *_GRAPH, *_draw(diagram, depth, names)]
    signals: dict[tuple[str, str], list[str]] = defaultdict(list)
    for source, target, label in _connections(diagram, depth):
        labels = signals[names[source], names[target]]
        if label not in labels:
            labels.append(label)
    feedback = _feedback(names.values(), signals)
    for (source_name, target_name), labels in sorted(signals.items()):
        # Feedback runs right to left, so it must not decide who stands where.
        style = ", constraint=false" if (source_name, target_name) in feedback else ""
        label = "\\n".join(label.replace("_", " ") for label in labels)
        lines.append(f'"{source_name}" -> "{target_name}" [label="{label}"{style}];')
    return "\n".join([*lines, "}"]) + "\n"


def save_diagram_picture(diagram: Diagram, stem: Path, depth: int = 2) -> list[Path]:
    """Writes the picture as SVG, PNG and DOT beside each other.

    Args:
        diagram: What to draw.
        stem: Path without suffix.
        depth: As ``diagram_dot``.

    Returns:
        The files written.

    Raises:
        UserError: when the folder cannot be written.
    """
    import pygraphviz  # Loads Graphviz: only for those who draw.

    dot = diagram_dot(diagram, depth)
    paths = [stem.with_name(f"{stem.name}.{suffix}") for suffix in FORMATS]
    graph = pygraphviz.AGraph(string=dot)
    for path in paths:
        with replacing(path) as temporary:
            suffix = path.suffix.removeprefix(".")
            # Drawn to memory: pygraphviz cannot open a file under Python 3.11.2, Debian 12's.
            args = "-Gdpi=160" if suffix == "png" else ""
            picture = dot.encode() if suffix == "dot" else graph.draw(None, suffix, "dot", args)
            temporary.write_bytes(picture)
    return paths


def _draw(diagram: Diagram, depth: int, names: dict[System, str], path: str = "") -> list[str]:
    """Returns the lines that draw the systems, and enters their names."""
    lines = []
    for system in diagram.GetSystems():
        names[system] = name = f"{path}{system.get_name()}"
        title = _title(system.get_name())
        if isinstance(system, Diagram) and depth > 1:
            inner = _draw(system, depth - 1, names, f"{name}/")
            lines += [
                f'subgraph "cluster_{name}" {{',
                f'label="{title}"; labeljust=l; style="filled,rounded"; '
                'fillcolor="#f6f6f2"; color="#8a8f98";',
                *inner,
                "}",
            ]
        else:
            kind = re.sub(r"(_\[|<).*", "", re.split(r"::|\.", system.GetSystemType())[-1])
            plant = ', fillcolor="#fbeedb"' if system.num_continuous_states() else ""
            lines.append(
                f'"{name}" [label=<<b>{title}</b><br/><font point-size="10" color="#4a5568">'
                f"{kind}</font>>{plant}];"
            )
    return lines


def _connections(diagram: Diagram, depth: int) -> list[tuple[System, System, str]]:
    """Returns (source, target, signal) for all connections down to a depth."""
    result = []
    for (system, index), (source, output) in diagram.connection_map().items():
        leaf, port = _resolve_output(source, output, depth)
        for target in _resolve_inputs(system, index, depth):
            label = leaf.get_output_port(OutputPortIndex(port)).get_name()
            if label in ("y0", "y"):  # Drake's anonymous output: take the name of what it feeds.
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
    """Returns the arrows that close a loop, seen from the blocks that nothing feeds."""
    successors: dict[str, list[str]] = {name: [] for name in names}
    for source, target in signals:
        successors.setdefault(source, []).append(target)
        successors.setdefault(target, [])
    fed = {target for targets in successors.values() for target in targets}
    back: set[tuple[str, str]] = set()
    done: set[str] = set()

    def visit(name: str, path: tuple[str, ...]) -> None:
        for target in successors[name]:
            if target in path:
                back.add((name, target))
            elif target not in done:
                visit(target, (*path, target))
        done.add(name)

    for name in sorted(successors, key=lambda name: name in fed):
        if name not in done:
            visit(name, (name,))
    return back


def _title(name: str) -> str:
    words = [_ACRONYMS.get(word, word) for word in name.split("_")]
    return " ".join([words[0][0].upper() + words[0][1:], *words[1:]])
