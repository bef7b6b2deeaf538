import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ZeroOrderHold

from mirte_drake.assembly import MakeDiagram
from mirte_drake.robots.names import robot_override
from mirte_drake.scenario_file import load_scenario, scenario_names
from mirte_drake.visualization.diagram_picture import diagram_dot, save_diagram_picture

DIAGRAMS = Path(__file__).parents[2] / "diagrams"


@pytest.mark.parametrize("name", scenario_names())
def test_the_committed_picture_is_true(name):
    committed = DIAGRAMS / f"{name}.dot"
    assert committed.is_file(), "run `make diagrams` and commit what it draws"
    assert diagram_dot(MakeDiagram(load_scenario(name))) == committed.read_text()
    svg = ET.parse(DIAGRAMS / f"{name}.svg").getroot()
    titles = {title.text for title in svg.iter("{http://www.w3.org/2000/svg}title")}
    assert set(re.findall(r'^"([^"]*)" \[label', committed.read_text(), re.M)) <= titles
    arrows = re.findall(r'^"(.*?)" -> "(.*?)" ', committed.read_text(), re.M)
    assert {f"{start}->{end}" for start, end in arrows} <= titles


def test_connections_are_named_after_their_signals():
    dot = diagram_dot(MakeDiagram(load_scenario("rectangle")))
    for arrow in (
        '"reference_source" -> "controller/nominal_nmpc" [label="reference window", weight=100]',
        '"controller/nominal_nmpc" -> "controller/ancillary_dlqr" [label="plan", weight=100]',
        '"controller/command_hold" -> "sindyc_robot" [label="wheel command", weight=100]',
        '"disturbance_source" -> "sindyc_robot" [label="disturbance"]',
    ):
        assert arrow in dot


def test_feedback_is_drawn_backward():
    dot = diagram_dot(MakeDiagram(load_scenario("rectangle")))
    for source, target, label in (
        ("controller/tube_updater", "controller/nominal_nmpc",
         "half width\\ninput lower\\ninput upper"),
        ("sindyc_robot", "controller/ancillary_dlqr", "pose"),
        ("sindyc_robot", "controller/nominal_nmpc", "pose"),
        ("controller/command_hold", "controller/nominal_nmpc", "applied input"),
        ("controller/command_hold", "controller/wheel_command_limiter", "last command"),
    ):  # fmt: skip
        assert f'"{target}" -> "{source}" [label="{label}", dir=back, weight=0];' in dot
    assert dot.count("dir=back") == 5


def test_the_longest_way_forward_is_one_row():
    dot = diagram_dot(MakeDiagram(load_scenario("rectangle")))
    row = re.findall(r'^"(?:.*/)?(.*)" \[group=row\];$', dot, re.M)
    assert row == [
        "reference_source", "nominal_nmpc", "ancillary_dlqr", "wheel_command_limiter",
        "command_hold", "sindyc_robot",
    ]  # fmt: skip


def test_what_a_wire_gives_to_the_controller_is_feedback():
    scenario = load_scenario("rectangle", ["robot=!LcmRobotConfig {wire: {url: 'memq://'}}"])
    dot = diagram_dot(MakeDiagram(scenario))
    pose = '"controller/nominal_nmpc" -> "lcm_robot/adapter" [label="pose", dir=back, weight=0];'
    assert pose in dot
    assert '"lcm_robot/odometry_subscriber" -> "lcm_robot/adapter" [label="odometry"]' in dot
    row = re.findall(r'^"(.*)" \[group=row\];$', dot, re.M)
    assert row[0] == "reference_source" and row[-2] == "lcm_robot/adapter"


def test_controller_robot_and_surroundings_have_their_colours():
    dot = diagram_dot(MakeDiagram(load_scenario("rectangle", [robot_override("dynamic")])))
    colors = dict(re.findall(r'^"([^"]*)" \[label=.*fillcolor="(.*?)"', dot, re.M))
    parts = {
        part: {color for name, color in colors.items() if name.startswith(part)}
        for part in ("controller/", "dynamic_robot/", "reference_source")
    }
    assert all(len(found) == 1 for found in parts.values())
    assert len(set.union(*parts.values())) == 3


def test_a_robot_on_the_wire_has_another_colour():
    def color(name):
        builder = DiagramBuilder()
        builder.AddNamedSystem(name, ZeroOrderHold(0.1, 4))
        (found,) = re.findall(r'fillcolor="(.*?)"', diagram_dot(builder.Build()))
        return found

    assert color("ros2_robot") == color("lcm_robot")
    assert len({color(name) for name in ("ros2_robot", "sindyc_robot", "somebody_else")}) == 3


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
