"""Runs the rectangle of the study, draws it, and compares it with the NMPC without a tube.

``simulate`` returns the arrays of the run, one row per sample; ``save_run`` and ``save_figures``
write what the command writes.

Prints:

    rectangle            RMSE x 0.0073 m, y 0.0113 m
    baseline_rectangle   RMSE x 0.0085 m, y 0.0123 m
"""

import sys
from pathlib import Path

from mirte_drake.run import simulate
from mirte_drake.run_summary import save_run, summarise
from mirte_drake.scenario_file import load_scenario
from mirte_drake.visualization.figures import save_figures


def main(folder: Path) -> None:
    for name in ("rectangle", "baseline_rectangle"):
        scenario = load_scenario(name, ["seed=1"])
        run = simulate(scenario, name)
        save_run(run, folder / name)
        save_figures(run.log, folder / name, input_limit=scenario.input_limit)
        rmse = summarise(run)["rmse"]
        print(f"{name:20} RMSE x {rmse['x_m']:.4f} m, y {rmse['y_m']:.4f} m")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "runs/example"))
