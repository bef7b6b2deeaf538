"""The pages in a browser: replay and live. Their pictures are in the tests' temporary folder."""

import dataclasses as dc

import numpy as np
import pytest

from mirte_drake.live import watch
from mirte_drake.replay import load_run, run_page
from mirte_drake.robots.names import robot_override
from mirte_drake.run import simulate
from mirte_drake.run_summary import save_run
from mirte_drake.scenario_file import load_scenario
from mirte_drake.visualization.live_disturbance import PUSH_BUTTON
from mirte_drake.visualization.meshcat_server import local_meshcat
from mirte_drake.visualization.run_controls import STOP

pytestmark = pytest.mark.slow

MULTIBODY = (robot_override("multibody"), "robot.floor_friction=0.2")
RUNS = {
    "rectangle": ("rectangle",),
    "circle": ("circle",),
    "turning_circle": ("turning_circle",),
    "multibody": ("rectangle", *MULTIBODY, "duration=7"),
}


@pytest.fixture(scope="module")
def page_of(tmp_path_factory):
    """Writes the page of a run, once."""
    pages = {}

    def write(key):
        if key not in pages:
            folder = tmp_path_factory.mktemp(key)
            name, *overrides = RUNS[key]
            save_run(simulate(load_scenario(name, overrides), name), folder)
            pages[key] = folder / "replay.html"
            pages[key].write_text(run_page(load_run(folder)))
        return pages[key]

    return write


def opened(browser, page):
    browser.open(page)
    browser.wait_until("viewer.animator.duration > 0")
    return browser


def stopped_at(browser, time):
    """Stops the replay at a time [s], without a click."""
    browser.evaluate("viewer.animator.pause()")
    browser.evaluate(f"viewer.animator.seek({time})")
    rendered(browser)


def rendered(browser):
    """Waits until the page has drawn what it was told."""
    browser.wait_until("!viewer.needs_render", timeout=60)


@dc.dataclass
class Seen:
    """What one part of the scene adds to the picture."""

    pixels: int
    color: np.ndarray  # (3,) mean of these pixels.
    inside: bool  # Whether none touches the picture's edge.


def seen(browser, path, picture) -> Seen:
    """Finds the pixels that a part of the scene takes, by hiding it."""
    node = f"viewer.scene_tree.find({path!r}.split('/')).object"
    browser.evaluate(f"{node}.visible = false, viewer.set_dirty()")
    rendered(browser)
    without = browser.screenshot()
    browser.evaluate(f"{node}.visible = true, viewer.set_dirty()")
    taken = np.max(np.abs(picture - without), axis=2) > 0.05
    edge = taken[0].any() or taken[-1].any() or taken[:, 0].any() or taken[:, -1].any()
    return Seen(int(taken.sum()), picture[taken].mean(axis=0), not edge)


@pytest.mark.parametrize("key", RUNS)
def test_robot_tube_and_path_are_seen_without_a_click(key, page_of, browser, tmp_path):
    page = page_of(key)
    browser.resize(1120, 630)  # No larger than it must be: a page is drawn without a graphics card.
    opened(browser, page)
    stopped_at(browser, 6.0)  # The trail is short yet.
    picture = browser.screenshot(tmp_path / f"{key}.png")
    robot, tube, path, trail = (
        seen(browser, f"mirte/{name}", picture)
        for name in ("robot", "tube", "reference/path", "trail/measured")
    )
    assert robot.pixels > 5000 and robot.inside
    assert tube.pixels > 300 and tube.inside
    assert tube.color[2] > tube.color[0] + 0.15  # Blue.
    assert path.pixels > 1000 and path.inside
    assert path.color.max() < 0.35  # Black.
    assert trail.pixels > 150 and trail.color[0] > trail.color[1:].max() + 0.15  # Red.
    assert browser.errors == []
    assert browser.requests == [page.as_uri()]


