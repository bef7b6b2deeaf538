"""Short names of the robots that a scenario can have, simulated or beyond a wire."""

ROBOTS = ("sindyc", "dynamic", "multibody")
TRANSPORTS = ("ros2", "lcm")  # Of a robot beyond a wire.


def robot_override(name: str) -> str:
    """Returns the override of a scenario that gives it the robot of a name, with its defaults."""
    return f"robot=!{name.capitalize()}RobotConfig {{}}"


def robot_name(config: object) -> str:
    """Returns the short name of the robot of a config."""
    return type(config).__name__.removesuffix("RobotConfig").lower()
