"""Drives a path of one's own: through waypoints, from a scenario file and from Python.

Everything that the file does not mention is as in the scenario that it extends. Whatever is
tracked, the controller sees ten samples of it ahead.

Prints:

    own_path: 13.2 s, RMSE x 0.0121 m, y 0.0213 m, yaw 0.0061 rad
    forwards: 12.8 s, RMSE x 0.0079 m, y 0.0065 m, yaw 0.0217 rad
"""

import dataclasses as dc
import sys
from pathlib import Path

import numpy as np

from mirte_drake.control.waypoint_path import WaypointPath
from mirte_drake.run import simulate
from mirte_drake.run_summary import save_run, summarise
from mirte_drake.scenario import Scenario
from mirte_drake.scenario_file import load_scenario
from mirte_drake.visualization.figures import save_figures

FILE = Path(__file__).with_name("own_path.scenario.yaml")


def scenarios() -> dict[str, Scenario]:
    scenario = load_scenario(str(FILE))
    corners = [np.array(corner) for corner in ([0.0, 0.0], [0.6, 0.0], [0.6, 0.4])]
    # At every stop the robot turns on the spot, so that it drives forwards all the way.
    forwards = WaypointPath(corners, speed=0.12, heading="tangent")
    return {"own_path": scenario, "forwards": dc.replace(scenario, reference=forwards)}


def main(folder: Path) -> None:
    for name, scenario in scenarios().items():
        run = simulate(scenario, name)
        save_run(run, folder / name)
        save_figures(run.log, folder / name, input_limit=scenario.input_limit)
        rmse = summarise(run)["rmse"]
        print(f"{name}: {run.log['time'][-1]:.1f} s, RMSE", end="")
        print(f" x {rmse['x_m']:.4f} m, y {rmse['y_m']:.4f} m, yaw {rmse['yaw_rad']:.4f} rad")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "runs/example"))
