"""Uses one part alone: how large does the tube grow around a robot that drives straight?

The TubeUpdater takes DLQR designs on its port; here it gets the one of steady forward driving,
and the Simulator shows the box growing to its fixed point (4-19).

Prints:

    after 0.0 s: +-0.0040 m, +-0.0030 m, +-0.0090 rad
    after 0.5 s: +-0.0126 m, +-0.0138 m, +-0.0130 rad
    after 1.0 s: +-0.0143 m, +-0.0193 m, +-0.0134 rad
    after 5.0 s: +-0.0149 m, +-0.0246 m, +-0.0137 rad
"""

import numpy as np
from pydrake.systems.analysis import Simulator

from mirte_drake.control.dlqr import design_dlqr, steady_input
from mirte_drake.model.model_file import load_model
from mirte_drake.systems.tube_updater import TubeUpdater, TubeUpdaterConfig

PERIOD = 0.1  # [s]


def main() -> np.ndarray:
    model = load_model("extended_kinematic")
    forward = steady_input(model, np.array([0.1, 0.0, 0.0]))  # 0.1 m/s at yaw 0.
    Q, R = 1000 * np.eye(3), 0.001 * np.eye(4)
    design = design_dlqr(model, np.zeros(3), forward, PERIOD, Q, R)

    tube = TubeUpdater(TubeUpdaterConfig(), period=PERIOD, horizon=10)
    simulator = Simulator(tube)
    context = simulator.get_mutable_context()
    tube.GetInputPort("designs").FixValue(context, (design,))
    for time in (0.0, 0.5, 1.0, 5.0):
        simulator.AdvanceTo(time + PERIOD / 2)
        half_width = tube.GetOutputPort("half_width").Eval(context)
        print(f"after {time:3.1f} s: +-{half_width[0]:.4f} m, +-{half_width[1]:.4f} m, ", end="")
        print(f"+-{half_width[2]:.4f} rad")
    return half_width


if __name__ == "__main__":
    main()
