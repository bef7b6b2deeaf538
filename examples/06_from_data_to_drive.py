"""From a drive to a controller, on the multibody robot: record, identify, bound, track.

The robot's rollers slip, its wheels differ, its motors lag and its odometry counts ticks; the
controller knows of that only what the recording says. Each stage prints its numbers.

Prints:

    recorded: 2 x 1201 samples, 120 s
    identified model, second drive: velocity RMSE 0.076 0.076 0.315
    published model, second drive: velocity RMSE 0.082 0.141 0.476
    disturbance bound: 0.146 0.142 0.619 m/s, m/s, rad/s, holds in 95% of held-out samples
    rectangle, identified model: rmse x 0.0049 m, y 0.0024 m, yaw 0.0025 rad
    rectangle, identified model: true_rmse x 0.0048 m, y 0.0044 m, yaw 0.0023 rad
    rectangle, identified model: outside the tube in 0 of 250 samples
    rectangle, published model: rmse x 0.0035 m, y 0.0113 m, yaw 0.0049 rad
    rectangle, published model: true_rmse x 0.0046 m, y 0.0108 m, yaw 0.0050 rad
    rectangle, published model: outside the tube in 2 of 250 samples
"""

import sys
from pathlib import Path

from mirte_drake.collect import collect_scenario
from mirte_drake.control.excitation import ExcitationConfig
from mirte_drake.identification.disturbance_bound import estimate_disturbance
from mirte_drake.identification.fit_sindyc import identify
from mirte_drake.identification.recorded_run import RecordedRun
from mirte_drake.identification.validation import validate_model
from mirte_drake.model.model_file import load_model, save_model_file
from mirte_drake.run import simulate
from mirte_drake.run_summary import save_run
from mirte_drake.scenario_file import load_scenario

ROBOT = "robot=!MultibodyRobotConfig {motors: drifting}"
KIND = "extended_kinematic"


def record(seed: int) -> RecordedRun:
    """Drives the excitation of algorithm 1."""
    data = collect_scenario(load_scenario("rectangle", [ROBOT]), ExcitationConfig(), seed=seed)
    return RecordedRun(data.time, data.pose, data.body_velocity, data.wheel_command)


def main(folder: Path) -> None:
    training, validation = record(seed=0), record(seed=1)
    print(f"recorded: 2 x {len(training.time)} samples, {training.time[-1]:.0f} s")

    path = folder / f"{KIND}.yaml"
    save_model_file(identify(training, KIND), path)
    for label, name in {"identified": path, "published": KIND}.items():
        rmse = validate_model(load_model(name), validation).velocity_rmse
        print(f"{label} model, second drive: velocity RMSE", *(f"{e:.3f}" for e in rmse))

    estimate = estimate_disturbance(load_model(path), validation, integrator="zoh")
    (bound,) = (bound for bound in estimate.one_step if bound.name == "joint")
    print("disturbance bound:", *(f"{w:.3f}" for w in bound.w), end="")
    print(f" m/s, m/s, rad/s, holds in {bound.joint_coverage:.0%} of held-out samples")

    identified = [f"prediction_model={path}", f"tube_updater.disturbance_bound={bound.w.tolist()}"]
    for name, settings in {"identified": identified, "published": []}.items():
        run = simulate(load_scenario("rectangle", [ROBOT, *settings]), name)
        summary = save_run(run, folder / name)
        for key in "rmse", "true_rmse":
            x, y, yaw = summary[key].values()
            print(f"rectangle, {name} model: {key} x {x:.4f} m, y {y:.4f} m, yaw {yaw:.4f} rad")
        outside, samples = summary["successor_violations"], summary["steps"] - 1
        print(f"rectangle, {name} model: outside the tube in {outside} of {samples} samples")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "runs/example"))
