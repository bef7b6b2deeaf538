import os
import signal
import time

import machine_watch
import pytest

STAT = "cpu  2260131 85619 68613 432287 5243 0 1331 {} 0 0\ncpu0 1067975 41389 31792\n"


def test_what_others_took_is_in_the_first_line_of_the_kernels_count():
    ticks = os.sysconf("SC_CLK_TCK")
    assert machine_watch.stolen(STAT.format(3 * ticks)) == 3.0


def test_a_watch_that_stands_still_tells():
    with machine_watch.watching() as watch:
        time.sleep(0.5)
        watch.send_signal(signal.SIGSTOP)
        time.sleep(0.3)
        watch.send_signal(signal.SIGCONT)
    if os.geteuid() != 0:
        pytest.skip("needs the right to real-time priority: else its own delay does not count")
    assert machine_watch.stood_still()


@pytest.mark.realtime
def test_only_a_machine_that_stood_still_gives_another_try(request, monkeypatch):
    again = request.node.get_closest_marker("flaky").kwargs["condition"]
    for longest, tries in ((0.0, False), (machine_watch.ALLOWED, False), (0.1, True)):
        monkeypatch.setattr(machine_watch, "_longest", longest)
        assert again() is tries
