"""Drives a robot in another process, over LCM: the Diagram of the simulation, but for the robot.

The first function puts a stand-in on the wire, as ``mirte-drake robot`` does; leave it out where a
real robot is there. A guard, a process of its own, has the last word on the wire: whatever happens
to the controller, the wheels stand within a quarter of a second.

Prints:

    31 samples, no solve failed
    wheels at rest afterwards: True
"""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from mirte_drake.drive import drive
from mirte_drake.hardware.messages import GuardStatus
from mirte_drake.run_summary import summarise
from mirte_drake.scenario_file import load_scenario
from mirte_drake.wire_session import wire_to

WIRE = "udpm://239.255.76.67:7668?ttl=0"  # Loopback; a port of its own.
OVERRIDES = [f'robot=!LcmRobotConfig {{wire: {{url: "{WIRE}"}}}}', "duration=3.0"]


@contextmanager
def stand_in() -> Iterator[None]:
    command = [sys.executable, "-m", "mirte_drake", "robot", "rectangle"]
    command += ["--transport", "lcm", "--wire", f"url={WIRE}"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as robot:
        robot.stderr.readline()  # It says when it is there.
        try:
            yield
        finally:
            robot.terminate()


def main() -> None:
    scenario = load_scenario("rectangle", OVERRIDES)
    with stand_in():
        with wire_to(scenario) as (link, session):
            run = drive(scenario, "rectangle", link, session)
        failures = summarise(run)["solve_failures"]
        print(f"{len(run.log['time'])} samples, {failures or 'no'} solve failed", run.ended)
        print("wheels at rest afterwards:", not np.any(link.latest(GuardStatus).command))


if __name__ == "__main__":
    main()
