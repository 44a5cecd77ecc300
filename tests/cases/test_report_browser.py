"""The report in a real browser: opens from disk, asks nobody for anything, and its slider and film work."""

from __future__ import annotations

import json
import time

import pytest

from postprocess.compare.stage import compare
from postprocess.evidence.stage_files import StageFiles
from postprocess.report import figures, flow_figures
from postprocess.report.stage import make_report
from tests.synthetic_stroke import copy_findings, write_case
from tests.webdriver import CHROMEDRIVER, CHROMIUM, Browser

pytestmark = pytest.mark.skipif(
    not (CHROMIUM and CHROMEDRIVER), reason="needs chromium and chromedriver (apt: chromium chromium-driver)"
)
HOME, RIGHT, END = "\ue011", "\ue014", "\ue010"  # WebDriver's key codes
FRAMES = 7


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    root = tmp_path_factory.mktemp("report")
    case = copy_findings(write_case(root, spacing=0.004, frames=21))
    files = StageFiles(case, "coarse")
    compare(files)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flow_figures, "FRAMES", FRAMES)
        figures.make_figures(files)
    return make_report(files).resolve().as_uri()


@pytest.fixture(scope="module")
def browser(tmp_path_factory, page):
    with Browser(tmp_path_factory.mktemp("profile")) as session:
        session.open(page)
        yield session


def shown(browser):
    return browser.run(
        "return [document.getElementById('shown').textContent, document.getElementById('frame').src]"
    )


def test_the_page_opens_without_errors_and_without_a_request(browser):
    assert "CFD and PIV" in browser.run("return document.title")
    assert browser.run("return document.getElementById('answer').textContent").startswith("Yes")
    assert browser.run("return [...document.images].every(i => i.complete && i.naturalWidth > 0)")
    assert [entry for entry in browser.log("browser") if entry["level"] in ("SEVERE", "WARNING")] == []
    events = [json.loads(entry["message"])["message"] for entry in browser.log("performance")]
    asked = [e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"]
    assert any(url.startswith("file:") for url in asked), "the log must have seen the page itself"
    # chromium's own new-tab page asks for chrome:// addresses; anything of a network has another scheme
    assert [
        url for url in asked if not url.startswith(("file:", "data:", "chrome:", "chrome-untrusted:"))
    ] == []


def test_the_slider_moves_by_keyboard(browser):
    browser.keys("#instant", HOME)
    first = shown(browser)
    assert (
        first[0] == "0.010 s"  # the first instant of PIV: the middle of a pair 20 ms apart
    )  # the first instant of PIV: the middle of the first pair, 20 ms apart, rounded down
    browser.keys("#instant", RIGHT)
    second = shown(browser)
    assert second[0] > first[0]
    assert second[1] != first[1]
    assert second[1].startswith("data:image/webp")
    browser.keys("#instant", END)
    assert shown(browser)[0] > second[0]
    assert browser.run("return document.getElementById('instant').value") == str(FRAMES - 1)


def test_play_and_pause(browser):
    browser.keys("#instant", HOME)
    start = shown(browser)[0]
    browser.click("#play")
    assert browser.run("return document.getElementById('play').getAttribute('aria-pressed')") == "true"
    for _ in range(100):
        if shown(browser)[0] != start:
            break
        time.sleep(0.05)
    assert shown(browser)[0] != start
    browser.click("#play")
    assert browser.run("return document.getElementById('play').textContent") == "Play"
    held = shown(browser)[0]
    time.sleep(0.3)  # three intervals: had the timer survived, the picture would have moved on
    assert shown(browser)[0] == held


def test_the_film_can_be_decoded(browser):
    for _ in range(100):
        ready, width, length = browser.run(
            "const v = document.querySelector('video'); return [v.readyState, v.videoWidth, v.duration || 0]"
        )
        if ready >= 1:
            break
        time.sleep(0.05)
    assert width > 0
    assert length == pytest.approx(
        FRAMES / flow_figures.FILM_HZ, abs=0.05
    )  # a container rounds to its time base


@pytest.mark.parametrize("width", [360, 768, 1300])
def test_nothing_sticks_out_sideways(browser, width):
    browser.devtools(
        "Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False
    )
    wide = browser.run("return [document.documentElement.scrollWidth, window.innerWidth]")
    assert wide[0] <= wide[1] == width


def test_dark_mode_keeps_pictures_on_white(browser):
    colours = "const c = e => getComputedStyle(e).backgroundColor;return [c(document.body), c(document.querySelector('figure img'))]"
    browser.devtools(
        "Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}]
    )
    body, picture = browser.run(colours)
    assert max(int(part) for part in body[4:-1].split(",")) < 64
    assert picture == "rgb(255, 255, 255)"
