"""Reports of saved runs, and what can be wrong with a folder."""

import json
import shutil

import numpy as np
import pytest

from mirte_drake.errors import UserError
from mirte_drake.reporting import load_run, save_comparison, save_report
from mirte_drake.robots.names import robot_override
from mirte_drake.run import simulate
from mirte_drake.run_summary import RUN_FILES, save_run
from mirte_drake.scenario_file import load_scenario

SETTINGS = [robot_override("dynamic"), "duration=1"]


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    run = simulate(load_scenario("rectangle", SETTINGS), "rectangle")
    save_run(run, folder)
    return folder, run


@pytest.fixture
def folder(saved, tmp_path):
    """A copy that may be damaged."""
    return shutil.copytree(saved[0], tmp_path / "run")


def test_a_saved_run_is_read_as_it_was(saved):
    folder, run = saved
    read = load_run(folder)
    assert (read.name, read.robot, read.period) == ("rectangle", "dynamic", 0.1)
    np.testing.assert_array_equal(read.log["pose"], run.log["pose"])
    assert read.summary["steps"] == 11
    assert len(read.tube[0]) == 10
    assert read.controller == "tube NMPC" and read.odometry
    assert read.scenario == (folder / RUN_FILES[2]).read_text()


def test_the_report_has_the_diagram_of_the_run(folder):
    path = save_report(folder)
    assert path == folder / "report.html"
    text = path.read_text()
    for title in ("Nominal NMPC", "Tube updater", "Dynamic robot", "Odometry sensor"):
        assert title in text
    assert "<iframe" not in text


def test_a_replay_in_the_folder_comes_into_the_report(folder, tmp_path, blank_figures):
    (folder / "replay.html").write_text("<p>a robot that moves</p>")
    text = save_report(folder, tmp_path / "mine.html").read_text()
    assert 'srcdoc="&lt;p&gt;a robot that moves&lt;/p&gt;"' in text
    assert not (folder / "report.html").exists()


@pytest.mark.parametrize("name", RUN_FILES)
def test_a_missing_file_is_named(folder, name):
    (folder / name).unlink()
    with pytest.raises(UserError, match=f"{name}: is missing; name the folder"):
        save_report(folder)


@pytest.mark.parametrize(
    ("name", "content"),
    [("log.npz", b"not a zip"), ("log.npz", b"PK\x03\x04 cut"), ("summary.json", b"{"),
     ("log.npz", b"")],
)  # fmt: skip
def test_a_damaged_file_is_named(folder, name, content):
    (folder / name).write_bytes(content)
    with pytest.raises(UserError, match=f"{name}: is damaged; run it again"):
        load_run(folder)


def test_a_model_that_is_gone_is_named(folder):
    file = folder / RUN_FILES[2]
    file.write_text(file.read_text().replace("extended_kinematic", "gone.yaml"))
    with pytest.raises(UserError, match=r"prediction_model: .*gone.yaml"):
        save_report(folder)


def test_without_the_wire_there_is_a_report_all_the_same(folder, monkeypatch, blank_figures):
    def no_wire(scenario):
        raise UserError("robot.wire: cyclonedds is not installed")

    monkeypatch.setattr("mirte_drake.reporting.MakeDiagram", no_wire)
    assert "No picture: robot.wire: cyclonedds is not" in save_report(folder).read_text()


def test_runs_are_compared_by_their_folders(folder, tmp_path, blank_figures):
    other = shutil.copytree(folder, tmp_path / "other")
    summary = json.loads((other / "summary.json").read_text())
    (other / "summary.json").write_text(json.dumps({**summary, "seed": 5}))
    scenario = other / RUN_FILES[2]
    scenario.write_text(scenario.read_text().replace("seed: 0", "seed: 5"))
    text = save_comparison([folder, other], tmp_path / "both.html").read_text()
    assert "2 runs, 1 settings" in text and str(other) in text
    with pytest.raises(UserError, match="the same run is named twice"):
        save_comparison([folder, folder], tmp_path / "both.html")


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 400])
def test_a_browser_opens_the_report(width, folder, browser):
    """Without errors, without a request, light and dark, from a telephone on, and the replay."""
    (folder / "replay.html").write_text(
        "<body><script>document.body.style.background = '#00ff00'</script>"
    )
    browser.call(
        "Emulation.setDeviceMetricsOverride", width=width, height=720, deviceScaleFactor=1,
        mobile=False,
    )  # fmt: skip
    path = save_report(folder)
    browser.open(path)
    assert [url for url in browser.requests if not url.startswith("data:")] == [path.as_uri()]
    assert browser.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert browser.evaluate("document.fonts.check('9px STIXGeneral')")
    light = browser.screenshot()
    browser.prefer(dark=True)
    browser.wait(0.2)
    dark = browser.screenshot()
    assert light[5, 5].min() > 0.9 and dark[5, 5].max() < 0.1  # The ground, in the corner.
    browser.evaluate("document.querySelector('iframe').scrollIntoView()")
    browser.wait(1.0)
    np.testing.assert_allclose(browser.screenshot()[200, width // 2], [0, 1, 0], atol=0.02)
    assert browser.errors == []
