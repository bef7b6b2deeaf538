"""Starts a guard as a process of its own, and ends it."""

import selectors
import signal
import subprocess
import sys

import numpy as np
from pydrake.common.yaml import yaml_dump_typed

from mirte_drake.errors import UserError
from mirte_drake.hardware.governor_config import GovernorConfig
from mirte_drake.hardware.guard import READY, GuardOrder
from mirte_drake.hardware.wire_config import WireConfig

START_TIMEOUT = 20.0  # [s] The first import after an installation takes long.
END_TIMEOUT = 3.0  # [s]


class GuardProcess:
    """A guard of one session; it outlives this process for as long as the wheels need it.

    Attributes:
        pid: Its number.
    """

    def __init__(self, process: subprocess.Popen[str]) -> None:
        """Takes over a process that is ready."""
        self._process = process
        self.pid = process.pid

    def stop(self) -> None:
        """Has it set the wheels to zero and end."""
        self._process.send_signal(signal.SIGTERM)
        try:
            self._process.wait(END_TIMEOUT)
        except subprocess.TimeoutExpired:  # It hangs; the controller has sent zeros itself.
            self._process.kill()
            self._process.wait()


def start_guard(wire: WireConfig, governor: GovernorConfig, start: np.ndarray) -> GuardProcess:
    """Starts a guard and returns once it guards.

    It has a session of its own, so that Ctrl-C in the terminal does not end it before the
    controller; what it logs goes to this process's standard error.

    Args:
        wire: The wire.
        governor: Its limits.
        start: (3,) [m, m, rad] where the path begins.

    Raises:
        UserError: when it does not come up.
    """
    process = subprocess.Popen(
        [sys.executable, "-m", "mirte_drake.hardware.guard"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdin is not None and process.stdout is not None
    process.stdin.write(yaml_dump_typed(GuardOrder(wire, governor, start)))
    process.stdin.close()
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ)
        said = process.stdout.readline() if selector.select(START_TIMEOUT) else ""
    if said.strip() != READY:
        process.kill()
        process.wait()
        raise UserError("guard: did not come up; what it says is above")
    return GuardProcess(process)
