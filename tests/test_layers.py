"""Imports run one way, as the floor plan says."""

import ast
from pathlib import Path

import mirte_drake

PACKAGE = Path(mirte_drake.__file__).parent

# Each layer may import those before it, and itself.
LAYERS = [
    {"", "errors", "compiled", "vectors", "sampling", "angles", "geometry", "frames"}
    | {"checks", "files", "typed_yaml"},
    {"model"},
    {"control"},
    {"identification"},  # A leaf: nobody below the command line needs it.
    {"hardware"},  # Wire formats and safety: knows nothing of Diagrams but what LCM needs.
    {"systems", "robots"},
    {"scenario", "scenario_file"},
    {"controllers", "robot_assembly"},
    {"assembly"},
    {"containment"},
    {"run", "run_summary", "collect", "pacing"}
    | {"drive", "drive_recorder", "wire_session", "stand_in"},
    {"replay", "live", "live_view"},
    {"benchmark", "campaign", "comparison", "faults", "doctor", "adversary"},
    {"reporting", "thesis"},
    {"cli", "__main__"},
]
# Reads arrays and Diagrams, not the layers above `vectors`; read by those below.
VISUALIZATION = "visualization"
VIEWERS = (
    *(VISUALIZATION, "assembly", "run", "replay", "live", "live_view", "reporting", "thesis"),
    "cli",
)
GENERATED = "mirte_lcm"  # By lcm-gen, in its own style.


def layer(module: str) -> int:
    return next(i for i, names in enumerate(LAYERS) if module in names)


def imports(path: Path) -> list[str]:
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.append(node.module)
    return found


def part(name: str) -> str:
    """First part of a module name below the package."""
    return f"{name}.".split(".")[1]


def sources():
    for path in sorted(PACKAGE.rglob("*.py")):
        if path.parent.name == GENERATED:
            continue
        module = path.relative_to(PACKAGE).with_suffix("").parts[0].replace("__init__", "")
        yield path, module


def test_imports_run_one_way():
    seen = 0
    for path, module in sources():
        for name in imports(path):
            if not name.startswith("mirte_drake"):
                continue
            seen += 1
            target = part(name)
            if VISUALIZATION in (module, target):
                assert module in VIEWERS, f"{path} imports {name}"
                if module == VISUALIZATION and target != VISUALIZATION:
                    assert layer(target) == 0, f"{path} imports {name}"
            else:
                if target == "identification":
                    assert module in ("identification", "thesis", "cli"), f"{path} imports {name}"
                assert layer(target) <= layer(module), f"{path} imports {name}"
    assert seen > 50


def test_the_mathematics_knows_no_systems():
    for path, module in sources():
        if module in ("model", "identification", "control"):
            assert not [n for n in imports(path) if n.startswith("pydrake.systems")], path


def test_no_star_imports_and_no_pydrake_all():
    for path, _ in sources():
        assert "pydrake.all" not in imports(path), path
        assert "import *" not in path.read_text(), path