def test_the_replay_plays_by_itself_and_its_player_works(page_of, browser):
    opened(browser, page_of("rectangle"))
    browser.wait_until("viewer.animator.time > 0.5")
    browser.click_on("document.querySelector('#play')")
    browser.wait_until("!viewer.animator.playing")
    browser.wait_until("document.querySelector('#play').ariaLabel === 'Play'")
    # A click in the middle of the time line goes to the middle of the run.
    browser.click_on("document.querySelector('#time')")
    browser.wait_until("Math.abs(document.querySelector('#time').value - 12.5) < 0.5")
    clock = browser.evaluate("document.querySelector('#clock').value")
    assert clock.endswith(" / 25.0 s") and clock.startswith("12.")
    x = browser.evaluate("viewer.scene_tree.find(['mirte', 'robot']).object.position.x")
    assert x == pytest.approx(0.3, abs=0.05)  # The second corner of the rectangle.
    browser.evaluate("document.activeElement.blur()")
    for kind in ("keyDown", "keyUp"):
        browser.call("Input.dispatchKeyEvent", type=kind, code="Space", key=" ")
    browser.wait_until("viewer.animator.playing")
    browser.evaluate(
        "(() => { const speed = document.querySelector('#speed'); speed.value = '4';"
        " speed.dispatchEvent(new Event('change')) })()"
    )
    assert browser.evaluate("viewer.animator.mixer.timeScale") == 4
    assert browser.errors == []


def test_light_and_dark_follow_the_user(page_of, browser):
    browser.prefer(dark=True)
    opened(browser, page_of("rectangle"))
    browser.wait_until("document.body.classList.contains('dark')")
    stopped_at(browser, 1.0)
    assert browser.screenshot()[300:400, :50].mean() < 0.2
    browser.click_on("document.querySelector('#shade')")
    rendered(browser)
    assert browser.screenshot()[300:400, :50].mean() > 0.8
    assert browser.errors == []


@pytest.mark.parametrize("key", ["rectangle", "multibody"])
def test_the_live_page_shows_the_robot_and_obeys(key, browser, tmp_path):
    name, *overrides = RUNS[key]
    meshcat = local_meshcat(show_rate=True)
    browser.resize(1120, 630)
    browser.open(meshcat.web_url())
    found = {}

    def row(text):
        rows = "[...document.querySelectorAll('.dg li.cr')]"
        return f"{rows}.find(row => row.textContent.includes('{text}'))"

    def hands():
        """While the robot waits for an answer: looks, opens the controls, uses them."""
        hands.calls += 1
        if hands.calls == 60:
            browser.wait_until("viewer.scene_tree.children.mirte?.children.trail")
            rendered(browser)
            picture = browser.screenshot(tmp_path / f"live_{key}.png")
            for part in ("robot", "tube", "reference/path"):
                found[part] = seen(browser, f"mirte/{part}", picture)
            browser.click_on("document.querySelector('.close-button')")
            if key == "rectangle":
                browser.click_on(row(PUSH_BUTTON))
                found["pushes"] = clicks(PUSH_BUTTON)
            browser.click_on(row(STOP))
            clicks(STOP)
        return True

    def clicks(button):
        for _ in range(100):
            if meshcat.GetButtonClicks(button):
                break
            browser.wait(0.1)
        return meshcat.GetButtonClicks(button)

    hands.calls = 0
    pace = watch(load_scenario(name, overrides), meshcat, ready=hands)
    assert pace.simulated == pytest.approx(2.0)  # It was stopped after 60 pictures.
    assert found["robot"].pixels > 5000 and found["robot"].inside
    assert found["tube"].pixels > 300 and found["tube"].color[2] > found["tube"].color[0] + 0.15
    assert found["reference/path"].pixels > 1000
    if key == "rectangle":
        assert found["pushes"] == 1
    assert browser.errors == []
    assert all(request.startswith(meshcat.web_url()) for request in browser.requests)
