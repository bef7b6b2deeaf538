"""The site is true and whole: its code runs, it builds without warnings, and it opens offline."""

import re
import subprocess
import sys
from pathlib import Path
from typing import get_args

import pages
import pytest

from mirte_drake.robots.measured_robot import RobotConfig
from mirte_drake.scenario import KINDS

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
TUTORIAL = DOCS / "tutorial"
PAGES = sorted(
    path for folder in (".", "concepts", "guides") for path in (DOCS / folder).glob("*.md")
)


def tutorial_pages() -> list[Path]:
    """Returns the pages of the tutorial in their order."""
    index = (TUTORIAL / "index.md").read_text()
    names = re.search(r"```\{toctree\}\n(?::.*\n)*\n((?:\w+\n)+)```", index)[1].split()
    return [TUTORIAL / f"{name}.md" for name in names]


def run_pages(paths, monkeypatch, folder) -> int:
    monkeypatch.chdir(folder)
    every = [block for path in paths for block in pages.blocks(path)]
    with pages.Reader() as reader:
        for block in every:
            reader.run(block)
    return sum(not block.not_run for block in every)


@pytest.mark.slow
@pytest.mark.xdist_group("wire")
def test_the_tutorial_runs_in_one_folder(tmp_path, monkeypatch):
    assert run_pages(tutorial_pages(), monkeypatch, tmp_path) > 10
    assert {path.stem for path in TUTORIAL.glob("*.md")} == {
        "index",
        *(path.stem for path in tutorial_pages()),
    }
    for name in "mine.yaml", "runs/own_path/summary.json", "runs/quick/summary.json":
        assert (tmp_path / name).is_file()


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_every_block_of_a_page_runs(path, tmp_path, monkeypatch):
    run_pages([path], monkeypatch, tmp_path)


def test_hardly_a_block_is_not_run():
    every = [block for path in (*PAGES, *tutorial_pages()) for block in pages.blocks(path)]
    assert sum(block.language in ("sh", "python") for block in every) > 15
    reasons = sorted(block.not_run for block in every if block.not_run)
    assert reasons == ["installs"] * 3 + ["waits for a browser"]


def test_every_example_is_on_a_page():
    text = "".join(path.read_text() for path in DOCS.rglob("*.md"))
    shown = re.findall(r"```\{example\} (\w+)", text)
    assert sorted(shown) == sorted(path.stem for path in (ROOT / "examples").glob("*.py"))


def test_every_kind_of_a_scenario_has_its_fields_listed():
    text = (DOCS / "reference" / "scenario.rst").read_text()
    for kind in (*KINDS, *get_args(RobotConfig)):
        assert re.search(rf"^   {kind.__module__}\.{kind.__name__}$", text, re.M), kind


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The built site, for tests of the group "site": once, not by every worker."""
    folder = tmp_path_factory.mktemp("site")
    # What the tests run with is installed already, wherever that is.
    command = ["make", "-o", f"{sys.prefix}/installed", "docs", f"VENV={sys.prefix}"]
    done = subprocess.run([*command, f"SITE={folder}"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.slow
@pytest.mark.xdist_group("site")
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize(
    "page",
    [
        "index.html",
        "concepts/tube_nmpc.html",
        "concepts/mathematics.html",
        "tutorial/own_path.html",
        "tutorial/replay.html",
        "generated/systems/nominal_nmpc.html",
        "reference/scenario.html",
        "reference/cli.html",
    ],
)
def test_page_opens_offline_without_errors(browser, site, page, dark):
    browser.prefer(dark)
    browser.open(site / page)
    assert browser.errors == []
    assert all(request.startswith(("file:", "data:", "blob:")) for request in browser.requests)
    images = "[...document.images].filter(i => i.offsetParent)"
    assert browser.evaluate(f"{images}.every(i => i.naturalWidth > 0)")
    # Nothing is cut off: what is wide scrolls by itself.
    assert browser.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    if page.startswith(("index", "concepts/tube")):
        (shown,) = browser.evaluate(f"{images}.map(i => i.src)")
        assert shown.endswith("-dark.svg" if dark else "-light.svg")
    shade = browser.screenshot().mean()
    assert shade < 0.3 if dark else shade > 0.7


@pytest.mark.slow
@pytest.mark.xdist_group("site")
def test_every_system_has_a_page_with_its_picture(site):
    sources = [*(ROOT / "mirte_drake").rglob("*.py")]
    names = [
        name
        for path in sources
        for name in re.findall(r"pydrake_system::\n\n +name: (\w+)", path.read_text())
    ]
    assert len(names) > 15
    text = "".join(path.read_text() for path in (site / "generated" / "systems").glob("*.html"))
    drawn = re.findall(r'<svg class="port-picture" role="img" aria-label="(\w+): ', text)
    assert sorted(drawn) == sorted(names)


@pytest.mark.slow
@pytest.mark.xdist_group("site")
def test_search_finds_what_a_reader_looks_for(browser, site):
    browser.open(f"{(site / 'search.html').as_uri()}?q=waypoint")
    browser.wait_until("document.querySelectorAll('#search-results li').length > 0")
    assert browser.errors == []
