"""Imported by the fork server alone: all that guard, controller and robot need, ready to run.

A short simulation compiles what is compiled on its first call. Nothing is opened here. What is
there then is here to stay: no garbage collection of a process that is forked looks through it.
"""

import gc

from mirte_drake.faults import trial
from mirte_drake.run import simulate
from mirte_drake.scenario_file import load_scenario

simulate(load_scenario(trial.SCENARIO, ["duration=0.2"]), "preload")
gc.collect()
gc.freeze()
