"""Drives the same scenario on three robots: only the robot is swapped, the controller stays.

The first moves as the controller predicts, plus a disturbance. The second has motors and friction
as the recorded robot. The third has forty rollers that slip, and odometry that does not see it.

Prints:

    sindyc     odometry   8.0  12.3 mm  true   8.0  12.3 mm  not where predicted: 1 of 250
    dynamic    odometry  21.3  33.8 mm  true  21.0  33.5 mm  not where predicted: 193 of 250
    multibody  odometry   2.9  12.4 mm  true   4.4  13.5 mm  not where predicted: 0 of 250
"""

from mirte_drake.robots.names import robot_override
from mirte_drake.run import simulate
from mirte_drake.run_summary import summarise
from mirte_drake.scenario_file import load_scenario


def main() -> None:
    for robot in "sindyc", "dynamic", "multibody":
        run = simulate(load_scenario("rectangle", [robot_override(robot)]), robot)
        summary = summarise(run)
        measured, true = summary["rmse"], summary["true_rmse"]
        print(
            f"{robot:9}  odometry {1e3 * measured['x_m']:5.1f} {1e3 * measured['y_m']:5.1f} mm",
            end="",
        )
        print(f"  true {1e3 * true['x_m']:5.1f} {1e3 * true['y_m']:5.1f} mm", end="")
        print(f"  not where predicted: {summary['successor_violations']} of {summary['steps'] - 1}")


if __name__ == "__main__":
    main()
