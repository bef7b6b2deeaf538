from collections.abc import Iterator
from pathlib import Path

import machine_watch
import pytest
from browser import Browser, chromium
from markupsafe import Markup

from mirte_drake.visualization.page import Page

ROOT = Path(__file__).parents[1]


def pytest_collection_modifyitems(config, items):
    """Lets tests in real time have another try, but only where the machine stood still."""
    if config.option.usepdb:  # Which no test may have that is run again.
        return
    again = pytest.mark.flaky(reruns=2, condition=machine_watch.stood_still)
    for item in items:
        if item.get_closest_marker("realtime"):
            item.add_marker(again)


@pytest.fixture(autouse=True)
def _watched_machine(request):
    if not request.node.get_closest_marker("realtime"):
        yield
        return
    with machine_watch.watching():
        yield


@pytest.fixture(scope="session")
def recordings() -> Path:
    """Folder of the robot's recordings, which lie beside the project and have no licence."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"the robot's recordings are not in ../shared/data: {folder}")
    return folder


@pytest.fixture
def browser() -> Iterator[Browser]:
    """A headless Chromium, from the system: it is no Python package."""
    if chromium() is None:
        pytest.skip("there is no Chromium here; on Debian and Ubuntu: apt install chromium")
    with Browser() as page:
        yield page


@pytest.fixture
def blank_figures(monkeypatch):
    """Pages without the time that drawing takes."""
    monkeypatch.setattr(Page, "plot", lambda self, draw, label: Markup("<svg></svg>"))
