"""What every robot offers to the controller, simulated or real."""

import dataclasses as dc

from pydrake.systems.framework import InputPort, OutputPort


@dc.dataclass(frozen=True)
class RobotPorts:
    """Ports of a robot in a Diagram."""

    wheel_command: InputPort  # (4,) [pwm] front left, front right, rear right, rear left.
    pose: OutputPort  # (3,) [m, m, rad] measured pose, world frame, yaw unwrapped.
    body_velocity: OutputPort  # (3,) [m/s, m/s, rad/s] measured velocity.
    # (3,) [m, m, rad] where the robot really is; None where nobody can know.
    true_pose: OutputPort | None = None
    disturbance: InputPort | None = None  # (3,) [m/s, m/s, rad/s], body frame; simulated only.
    wheel_angles: OutputPort | None = None  # (4,) [rad] what turns; None: a robot without wheels.
    wire: "WirePorts | None" = None  # Of a robot at the other end of a wire.


@dc.dataclass(frozen=True)
class WirePorts:
    """What a robot beyond a wire takes and gives besides; see WireRobot."""

    reference: InputPort  # (3,) [m, m, rad] r_k, for the guard.
    solve_status: InputPort  # (1,) SolveStatus, for the guard.
    plan: InputPort  # Plan, for onlookers.
    clock: InputPort  # (1,) [s] time.monotonic() at the sample.
    odometry_age: OutputPort  # (1,) [s] of the measured pose.
    drive_command: OutputPort  # DriveCommand to the guard, or NOTHING.
    plan_view: OutputPort  # PlanView to onlookers, or NOTHING.
