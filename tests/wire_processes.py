"""The stand-in for the robot as a process of its own, as the command line starts it."""

import os
import re
import signal
import subprocess
import sys
from contextlib import contextmanager

from ros2_wire import free_domain

# No two processes of tests meet: a domain of DDS and a port of LCM for each.
DOMAIN = free_domain()
WIRES = {
    "ros2": ["--transport", "ros2", "--wire", f"domain={DOMAIN}"],
    "lcm": [
        "--transport",
        "lcm",
        "--wire",
        f"url=udpm://239.255.76.67:{20000 + os.getpid() % 10000}?ttl=0",
    ],
}


class Robot:
    """Of ``robot_process``; ``said`` is what it printed, once it has ended."""

    def __init__(self, process):
        self._process = process
        self.said = ""

    def end(self):
        self._process.send_signal(signal.SIGINT)
        self.said = self._process.communicate(timeout=20)[0]

    def percentile(self, name):
        """Latency [ms] from odometry to command as the robot saw it."""
        return float(re.search(rf"([\d.]+) ms {name}", self.said)[1])


@contextmanager
def robot_process(transport, *arguments):
    process = subprocess.Popen(
        [sys.executable, "-m", "mirte_drake", "robot", *arguments, *WIRES[transport]],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    robot = Robot(process)
    try:
        for line in process.stderr:
            if "is on the wire" in line:
                break
        yield robot
    finally:
        if process.poll() is None:
            robot.end()
        process.stdout.close()
        process.stderr.close()
