"""Tunes the controller: what do other weights cost, and what do they bring?

The weights stand in the scenario, each under the system that has it. Any value can be overridden
by the same text that ``--set`` takes on the command line.

Prints:

                           RMSE x     y [mm]  yaw [mrad]  wheel moves [pwm]  tube [mm]
    as published              8.0       12.3         5.5                1.8       24.4
    commands cost more       37.9       62.1         6.7                1.6       24.1
    longer horizon            7.5        9.2         5.5                1.8       24.4
    quick ancillary law       4.3        5.4         5.3                3.1        8.8
    gentle ancillary law     26.0       43.1         7.8                0.9       76.7
"""

import numpy as np

from mirte_drake.run import simulate
from mirte_drake.run_summary import summarise
from mirte_drake.scenario_file import load_scenario

CHOICES = {
    "as published": [],
    "commands cost more": ["nominal_nmpc.input_weight=[0.02, 0.02, 0.02, 0.02]"],
    "longer horizon": ["nominal_nmpc.horizon=20"],
    "quick ancillary law": ["ancillary_dlqr.input_weight=[0.0001, 0.0001, 0.0001, 0.0001]"],
    "gentle ancillary law": ["ancillary_dlqr.input_weight=[0.01, 0.01, 0.01, 0.01]"],
}


def main() -> None:
    print("                       RMSE x     y [mm]  yaw [mrad]  wheel moves [pwm]  tube [mm]")
    for name, overrides in CHOICES.items():
        run = simulate(load_scenario("rectangle", overrides), name)
        x, y, yaw = (1e3 * error for error in summarise(run)["rmse"].values())
        moves = np.mean(np.abs(np.diff(run.log["applied_input"], axis=0)))
        tube = 1e3 * np.max(run.log["half_width"][:, :2])
        print(f"{name:22} {x:6.1f} {y:10.1f} {yaw:11.1f} {moves:18.1f} {tube:10.1f}")


if __name__ == "__main__":
    main()
