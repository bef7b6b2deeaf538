"""Runs the code blocks of README and site as a reader would: in order, in one folder.

Shell blocks are fenced as ``sh`` or, in the README, indented commands; Python blocks run as they
stand; a YAML block that begins with ``# name.yaml`` is a file to save. A robot that is put on a
wire stays there until the reader is done. A block that a test cannot run stands below a line
``<!-- not run: reason -->``.
"""

import contextlib
import dataclasses as dc
import re
import shlex
import textwrap
from pathlib import Path

from wire_processes import WIRES, robot_process

from mirte_drake.cli import main
from mirte_drake.scenario_file import load_scenario

NOT_RUN = re.compile(r"<!-- not run: (.*) -->")
FENCE = re.compile(r"^ {0,3}(`{3,})(?:\{([\w-]+)\})? ?(.*)$")
INDENTED = "    mirte-drake "

# The parsing and the wiring as written, the runs shorter.
SHORTER = {
    "simulate": "--set duration=0.3 --no-plots",
    "collect": "--duration 20",
    "campaign": "--runs 1 --set duration=0.3 --backend serial --output campaign",
    "benchmark": "--quick --solver realtime --solver converged",
    "compare": "--runs 1 --scenario baseline_circle --set duration=0.3",
    "figures": "5-2",
    "faults": "--runs 1 --kind odometry_nan_once",
}
# At the wire a second takes a second.
SHORTER_AT_THE_WIRE = {"drive": "--set duration=1 --no-plots", "collect": "--duration 2"}
ONLY_SHOWS = ("--help", "--version")
MAY_COMPLAIN = ("doctor",)  # Of the machine that it runs on.


@dc.dataclass(frozen=True)
class Block:
    """One code block."""

    language: str
    text: str
    not_run: str = ""  # Why.
    file: str = ""  # Name under which a reader saves it.

    @property
    def commands(self) -> list[str]:
        """Commands of a shell block, each on one line; comments are none."""
        lines = self.text.replace("\\\n", " ").splitlines() if self.language == "sh" else []
        return [line for line in lines if line.strip() and not line.lstrip().startswith("#")]


def blocks(page: Path) -> list[Block]:
    """Returns the code blocks of a page of Markdown in order."""
    found, reason = [], ""
    lines = iter(page.read_text().splitlines())
    for line in lines:
        fence = FENCE.match(line)
        if match := NOT_RUN.fullmatch(line.strip()):
            reason = match[1]
        elif line.startswith(INDENTED):
            found.append(Block("sh", line.strip(), reason))
            reason = ""
        elif fence:
            content = []
            for inner in lines:
                if inner.strip() == fence[1]:
                    break
                content.append(inner)
            text = textwrap.dedent("\n".join(content)) + "\n"
            found += _block(page, fence[2] or "", fence[3], text, reason)
            reason = ""
    return found


def _block(page: Path, directive: str, argument: str, text: str, reason: str) -> list[Block]:
    if directive == "literalinclude":
        path = page.parent / argument
        return [Block(path.suffix[1:], path.read_text(), reason, path.name)]
    if directive:
        return []
    name = re.match(r"# (\S+\.yaml)\n", text)
    return [Block(argument, text, reason, name[1] if argument == "yaml" and name else "")]


class Reader:
    """Does what pages say, in the working directory."""

    def __init__(self, *, short: bool = True) -> None:
        """Begins; ``short`` runs less than is written."""
        self._short, self._namespace = short, {}
        self._robots = contextlib.ExitStack()

    def __enter__(self) -> "Reader":
        return self

    def __exit__(self, *error: object) -> None:
        """Takes robots off their wires."""
        self._robots.__exit__(*error)

    def run(self, block: Block) -> None:
        """Runs a block, or saves its file."""
        if block.not_run:
            return
        if block.language == "python":
            exec(compile(block.text, "block", "exec"), self._namespace)
        for command in block.commands:
            self.run_command(command)
        if block.file:
            Path(block.file).write_text(block.text)
            if block.file.endswith(".scenario.yaml"):
                load_scenario(block.file)

    def run_command(self, command: str) -> None:
        """Runs a command `mirte-drake ...`, which must end well."""
        program, name, *arguments = shlex.split(command, comments=True)
        assert program == "mirte-drake", f"mark it as not run, or run it: {command}"
        shorter = SHORTER
        if "--transport" in arguments:
            at = arguments.index("--transport")
            wire, shorter = arguments[at + 1], SHORTER_AT_THE_WIRE
            arguments[at : at + 2] = []
            if name == "robot":
                self._robots.enter_context(robot_process(wire, *arguments))
                return
            arguments += WIRES[wire]
        arguments += shorter.get(name, "").split() if self._short else []
        try:
            main([name, *arguments])
        except SystemExit as end:
            shows = {name, *arguments} & set(ONLY_SHOWS)
            if name not in MAY_COMPLAIN and (end.code or not shows):
                raise AssertionError(f"{command} ended with {end.code}") from None
