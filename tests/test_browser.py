"""That tests of pages can fail: the browser sees what is wrong with a page."""

import numpy as np
import pytest

pytestmark = pytest.mark.slow

PAGE = """<!doctype html><title>closed</title>
<body style="background: #ff0000"><button onclick="document.title = 'open'">Open</button>
<script>{script}</script>"""


@pytest.fixture
def page(tmp_path):
    def write(script=""):
        file = tmp_path / "page.html"
        file.write_text(PAGE.format(script=script))
        return file

    return write


def test_a_good_page_has_no_errors_and_asks_for_nothing_else(browser, page):
    browser.open(page())
    assert browser.errors == []
    assert browser.requests == [page().as_uri()]


@pytest.mark.parametrize(
    ("script", "word"),
    [
        ("console.error('odd', 7)", "odd 7"),
        ("missing()", "missing is not defined"),
        ("setTimeout(() => { throw Error('late') })", "late"),
        ("document.body.append(Object.assign(new Image(), {src: 'none.png'}))", "none.png"),
    ],
)
def test_errors_of_a_page_are_seen(script, word, browser, page):
    browser.open(page(script))
    browser.wait(0.2)
    assert any(word in error for error in browser.errors)


def test_clicks_and_pictures(browser, page, tmp_path):
    browser.open(page())
    browser.click_on("document.querySelector('button')")
    browser.wait_until("document.title === 'open'")
    image = browser.screenshot(tmp_path / "page.png")
    assert image.shape == (720, 1280, 3)
    np.testing.assert_allclose(image[400, 600], [1, 0, 0], atol=0.01)
    assert (tmp_path / "page.png").read_bytes().startswith(b"\x89PNG")


def test_preferred_colours_and_what_is_false(browser, page):
    dark = "matchMedia('(prefers-color-scheme: dark)').matches"
    browser.open(page())
    assert browser.evaluate(dark) is False
    browser.prefer(dark=True)
    assert browser.evaluate(dark) is True
    with pytest.raises(TimeoutError, match="still false"):
        browser.wait_until("1 === 2", timeout=0.3)
    with pytest.raises(RuntimeError, match="nothing is not defined"):
        browser.evaluate("nothing")
