"""The guard as a process of its own: how a controller starts it, and what runs in it."""

import contextlib
import dataclasses as dc
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Self

import numpy as np
from pydrake.common.yaml import yaml_dump_typed

from mirte_drake.errors import UserError
from mirte_drake.hardware.governor_config import GovernorConfig
from mirte_drake.hardware.guard import run_guard
from mirte_drake.hardware.link import Role
from mirte_drake.hardware.wire_config import LcmWireConfig, Ros2WireConfig, WireConfig, open_link
from mirte_drake.typed_yaml import parse_typed

READY = "ready"  # What a guard says on stdout once it is on the wire.
START_UP = 10.0  # [s] in which it must.
LINGER = 2.0  # [s] A child goes on saying that the wheels stand still without its parent.
STOP_PATIENCE = 3.0  # [s]
REAL_TIME_PRIORITY, NICE = 10, -10  # Of SCHED_FIFO; where that is not allowed.


@dc.dataclass
class GuardSetup:
    """All that a guard is told when it starts."""

    wire: Ros2WireConfig | LcmWireConfig = dc.field(default_factory=Ros2WireConfig)
    governor: GovernorConfig = dc.field(default_factory=GovernorConfig)
    start: np.ndarray = dc.field(default_factory=lambda: np.zeros(3))  # (3,) [m, m, rad]
    parent: int = 0  # Process without which it ends; 0: it ends when it is told.


@dc.dataclass(frozen=True)
class GuardProcess:
    """A guard that runs as a child of this process; as a context, until the end of that."""

    process: subprocess.Popen

    @property
    def alive(self) -> bool:
        """Whether it runs."""
        return self.process.poll() is None

    def stop(self) -> bool:
        """Ends it, and tells whether it went as it should, with the wheels standing still."""
        self.process.terminate()
        try:
            return self.process.wait(STOP_PATIENCE) == 0
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            return False

    def __enter__(self) -> Self:
        """Returns itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Ends it."""
        self.stop()


def start_guard(
    wire: WireConfig, governor: GovernorConfig, start: np.ndarray, *, patience: float = START_UP
) -> GuardProcess:
    """Starts a guard, and returns when it is on the wire and has sent zeros to the wheels.

    It has a session of its own, so that Ctrl-C reaches the controller alone; when this process is
    gone, however it went, the guard stops the robot and ends a little later.

    Args:
        wire: The wire.
        governor: Limits of the governor.
        start: (3,) [m, m, rad] pose of the path where the drive begins.
        patience: [s] in which it must have started.

    Raises:
        UserError: in one line, when it cannot start.
    """
    setup = GuardSetup(wire, governor, np.asarray(start, dtype=float), os.getpid())
    process = subprocess.Popen(
        [sys.executable, "-m", __name__],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},  # Its matrices have four rows.
    )
    assert process.stdin is not None
    assert process.stdout is not None
    with contextlib.suppress(OSError), process.stdin:  # It may be dead already.
        process.stdin.write(yaml_dump_typed(setup))
    answer = ""
    if select.select([process.stdout], [], [], patience)[0]:
        answer = process.stdout.readline().strip()
    if answer == READY:
        return GuardProcess(process)
    process.kill()
    code = process.wait()
    raise UserError(f"guard: did not start: {answer or f'no answer, exit code {code}'}")


def serve(setup: GuardSetup, on_ready: Callable[[], None] = lambda: None) -> None:
    """Runs a guard in this process until SIGTERM, SIGINT, or some time after its parent is gone.

    Args:
        setup: All that it is told.
        on_ready: Called when it is on the wire and has sent zeros to the wheels.

    Raises:
        UserError: when the wire cannot be used.
        ValueError: when ``setup`` is out of range.
    """
    told: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, _: told.append(number))
    _raise_priority()
    alone_since: float | None = None

    def over() -> bool:
        nonlocal alone_since
        if setup.parent in (0, os.getppid()):
            return bool(told)
        alone_since = alone_since or time.monotonic()
        return bool(told) or time.monotonic() - alone_since > LINGER

    with open_link(setup.wire, Role.GUARD) as link:
        run_guard(link, setup.governor, setup.start, on_ready=on_ready, until=over)


def main() -> int:
    """Runs the guard that stdin tells of, and says on stdout that it is ready, or why it is not."""
    try:
        serve(parse_typed(GuardSetup, sys.stdin.read(), "guard"), lambda: print(READY, flush=True))
    except Exception as error:
        print(" ".join(str(error).split()) or type(error).__name__, flush=True)
        return 1
    return 0


def _raise_priority() -> None:
    """Asks to run before others; a user who may not ask for it does without."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(REAL_TIME_PRIORITY))
    except (AttributeError, OSError):
        with contextlib.suppress(OSError):
            os.nice(NICE)


if __name__ == "__main__":
    sys.exit(main())
