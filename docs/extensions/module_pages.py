"""Writes a page per system and per module into docs/generated, from what the package has.

A module with a ``.. pydrake_system::`` block gets a page among the systems, every other one among
the modules, so that each is described once.
"""

import ast
import dataclasses as dc
import re
from pathlib import Path

from docstrings import escaped, prepared
from sphinx.application import Sphinx

import mirte_drake

PACKAGE = Path(mirte_drake.__file__).parent
BLOCK = ".. pydrake_system::"

SYSTEMS = {  # Folder or module: heading.
    "systems": "Controllers' parts, references and disturbance",
    "controllers": "Whole controllers",
    "robots": "Robots and odometry",
    "assembly": "Diagrams made of them",
    "robot_assembly": "Diagrams made of them",
    "visualization": "To see it, and to interfere",
}
MODULES = {  # Folder: heading.
    "base": "Foundations",
    "model": "Models of the robot",
    "identification": "Identification",
    "control": "Mathematics of the controller",
    "systems": "Parts of systems",
    "controllers": "Parts of controllers",
    "robots": "Parts of robots",
    "hardware": "The wire and what guards it",
    "run": "Scenarios and runs",
    "visualization": "Pictures and reports",
}
BASE = ("angles", "checks", "compiled", "errors", "files", "frames", "geometry", "typed_yaml")
NOT_FOR_READERS = {"cli", "diagrams", "mirte_lcm"}  # The command line has a page of its own.


@dc.dataclass(frozen=True)
class Module:
    """A module of the package."""

    name: str  # Below the package.
    folder: str  # Of MODULES.
    tree: ast.Module

    @property
    def systems(self) -> list[str]:
        """Names of the systems that it has pictures of."""
        return re.findall(rf"{re.escape(BLOCK)}\n+ *name: (\w+)", ast.unparse(self.tree))

    @property
    def title(self) -> str:
        """Title of its page."""
        if not self.systems:
            return self.name
        only_one = len(self.systems) == 1
        return self.systems[0] if only_one else self.page.replace("_", " ").capitalize()

    @property
    def short(self) -> str:
        """Title in the table of contents."""
        return self.title.split(".")[-1]

    @property
    def page(self) -> str:
        """Name of its page."""
        return self.name.split(".")[-1] if self.systems else self.name

    @property
    def says(self) -> str:
        """First line of its docstring."""
        return escaped((ast.get_docstring(self.tree) or "").partition("\n")[0])

    @property
    def members(self) -> list[tuple[str, str, bool]]:
        """What it defines: kind, name, whether pictured; systems first, then other classes.

        The kind is class, function or template: a function that makes a class of a scalar type.
        """
        found = []
        for node in self.tree.body:
            if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith("_"):
                kind = "class" if isinstance(node, ast.ClassDef) else "function"
                kind = "template" if node.name.endswith("_") else kind
                found.append((kind, node.name.rstrip("_"), BLOCK in ast.unparse(node)))
        return sorted(found, key=lambda member: (not member[2], member[0] == "function"))


def modules() -> list[Module]:
    """Returns every module that defines something public."""
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        if parts[-1].startswith("__") or not NOT_FOR_READERS.isdisjoint(parts):
            continue
        folder = parts[0] if len(parts) > 1 else "base" if parts[0] in BASE else "run"
        module = Module(".".join(parts), folder, ast.parse(path.read_text()))
        if module.members:
            found.append(module)
    return found


def headed(title: str, underline: str = "=") -> list[str]:
    """Returns a title."""
    return [title, underline * len(title), ""]


def module_page(module: Module) -> str:
    """Returns the page of a module."""
    name = f"mirte_drake.{module.name}"
    lines = [*headed(module.title), f".. automodule:: {name}", ""]
    for kind, member, system in module.members:
        if kind == "template":
            lines += template(f"{name}.{member}", module.tree)
            continue
        lines += [f".. auto{kind}:: {name}.{member}"]
        lines += ["   :members:"] if kind == "class" else []
        lines += ["   :show-inheritance:"] if kind == "class" and system else []
        lines += [""]
    return "\n".join(lines)


def template(name: str, tree: ast.Module) -> list[str]:
    """Returns the description of a class for floats by the docstring of its template's class.

    autodoc sees in it an alias, since Drake gives it another name.
    """
    (inner,) = (
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef) and BLOCK in (ast.get_docstring(node) or "")
    )
    text = prepared((ast.get_docstring(inner) or "").splitlines())
    return [f".. py:class:: {name}", "", *(f"   {line}".rstrip() for line in text), ""]


def contents_page(title: str, text: str, groups: dict[str, list[Module]]) -> str:
    """Returns a page that says under headings what each module does."""
    lines = [*headed(title), text, ""]
    for heading, members in groups.items():
        lines += headed(heading, "-") if heading else []
        for module in members:
            lines += [f":doc:`{module.title} <{module.page}>`", f"   {module.says}", ""]
        lines += [".. toctree::", "   :hidden:", ""]
        lines += [f"   {module.short} <{module.page}>" for module in members] + [""]
    return "\n".join(lines)


def write(path: Path, text: str) -> None:
    """Writes a page where it is new, so that Sphinx reads again only what changed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() or path.read_text() != text:
        path.write_text(text)


def system_pages(members: list[Module]) -> dict[str, str]:
    """Returns the pages about systems by name."""
    groups: dict[str, list[Module]] = {heading: [] for heading in SYSTEMS.values()}
    for module in members:
        heading = SYSTEMS.get(module.folder) or SYSTEMS.get(module.name, "Others")
        groups.setdefault(heading, []).append(module)
    pages = {module.page: module_page(module) for module in members}
    return {**pages, "index": contents_page("Systems", SYSTEMS_TEXT, groups)}


def other_pages(members: list[Module]) -> dict[str, str]:
    """Returns the pages about modules without a system by name, with one for each folder."""
    pages = {module.page: module_page(module) for module in members}
    index = [*headed("Modules"), MODULES_TEXT, "", ".. toctree::", "   :maxdepth: 1", ""]
    for folder in dict.fromkeys([*MODULES, *(module.folder for module in members)]):
        heading = MODULES.get(folder, folder.capitalize())
        inside = [module for module in members if module.folder == folder]
        if inside:
            pages[f"{folder}-modules"] = contents_page(heading, "", {"": inside})
            index.append(f"   {folder}-modules")
    return {**pages, "index": "\n".join(index) + "\n"}


def write_pages(app: Sphinx) -> None:
    """Writes all pages, and removes those of modules that are gone."""
    members = modules()
    for name, pages in (
        ("systems", system_pages([module for module in members if module.systems])),
        ("modules", other_pages([module for module in members if not module.systems])),
    ):
        folder = Path(app.srcdir) / "generated" / name
        for page, text in pages.items():
            write(folder / f"{page}.rst", text)
        for path in folder.glob("*.rst"):
            if path.stem not in pages:
                path.unlink()


SYSTEMS_TEXT = """\
Every part is a Drake system with named ports, a config, and a function that adds it to a
``DiagramBuilder``. Vectors have SI units; wheel commands are in percent of PWM. This is how they
are wired in the rectangle study:

.. image:: ../../../diagrams/rectangle.svg
   :target: ../../_images/rectangle.svg
   :alt: The Diagram of the rectangle study"""

MODULES_TEXT = """\
The mathematics behind the systems, as functions on arrays, and what runs them. Modules with a
system are described among the :doc:`systems <../systems/index>`."""


def setup(app: Sphinx) -> dict[str, bool]:
    """Has the pages written before Sphinx looks for its sources."""
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
