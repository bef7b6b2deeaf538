"""A controller that starts a guard, says so, and then sleeps until somebody ends it.

Usage: python guard_parent.py, with the YAML of a GuardSetup on stdin.
"""

import sys
import time

from mirte_drake.hardware.guard_process import GuardSetup, start_guard
from mirte_drake.typed_yaml import parse_typed

setup = parse_typed(GuardSetup, sys.stdin.read(), "stdin")
guard = start_guard(setup.wire, setup.governor, setup.start)
print(guard.process.pid, flush=True)
time.sleep(60)
