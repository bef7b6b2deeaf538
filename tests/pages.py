"""Runs the code blocks of README and site as a reader would: in order, in one folder.

Shell blocks are fenced as ``sh`` or, in the README, indented commands; Python blocks run as they
stand; a YAML block that begins with ``# name.yaml`` is a file to save. A block that a test cannot
run stands below a line ``<!-- not run: reason -->``.
"""

import dataclasses as dc
import re
import shlex
from collections.abc import Sequence
from pathlib import Path

from mirte_drake.cli import main

NOT_RUN = re.compile(r"<!-- not run: (.*) -->")
FENCE = re.compile(r"^(`{3,}|:{3,})(?:\{(\w+)\})? ?(.*)$")
INDENTED = "    mirte-drake "

# The parsing and the wiring as written, the runs shorter.
SHORTER = {
    "simulate": "--set duration=0.3 --no-plots",
    "collect": "--duration 20",
    "benchmark": "--quick --solver realtime --solver converged",
    "compare": "--runs 1 --scenario baseline_circle --set duration=0.3",
}
ONLY_SHOWS = ("--help", "--version")


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
        lines = self.text.replace("\\\n", " ").splitlines()
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
        elif fence and fence[1].startswith("`"):
            content = []
            for inner in lines:
                if inner.strip() == fence[1]:
                    break
                content.append(inner)
            found += _block(page, fence[2] or "", fence[3], "\n".join(content), reason)
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


def run(block: Block, namespace: dict, *, short: bool = True) -> None:
    """Runs a block in the working directory."""
    if block.not_run:
        return
    if block.language == "python":
        exec(compile(block.text, "block", "exec"), namespace)
    elif block.language == "sh":
        for command in block.commands:
            run_command(command, short=short)
    elif block.file:
        Path(block.file).write_text(block.text + "\n")


def run_command(command: str, *, short: bool = True) -> None:
    """Runs a command `mirte-drake ...`, which must end well."""
    program, *arguments = shlex.split(command)
    assert program == "mirte-drake", f"mark it as not run, or run it: {command}"
    more: Sequence[str] = SHORTER.get(arguments[0], "").split() if short else ()
    try:
        main([*arguments, *more])
    except SystemExit as end:
        if end.code or not set(arguments) & set(ONLY_SHOWS):
            raise AssertionError(f"{command} ended with {end.code}") from None
