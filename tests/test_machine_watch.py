import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import machine_watch
import pytest

TESTS = Path(__file__).parent

STAT = """cpu  2260131 85619 68613 432287 5243 0 1331 999 0 0
cpu0 1067975 41389 31792 283368 1452 0 229 {} 0 0
cpu1 1192155 44229 36820 148918 3791 0 1102 {} 0 0
intr 1 2 3
"""


def test_what_others_took_is_counted_by_processor():
    ticks = os.sysconf("SC_CLK_TCK")
    assert machine_watch.stolen(STAT.format(3 * ticks, ticks)) == [3.0, 1.0]


def test_a_watch_that_stands_still_tells():
    with machine_watch.watching() as watch:
        if not watch.punctual:
            pytest.skip("needs the right to real-time priority: its own delay does not count")
        watch.send_signal(signal.SIGSTOP)
        time.sleep(0.3)
        watch.send_signal(signal.SIGCONT)
    assert machine_watch.stood_still()


CONFTEST = f"""
import contextlib, runpy, sys

sys.path.insert(0, {str(TESTS)!r})
import machine_watch

@contextlib.contextmanager
def watching():
    machine_watch._longest = {{longest}}
    yield

machine_watch.watching = watching
ours = runpy.run_path({str(TESTS / "conftest.py")!r})
pytest_collection_modifyitems = ours["pytest_collection_modifyitems"]
_watched_machine = ours["_watched_machine"]
"""
A_TEST = """
import pytest

@pytest.mark.realtime
def test_that_fails():
    assert False
"""


@pytest.mark.parametrize(("longest", "tries"), [(0.0, 1), (0.3, 3)])
def test_only_a_machine_that_stood_still_gives_another_try(tmp_path, longest, tries):
    (tmp_path / "conftest.py").write_text(CONFTEST.format(longest=longest))
    (tmp_path / "test_a.py").write_text(A_TEST)
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = realtime: keeps the pace\n")
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "no:xdist"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    again = int((re.findall(r"(\d) rerun", done.stdout) or ["0"])[0])
    assert "1 failed" in done.stdout, done.stdout
    assert again + 1 == tries, done.stdout


def test_what_is_allowed_is_the_guards_margin(monkeypatch):
    for longest, stood in ((0.0, False), (machine_watch.ALLOWED, False), (0.1, True)):
        monkeypatch.setattr(machine_watch, "_longest", longest)
        assert machine_watch.stood_still() is stood
