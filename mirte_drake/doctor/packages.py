"""Python and the packages that mirte_drake and its optional parts need, by its own metadata."""

import importlib
import importlib.metadata
import platform
from collections.abc import Iterator, Mapping
from functools import cache

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from mirte_drake.doctor.finding import Finding, Grade

NAME = "mirte-drake"
# What wheels of drake and pygraphviz take from the system.
LIBRARIES = "apt install libglib2.0-0 libx11-6 libxext6 libxrender1"
DEVELOPMENT = "dev"  # The optional part that is for those who work on mirte_drake.


def check_packages() -> Iterator[Finding]:
    """Yields what there is to say of Python, the required packages, and each optional part."""
    try:
        metadata = importlib.metadata.metadata(NAME)
    except importlib.metadata.PackageNotFoundError:
        yield Finding(
            "installation", Grade.LACKING, f"{NAME} is not installed, only its source is here",
            "pip install . in its folder, so that what it needs is known and checked",
        )  # fmt: skip
        return
    yield check_python(metadata["Requires-Python"], platform.python_version())
    requirements = [Requirement(text) for text in metadata.get_all("Requires-Dist", [])]
    required = [each for each in requirements if _applies(each, "")]
    for requirement in required:
        yield check_package(requirement)
    for extra in sorted(set(metadata.get_all("Provides-Extra", [])) - {DEVELOPMENT}):
        for requirement in requirements:
            if requirement not in required and _applies(requirement, extra):
                yield check_package(requirement, extra)


def _applies(requirement: Requirement, extra: str) -> bool:
    """Tells whether a requirement is one of an optional part, or without one where empty."""
    if requirement.name == NAME:  # An optional part that includes another one.
        return False
    return requirement.marker is None or requirement.marker.evaluate({"extra": extra})


def check_python(required: str, version: str) -> Finding:
    """Says whether this Python will do.

    Args:
        required: As ``>=3.11``.
        version: Of this Python.
    """
    if SpecifierSet(required).contains(version, prereleases=True):
        return Finding("Python", Grade.GOOD, version)
    return Finding("Python", Grade.BAD, f"{version}, but {required} is needed", "install a newer")


def check_package(requirement: Requirement, extra: str = "") -> Finding:
    """Says whether a package is there, new enough, and can be imported.

    Args:
        requirement: Its name and versions.
        extra: The optional part that needs it; empty: all do.
    """
    name, needed = requirement.name, str(requirement.specifier)
    grade = Grade.LACKING if extra else Grade.BAD
    purpose = f", for [{extra}]" if extra else ""
    remedy = f"pip install '{NAME}[{extra}]'" if extra else f"pip install '{name}{needed}'"
    try:
        version = importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return Finding(name, grade, f"is not installed{purpose}", remedy)
    if not requirement.specifier.contains(version, prereleases=True):
        return Finding(name, grade, f"{version}, but {needed} is needed{purpose}", remedy)
    try:
        importlib.import_module(_module(name))
    except Exception as error:  # Whatever a package does when it is loaded.
        reason = " ".join(str(error).split()) or type(error).__name__
        return Finding(name, Grade.BAD, f"{version} cannot be loaded: {reason}",
                       f"{LIBRARIES}, or pip install --force-reinstall {name}")  # fmt: skip
    return Finding(name, Grade.GOOD, f"{version}{purpose}")


def _module(name: str) -> str:
    """Returns the module to import of a package: that of its name, or its shortest public one."""
    wanted = name.lower().replace("-", "_")
    modules = [
        module
        for module, packages in _owners().items()
        if name.lower() in {package.lower() for package in packages}
    ]
    public = sorted((module for module in modules if not module.startswith("_")), key=len)
    same = [module for module in public if module.lower() == wanted]
    return [*same, *public, wanted][0]


@cache  # It reads what every installed package lists: half a second each time.
def _owners() -> Mapping[str, list[str]]:
    """Returns the packages that each module belongs to."""
    return importlib.metadata.packages_distributions()
