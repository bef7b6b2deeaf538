import inspect

import numpy as np
import pytest
from fault_records import drive, odometry

from mirte_drake.errors import UserError
from mirte_drake.faults.kind import Kind, drives_on, stops, yaw_crosses
from mirte_drake.faults.kinds import KINDS, find_kind
from mirte_drake.faults.oracle import at_fault
from mirte_drake.faults.sabotage import Sabotage, fail
from mirte_drake.faults.trial import Trial, scenarios
from mirte_drake.hardware import governor
from mirte_drake.scenario import wired_robot


def test_there_are_enough_kinds_each_with_its_outcome():
    assert len(KINDS) >= 25
    for name, kind in KINDS.items():
        assert name == kind.name and kind.name.isidentifier()
        assert kind.outcome.startswith(("drives on", "zero within 0.25 s of", "zero within 0.35 s"))
        # While the rectangle's first side lasts, 5.85 s, the robot must move.
        assert kind.begin[1] + kind.observe < 5.5


def test_only_signals_may_take_longer():
    longer = {name for name, kind in KINDS.items() if kind.within > 0.25}
    assert longer == {
        "controller_sigkill",
        "controller_sigstop",
        "guard_sigkill",
        "guard_sigstop",
        "guard_then_controller_killed",
    }
    assert {KINDS[name].within for name in longer} == {0.35}


def test_reasons_of_the_guard_are_its_own():
    told = inspect.getsource(governor)
    others = ("interrupted", "RuntimeError: sabotaged", "the guard has said nothing", "")
    for kind in KINDS.values():
        for reason in kind.reasons:
            assert reason in others or reason in told, kind.name


def test_a_kind_that_is_not_known():
    assert find_kind("odometry_stops") is KINDS["odometry_stops"]
    with pytest.raises(UserError, match="--list"):
        find_kind("odometry_stop")


@pytest.mark.parametrize("transport", ["ros2", "lcm"])
def test_every_kind_has_its_scenario_and_each_trial_a_wire_of_its_own(transport):
    wires = set()
    for number, kind in enumerate(KINDS.values()):
        driven, robot = scenarios(Trial(kind.name, transport, 0, 3, number), kind)
        driven.validate()
        assert robot.seed == 3
        wires.add(repr(wired_robot(driven).wire))
    assert len(wires) == len(KINDS)
    with pytest.raises(UserError, match="transport"):
        scenarios(Trial("odometry_stops", "serial", 0, 0, 0), KINDS["odometry_stops"])


def test_whether_a_fault_took_place():
    kind = drives_on("lost", odometry=lambda passing: [])
    assert not kind.took_place(drive())
    record = drive()
    assert kind.took_place(drive(odometry=[s for s in record.odometry if s.measured < 0.95]))
    gap = [s for s in record.odometry if not 0.95 < s.measured < 1.05]
    assert kind.took_place(drive(odometry=gap))
    assert kind.took_place(drive(odometry=[*record.odometry, odometry(2.0, altered=True)]))
    # What was altered before the fault is not the fault's.
    assert not kind.took_place(drive(odometry=[odometry(0.5, altered=True), *record.odometry]))
    sabotaged = stops("x", "y", "z", at_fault, sabotage=Sabotage(fail))
    assert not sabotaged.took_place(drive())
    assert sabotaged.took_place(drive(acted=[1.1]))
    assert stops("x", "y", "z", at_fault).took_place(drive())


def test_a_yaw_at_pi_must_cross():
    assert not yaw_crosses(drive())
    crossing = [odometry(t, pose=[0, 0, yaw]) for t, yaw in ((0.5, 3.1), (0.6, -3.1), (0.7, -3.0))]
    assert yaw_crosses(drive(odometry=crossing))
    assert not yaw_crosses(drive(odometry=crossing[1:]))
    assert isinstance(KINDS["yaw_at_pi"], Kind) and np.pi > 3.1
