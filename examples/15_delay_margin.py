"""How much delay do two ancillary laws stand on the robot's identified lag?

The published law feeds back the pose as if the robot followed at once. Ours observes the velocity,
and predicts over a delay that it reckons with, of no or one sample, whatever the delay is. A
spectral radius is the factor by which an error shrinks per sample in the long run, with a delay of
0, 1 and 2 samples beside that; above 1 it grows.

Prints:

    published: spectral radius 0.87, 0.98, 1.06 with 0, 1, 2 samples of delay
        stable up to 0.114 s
    ours, 0 reckoned with: spectral radius 0.82, 0.91, 1.01 with 0, 1, 2 samples of delay
        stable up to 0.184 s
    ours, 1 reckoned with: spectral radius 0.84, 0.82, 0.92 with 0, 1, 2 samples of delay
        stable up to 0.291 s
"""

from functools import partial
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from mirte_drake.control.dlqr import design_dlqr
from mirte_drake.control.loop_analysis import (
    delay_margin,
    observer_loop,
    pose_feedback_loop,
    spectral_radius,
)
from mirte_drake.model.model_file import load_model, load_model_file
from mirte_drake.systems.ancillary_lagged import AncillaryLaggedConfig
from mirte_drake.systems.state_estimator import StateEstimatorConfig

PERIOD = 0.1  # [s]
LAG = load_model_file("lagged").lagged.lag


def published(delay: float) -> np.ndarray:
    model, at_rest = load_model("extended_kinematic"), (np.zeros(3), np.zeros(4))
    K = design_dlqr(model, *at_rest, PERIOD, 1000 * np.eye(3), 0.001 * np.eye(4)).gain
    return pose_feedback_loop(model.linearise(*at_rest)[2] @ K, LAG, PERIOD, delay)


def ours(delay: float, known_delay: int) -> np.ndarray:
    """Returns the loops of the three axes, which have nothing to do with each other."""
    K = AncillaryLaggedConfig().gains(LAG, PERIOD)
    L = StateEstimatorConfig().gains(LAG, PERIOD)
    loops = zip(K, L, LAG, strict=True)
    return np.array(
        [observer_loop(*axis, PERIOD, delay, known_delay=known_delay) for axis in loops]
    )


def main(folder: Path = Path()) -> None:
    delays = np.linspace(0.0, 0.3, 61)
    loops = {"published": published}
    for known in range(2):
        loops[f"ours, {known} reckoned with"] = partial(ours, known_delay=known)
    for name, loop in loops.items():
        radii = [spectral_radius(loop(delay)) for delay in delays]
        plt.plot(1e3 * delays, radii, label=name)
        shown = ", ".join(f"{spectral_radius(loop(k * PERIOD)):.2f}" for k in range(3))
        print(f"{name}: spectral radius {shown} with 0, 1, 2 samples of delay")
        print(f"    stable up to {delay_margin(loop):.3f} s")
    plt.axhline(1.0, color="black", lw=0.8)
    plt.gca().set(xlabel="delay [ms]", ylabel="spectral radius", ylim=(0.7, 1.15))
    plt.legend()
    plt.savefig(folder / "delay_margin.svg")


if __name__ == "__main__":
    main()
