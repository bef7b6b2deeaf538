import os
import subprocess
import time

import pytest

from mirte_drake.faults.processes import be_punctual, child_of, is_alive, waiting_time

pytestmark = pytest.mark.xdist_group("wire")  # In real time: one after the other.


@pytest.fixture
def family():
    """A process with one child."""
    parent = subprocess.Popen(["sh", "-c", "sleep 30 & wait"])
    yield parent
    parent.kill()
    parent.wait()


def eventually(condition):
    end = time.monotonic() + 5.0
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.01)
    return False


def children(pid):
    try:
        return [child_of(pid)]
    except RuntimeError:
        return []


def test_a_guards_number_is_found(family):
    assert eventually(lambda: children(family.pid))
    child = child_of(family.pid)
    assert is_alive(child)
    with pytest.raises(RuntimeError, match="has 0 children"):
        child_of(child)
    os.kill(child, 9)
    assert eventually(lambda: not is_alive(child))


def test_a_process_that_has_ended_is_not_alive_though_nobody_has_waited_for_it(family):
    assert is_alive(family.pid)
    family.kill()
    assert eventually(lambda: not is_alive(family.pid))
    family.wait()
    assert not is_alive(family.pid)


def test_waiting_for_a_processor_adds_up():
    first = waiting_time(os.getpid())
    time.sleep(0.01)
    assert waiting_time(os.getpid()) >= first >= 0.0
    assert waiting_time(2**22 + 1) == 0.0  # Nobody's number.


def test_punctuality_is_taken_back():
    before = os.sched_getscheduler(0)
    be_punctual(True)
    be_punctual(False)
    assert os.sched_getscheduler(0) == before == os.SCHED_OTHER
