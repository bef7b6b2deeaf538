"""Has the controller predict with a model of one's own: the textbook's mecanum kinematics.

A model is a table of terms with their coefficients, for the derivative of each state. Here they
are not identified but computed, and then scaled to the speeds that the robot reaches in each
direction, as one measures them with a stopwatch.

Prints:

    ideal               RMSE x 16.5 mm, y 37.3 mm, yaw  5.9 mrad
    measured            RMSE x 15.4 mm, y 23.8 mm, yaw  5.5 mrad
    extended_kinematic  RMSE x  8.0 mm, y 12.3 mm, yaw  5.5 mrad
"""

import sys
from pathlib import Path

import numpy as np

from mirte_drake.geometry import FORWARD_KINEMATICS, PWM_SPEED
from mirte_drake.model.model_file import ModelFile, save_model_file
from mirte_drake.run import simulate
from mirte_drake.run_summary import summarise
from mirte_drake.scenario_file import load_scenario

INPUTS = ("u1", "u2", "u3", "u4")


def mecanum_model(share: np.ndarray) -> ModelFile:
    """Returns the kinematics (2-6), of which the robot reaches a share in vx, vy and yaw rate."""
    forward, left, turn = share[:, None] * FORWARD_KINEMATICS * PWM_SPEED  # Per percent of PWM.
    x = {f"cos(theta)*{u}": c for u, c in zip(INPUTS, forward, strict=True)}
    x |= {f"sin(theta)*{u}": -c for u, c in zip(INPUTS, left, strict=True)}
    y = {f"sin(theta)*{u}": c for u, c in zip(INPUTS, forward, strict=True)}
    y |= {f"cos(theta)*{u}": c for u, c in zip(INPUTS, left, strict=True)}
    theta = dict(zip(INPUTS, turn, strict=True))
    return ModelFile(
        name="mecanum",
        states={"x": "m", "y": "m", "theta": "rad"},
        inputs=dict.fromkeys(INPUTS, "pwm_percent"),
        derivatives={"x": x, "y": y, "theta": theta},
    )


def main(folder: Path) -> None:
    shares = {"ideal": [1.0, 1.0, 1.0], "measured": [0.94, 0.52, 0.66]}
    for name, share in shares.items():
        save_model_file(mecanum_model(np.array(share)), folder / f"{name}.yaml")
    for model in folder / "ideal.yaml", folder / "measured.yaml", "extended_kinematic":
        scenario = load_scenario("rectangle", [f"prediction_model={model}"])
        x, y, yaw = (1e3 * e for e in summarise(simulate(scenario, "rectangle"))["rmse"].values())
        print(f"{Path(model).stem:19} RMSE x {x:4.1f} mm, y {y:4.1f} mm, yaw {yaw:4.1f} mrad")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "runs/example"))
