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
