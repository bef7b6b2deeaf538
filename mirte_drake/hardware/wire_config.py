"""Which wire: settings of the middleware, loopback only unless told otherwise."""

import dataclasses as dc

from mirte_drake.checks import check_choice, check_number
from mirte_drake.errors import UserError
from mirte_drake.hardware.link import Link, Role

MOTOR_TYPES = ("auto", "Int32", "SetSpeed")
MAX_DOMAIN = 232  # Above, the ports of DDS run out.


@dc.dataclass
class Ros2WireConfig:
    """Wire of a robot on ROS 2, over DDS; the defaults are the MIRTE Master's, on loopback."""

    domain: int = 0  # ROS_DOMAIN_ID.
    interface: str = "lo"  # Network interface by name, or its address. No other one is used.
    peers: list[str] = dc.field(default_factory=list)  # Addresses besides this machine's own.
    namespace: str = "/io"  # Where ``motor/WHEEL/speed`` are.
    odometry_topic: str = "/mirte_base_controller/odom"
    # Type of a wheel command: as the robot subscribes to it ("auto"), std_msgs/Int32 or
    # mirte_msgs/SetSpeed. A robot of ours with "auto" has Int32.
    motor_type: str = "auto"

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        check_number("domain", self.domain, minimum=0, maximum=MAX_DOMAIN)
        check_choice("motor_type", self.motor_type, MOTOR_TYPES)
        for name in ("namespace", "odometry_topic"):
            value = getattr(self, name)
            if not value.startswith("/") or value.endswith("/"):
                raise ValueError(f"{name}: must begin and not end with /, got {value!r}")
        if not self.interface:
            raise ValueError("interface: must be the name or address of one, as lo")


@dc.dataclass
class LcmWireConfig:
    """Wire of a robot on LCM; the default stays on this machine (time to live 0)."""

    # memq:// stays within one process.
    url: str = "udpm://239.255.76.67:7667?ttl=0"
    prefix: str = "MIRTE_"  # Of every channel.

    def validate(self) -> None:
        """Raises ValueError when a value is out of range."""
        if "://" not in self.url:
            raise ValueError(f"url: must be an LCM URL, as udpm://..., got {self.url!r}")


WireConfig = Ros2WireConfig | LcmWireConfig


def open_link(config: WireConfig, role: Role) -> Link:
    """Returns one end of a wire.

    Raises:
        UserError: when the middleware is not installed or cannot be used.
        ValueError: when ``config`` is out of range.
    """
    config.validate()
    if isinstance(config, Ros2WireConfig):
        try:
            import cyclonedds  # noqa: F401
        except ImportError:
            raise UserError("needs the package cyclonedds: pip install mirte-drake[ros2]") from None
        from mirte_drake.hardware.ros2_link import Ros2Link

        return Ros2Link(config, role)
    from mirte_drake.hardware.lcm_link import LcmLink

    return LcmLink(config, role)
