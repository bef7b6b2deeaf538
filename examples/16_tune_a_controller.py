"""Tunes PID or LQR on the identified model of a robot that lags.

    python 16_tune_a_controller.py pid 300 2
    python 16_tune_a_controller.py lqr 30 0

gave, rounded, the defaults of PosePidConfig and PoseLqrConfig: the Nelder-Mead method on
logarithms, with a preview [samples] that came out better than its neighbours; seed 1000, half of
the runs with odometry that is a sample late. The model is the one that the lag-aware controller
plans with, from a recording of the robot on which they are all compared, with other seeds. Without
arguments it makes the first two of the evaluations.

Prints:

    cost 130.1 mm by
    state_weight: [149.18246976 100.         100.        ]
    input_weight: [0.001 0.001 0.001 0.001]
    preview: 0
"""

import dataclasses as dc
import sys

import numpy as np
from scipy.optimize import minimize

from mirte_drake.campaign.grid import Variation, cells
from mirte_drake.campaign.outcome import Outcome, run_outcome
from mirte_drake.systems.pose_lqr import PoseLqrConfig
from mirte_drake.systems.pose_pid import PosePidConfig

PATHS = {"rectangle": 14, "circle": 15, "robot_rectangle": 12, "robot_circle": 16}  # [s]
ROBOT = ["robot=!SindycRobotConfig {model: lagged_multibody}", "disturbance=!NoDisturbance {}"]
ODOMETRY = tuple(f"{{jitter: 0.012, latency: {latency}}}" for latency in (0.0, 0.1))  # [s]
REACH = 0.225  # [m] of a wheel from the middle: what an error of 1 rad in yaw counts for.
CALM = 0.001  # [m] That a change of a command's direction per second counts for.
PID = [2, 2, 2, 4, 4, 0.02, 0.02, 1.1, 1.7, 1.4]  # A first try; x and y share time constants.
LQR = [100, 100, 100]


def pid(p: np.ndarray, preview: int) -> PosePidConfig:
    gain, integral_time, derivative_time = p[:3], p[[3, 3, 4]], p[[5, 5, 6]]
    return PosePidConfig(gain, gain / integral_time, gain * derivative_time, p[7:], preview)


def lqr(p: np.ndarray, preview: int) -> PoseLqrConfig:
    return PoseLqrConfig(state_weight=p, input_weight=np.full(4, 0.001), preview=preview)


def cost(controller: PosePidConfig | PoseLqrConfig) -> float:
    """Error of the true pose [m], and what restlessness counts for; mean over paths and delays."""
    costs = []
    for path, duration in PATHS.items():
        settings = [*ROBOT, "integration_accuracy=1e-3", f"duration={duration}", "seed=1000"]
        for cell in cells([f"baseline_{path}"], [Variation("odometry", ODOMETRY)], settings):
            shown = run_outcome(dc.replace(cell.scenario, controller=controller))
            assert isinstance(shown, Outcome)
            errors = [shown.true_x_m, shown.true_y_m, REACH * shown.true_yaw_rad]
            costs.append(np.linalg.norm(errors) + CALM * shown.oscillation)
    return float(np.mean(costs))


def main(kind: str, evaluations: int, preview: int) -> None:
    make, first = {"pid": (pid, PID), "lqr": (lqr, LQR)}[kind]
    start = np.log(first)
    simplex = np.vstack([start, start + 0.4 * np.eye(len(start))])
    options = {"maxfev": evaluations, "initial_simplex": simplex, "adaptive": True}
    found = minimize(
        lambda p: cost(make(np.exp(p), preview)), start, method="Nelder-Mead", options=options
    )
    print(f"cost {1e3 * found.fun:.1f} mm by")
    for name, value in dc.asdict(make(np.exp(found.x), preview)).items():
        print(f"{name}: {value}")


if __name__ == "__main__":
    kind, evaluations, preview = (*sys.argv[1:], *("lqr", "2", "0")[len(sys.argv) - 1 :])
    main(kind, int(evaluations), int(preview))
