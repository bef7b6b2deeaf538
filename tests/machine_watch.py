"""Watches, as a process of its own, whether the machine keeps the pace of the clock.

A machine that others share, or a virtual one, stands still at times, which fails a test in real
time without a fault in what it tests. Only that gives such a test another try, not its failure.
"""

import os
import re
import select
import subprocess
import sys
import time
from collections import deque
from contextlib import contextmanager, suppress
from pathlib import Path

PERIOD = 0.005  # [s] Of looking.
WINDOW = 0.1  # [s] In which what other machines took counts as one standstill.
ALLOWED = 0.02  # [s] The guard's margin: it stops the wheels 0.02 s before it must have.
PUNCTUAL = "punctual"  # Says the watch that may go before all that a test runs.
PRIORITY = 30  # In real time: above that of guards and controllers.

_longest = 0.0


def stood_still():
    """Whether the machine stood still for longer than allowed while it was last watched."""
    return _longest > ALLOWED


@contextmanager
def watching():
    """Watches the machine, and tells on the way out for how long it stood still."""
    global _longest
    _longest = 0.0
    watch = subprocess.Popen(
        [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    watch.punctual = watch.stdout.readline() == f"{PUNCTUAL}\n"
    try:
        yield watch
    finally:
        _longest = float(watch.communicate()[0] or 0.0)
        print(f"the machine stood still for {_longest:.3f} s at the most")


def stolen(stat):
    """Returns by processor the time [s] that other virtual machines took, of /proc/stat."""
    lines = [line.split() for line in stat.splitlines() if re.match(r"cpu\d", line)]
    return [int(line[8]) / os.sysconf("SC_CLK_TCK") for line in lines]


def stolen_now():
    try:
        return stolen(Path("/proc/stat").read_text())
    except OSError:  # It is Linux's.
        return [0.0]


def main():
    """Prints that it watches, and, once its input is closed, for how long [s] all stood still."""
    punctual = False
    with suppress(OSError, AttributeError):  # Without it, the test's own load holds it up, too.
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))
        punctual = True
    print(PUNCTUAL if punctual else "late", flush=True)
    longest, watched = 0.0, True
    taken = deque(maxlen=round(WINDOW / PERIOD))
    while watched:
        before = time.monotonic()
        watched = not select.select([sys.stdin], [], [], PERIOD)[0]
        if punctual:
            longest = max(longest, time.monotonic() - before - PERIOD)
        taken.append(stolen_now())
        longest = max(longest, *(b - a for a, b in zip(taken[0], taken[-1], strict=True)))
    print(longest)


if __name__ == "__main__":
    main()
