"""Parts that can be there and still not work: solvers, compiled code, pictures, the wires."""

import itertools
import time
from collections.abc import Iterator

import numpy as np

from mirte_drake.control.tracking_kernels import all_finite
from mirte_drake.doctor.finding import Finding, Grade
from mirte_drake.errors import UserError
from mirte_drake.hardware.link import Link, Role
from mirte_drake.hardware.messages import Odometry
from mirte_drake.hardware.wire_config import (
    LcmWireConfig,
    Ros2WireConfig,
    WireConfig,
    open_link,
)
from mirte_drake.vectors import POSE_SIZE

PATIENCE = 3.0  # [s] Two ends on DDS know each other after about one.
MESSAGES = 20  # Whose time on the way is measured.
# Names that no robot has: a check must not be heard by a drive on this machine.
WIRES: dict[str, WireConfig] = {
    "LCM wire": LcmWireConfig(prefix="MIRTE_DOCTOR_"),
    "ROS 2 wire": Ros2WireConfig(domain=231, namespace="/doctor", odometry_topic="/doctor"),
}


def check_solvers() -> Iterator[Finding]:
    """Yields whether Drake has SNOPT and IPOPT."""
    from pydrake.solvers import IpoptSolver, SnoptSolver

    for name, solver in (("SNOPT", SnoptSolver()), ("IPOPT", IpoptSolver())):
        if solver.available() and solver.enabled():
            yield Finding(name, Grade.GOOD, "comes with Drake")
        else:
            yield Finding(
                name, Grade.LACKING, f"is not in this Drake: no nominal_nmpc.solver={name.lower()}",
                "pip install --force-reinstall drake brings the wheel, which has it",
            )  # fmt: skip


def check_compiled() -> Finding:
    """Says where compiled code is kept from one process to the next."""
    folder = all_finite.stats.cache_path  # That of numba's dispatcher.
    if folder:
        return Finding("compiled code", Grade.GOOD, f"is kept in {folder}")
    return Finding(
        "compiled code",
        Grade.LACKING,
        "cannot be kept: each process compiles anew, for a quarter of a minute",
        "set NUMBA_CACHE_DIR to a folder that can be written",
    )


def check_wires(patience: float = PATIENCE) -> Iterator[Finding]:
    """Yields whether messages come through on this machine, over each middleware.

    Args:
        patience: [s] to try for.
    """
    for name, config in WIRES.items():
        try:
            with (
                open_link(config, Role.ROBOT) as robot,
                open_link(config, Role.CONTROLLER) as controller,
            ):
                exposure = controller.exposure
                latency = _latency(robot, controller, patience)
        except UserError as error:
            yield Finding(name, Grade.LACKING, "cannot be used", str(error))
            continue
        if latency is None:
            yield Finding(
                name,
                Grade.LACKING,
                f"no message comes through on this machine within {patience:g} s",
                "ip link set lo up multicast on; ip route add 224.0.0.0/4 dev lo; and look at "
                "the firewall",
            )
        else:
            says = f"a message takes {1e3 * latency:.2f} ms on this machine, median"
            grade = Grade.LACKING if exposure else Grade.GOOD
            yield Finding(name, grade, says, exposure)


def _latency(robot: Link, controller: Link, patience: float) -> float | None:
    """Returns how long a message is on its way [s], median; None where none arrives."""
    end = time.monotonic() + patience
    latencies: list[float] = []
    for stamp in itertools.count(1):
        if len(latencies) == MESSAGES or time.monotonic() > end:
            return float(np.median(latencies)) if latencies else None
        sent = time.monotonic()
        robot.send(Odometry(stamp, np.zeros(POSE_SIZE), np.zeros(POSE_SIZE)))
        controller.wait(0.05)
        latencies += [m.arrival - sent for m in controller.take(Odometry) if m.stamp == stamp]
    raise AssertionError  # itertools.count has no end.
