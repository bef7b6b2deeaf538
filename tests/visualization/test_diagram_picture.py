import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from mirte_drake.assembly import MakeDiagram
from mirte_drake.scenario import load_scenario, scenario_names
from mirte_drake.visualization.diagram_picture import diagram_dot, save_diagram_picture

DIAGRAMS = Path(__file__).parents[2] / "diagrams"


@pytest.mark.parametrize("name", scenario_names())
def test_the_committed_picture_is_true(name):
    committed = DIAGRAMS / f"{name}.dot"
    assert committed.is_file(), "run `make diagrams` and commit what it draws"
    assert diagram_dot(MakeDiagram(load_scenario(name))) == committed.read_text()
    assert (DIAGRAMS / f"{name}.svg").is_file()


def test_connections_are_named_after_their_signals():
    dot = diagram_dot(MakeDiagram(load_scenario("rectangle")))
    for arrow in (
        '"reference_source" -> "controller/nominal_nmpc" [label="reference window"]',
        '"controller/nominal_nmpc" -> "controller/ancillary_dlqr" [label="plan"]',
        '"controller/command_hold" -> "sindyc_robot" [label="wheel command"]',
        '"controller/tube_updater" -> "controller/nominal_nmpc" '
        '[label="half width\\ninput lower\\ninput upper", constraint=false]',
        '"sindyc_robot" -> "controller/ancillary_dlqr" [label="pose", constraint=false]',
        '"disturbance_source" -> "sindyc_robot" [label="disturbance"]',
    ):
        assert arrow in dot


def test_the_baseline_has_neither_tube_nor_ancillary_law():
    dot = diagram_dot(MakeDiagram(load_scenario("baseline_rectangle")))
    assert "tube" not in dot and "ancillary" not in dot


def test_depth_1_shows_the_controller_as_one_block():
    dot = diagram_dot(MakeDiagram(load_scenario("rectangle")), depth=1)
    assert "subgraph" not in dot and '"controller" -> "sindyc_robot"' in dot


def test_depth_must_be_positive():
    with pytest.raises(ValueError, match="depth"):
        diagram_dot(MakeDiagram(load_scenario("rectangle")), depth=0)


def test_the_svg_shows_every_block_as_text(tmp_path):
    save_diagram_picture(MakeDiagram(load_scenario("rectangle")), tmp_path / "picture")
    texts = "".join(ET.parse(tmp_path / "picture.svg").getroot().itertext())
    for title in ("Nominal NMPC", "Ancillary DLQR", "Tube updater", "SINDYc robot", "Controller"):
        assert title in texts


def test_no_system_graphviz_is_needed(tmp_path):
    code = (
        "import sys; from mirte_drake.cli import main; "
        f"main(['diagram', 'rectangle', '--output', {str(tmp_path)!r}])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env={"PATH": ""}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "rectangle.svg").stat().st_size > 1000
