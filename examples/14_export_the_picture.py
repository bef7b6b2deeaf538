"""Draws the Diagram of a scenario and, for comparison, the controller alone.

Prints:

    runs/pictures/rectangle.svg
    runs/pictures/rectangle.png
    runs/pictures/rectangle.dot
    runs/pictures/controller.svg
    runs/pictures/controller.png
    runs/pictures/controller.dot
"""

import sys
from pathlib import Path

from mirte_drake.assembly import MakeController, MakeDiagram
from mirte_drake.scenario_file import load_scenario
from mirte_drake.visualization.diagram_picture import save_diagram_picture


def main(folder: Path) -> list[Path]:
    scenario = load_scenario("rectangle")
    pictures = [
        *save_diagram_picture(MakeDiagram(scenario), folder / "rectangle"),
        *save_diagram_picture(MakeController(scenario), folder / "controller", depth=1),
    ]
    for picture in pictures:
        print(picture)
    return pictures


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "runs/pictures"))
