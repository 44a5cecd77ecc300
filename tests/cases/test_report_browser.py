"""The report in a real browser: opens from disk, asks nobody for anything, and its slider and film work."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest

from postprocess.compare.stage import compare
from postprocess.evidence.stage_files import StageFiles
from postprocess.lab.report.report import page as lab_report
from postprocess.report import figures, flow_figures
from postprocess.report.stage import make_report
from tests.synthetic_stroke import copy_findings, write_case
from tests.unit.lab.test_lab_wording import quantity
from tests.unit.lab.test_lab_wording import result as lab_result
from tests.webdriver import CHROMEDRIVER, CHROMIUM, Browser

pytestmark = pytest.mark.skipif(
    not (CHROMIUM and CHROMEDRIVER),
    reason="needs chromium and chromedriver (apt: chromium chromium-driver)",
)
HOME, RIGHT, END = "\ue011", "\ue014", "\ue010"  # WebDriver's key codes
FRAMES = 7
OPEN = "document.querySelectorAll('details').forEach(d => d.open = true);"
AXE = Path(__file__).parents[1] / "axe" / "axe.min.js"


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
def lab_page(tmp_path_factory):
    path = tmp_path_factory.mktemp("lab") / "report.html"
    path.write_text(lab_report("A finger", judged(), {}), encoding="utf-8")
    return path.as_uri()


def judged():
    """comparison.json of a laboratory with long names and numbers in every cell."""
    numbers = {
        "u_num": [1.23e-4],
        "u_input": [2.34e-4],
        "u_D": [3.45e-4],
        "significance": 12.34,
        "measurement_part": [4e-4],
        "finer": [1e-4],
    }
    source = {
        "name": "geometry and material",
        "kind": "input",
        "std": [2.34e-4],
        "how": "FEA's band, scaled from the run of the pressure",
    }
    quantities = [
        quantity(name, -2.3e-3, 3e-4, verdict, unit=unit) | numbers | {"dominant": source["name"], "sources": [source]}
        for name, verdict, unit in (("final_bend", "model error", "rad"), ("circulation", "agrees", "m²/s"),
                                    ("core_radius", "too uncertain", "m"), ("velocity_field", "agrees", "m/s"))
    ]  # fmt: skip
    registration = dict.fromkeys(
        (
            "scale_m_per_px",
            "scale_std_percent",
            "turn_deg",
            "turn_std_deg",
            "delay_ms",
            "delay_std_ms",
        ),
        0.1,
    )
    registration |= {"root_px": [100.0, 900.0], "root_std_mm": [0.1, 0.1]}
    whole = lab_result(*quantities, wrong=["final_bend"])
    about = {
        "scene": "finger",
        "level": "coarse",
        "data": "A laboratory",
        "window_s": [0.1, 0.2],
        "instants": 12,
        "appearance": {},
    }
    said = {
        "scene_hash": "0" * 16,
        "dpiv_sha256": "0" * 64,
        "seed": 1,
        "versions": {"python": "3.11"},
    }
    return (
        whole | about | {"registration": whole["registration"] | registration, "provenance": said}
    )


def show(browser, address, width):
    browser.devtools(
        "Emulation.setDeviceMetricsOverride",
        width=width,
        height=900,
        deviceScaleFactor=1,
        mobile=False,
    )
    browser.open(address)


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    with Browser(tmp_path_factory.mktemp("profile")) as started:
        yield started


@pytest.fixture
def browser(session, page):
    """The browser with the report open, whatever the test before has opened: two workers take the tests in any order."""
    session.devtools("Emulation.clearDeviceMetricsOverride")
    session.devtools("Emulation.setEmulatedMedia", features=[])
    session.open(page)
    return session


def shown(browser):
    return browser.run(
        "return [document.getElementById('shown').textContent, document.getElementById('frame').src]"
    )


def test_the_page_opens_without_errors_and_without_a_request(browser):
    assert "CFD and PIV" in browser.run("return document.title")
    assert browser.run("return document.getElementById('answer').textContent").startswith("Yes")
    assert browser.run("return [...document.images].every(i => i.complete && i.naturalWidth > 0)")
    assert [
        entry for entry in browser.log("browser") if entry["level"] in ("SEVERE", "WARNING")
    ] == []
    events = [json.loads(entry["message"])["message"] for entry in browser.log("performance")]
    asked = [
        e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"
    ]
    assert any(url.startswith("file:") for url in asked), "the log must have seen the page itself"
    # chromium's own new-tab page asks for chrome:// addresses; anything of a network has another scheme
    assert [
        url
        for url in asked
        if not url.startswith(("file:", "data:", "chrome:", "chrome-untrusted:"))
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
    assert (
        browser.run("return document.getElementById('play').getAttribute('aria-pressed')") == "true"
    )
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


@pytest.mark.parametrize("width", [360, 400, 768, 1024, 1300, 1920])
@pytest.mark.parametrize("which", ["report", "lab"])
def test_nothing_sticks_out_sideways(browser, page, lab_page, which, width):
    show(browser, lab_page if which == "lab" else page, width)
    wide = browser.run("return [document.documentElement.scrollWidth, window.innerWidth]")
    assert wide[0] <= wide[1] == width
    browser.run(OPEN)
    table = browser.run(
        "const t = document.querySelector('#verdict .scroll'); return [t.scrollWidth, t.clientWidth]"
    )
    assert table[0] <= table[1], "the verdict is cut off"


def test_cells_of_a_narrow_table_say_which_column_they_are_of(browser, lab_page):
    show(browser, lab_page, 400)
    said = browser.run(
        "return [...document.querySelectorAll('.verdict > tbody > tr:first-child > td')]"
        ".map(c => getComputedStyle(c, '::before').content)"
    )
    assert said[1:5] == [
        f'"{name}: "' for name in ("Simulation S", "Laboratory D", "E = S − D", "Uncertainty u_val")
    ]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("which", ["report", "lab"])
def test_axe_has_no_serious_finding(browser, page, lab_page, which, scheme):
    browser.devtools(
        "Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}]
    )
    show(browser, lab_page if which == "lab" else page, 1300)
    # opened, so that what is folded away is checked too; by devtools, since the page lets no script in
    browser.devtools("Runtime.evaluate", expression=OPEN + AXE.read_text(encoding="utf-8"))
    report = "axe.run().then(r => JSON.stringify([r.violations, r.passes.length]))"
    answer = browser.devtools(
        "Runtime.evaluate", expression=report, awaitPromise=True, returnByValue=True
    )
    violations, passed = json.loads(answer["result"]["value"])
    assert passed > 15, "axe must have looked at the page"
    wrong = {
        f["id"]: [n["html"][:120] for n in f["nodes"][:3]]
        for f in violations
        if f["impact"] in ("serious", "critical")
    }
    assert wrong == {}


def test_dark_mode_keeps_pictures_on_white(browser):
    colours = "const c = e => getComputedStyle(e).backgroundColor;return [c(document.body), c(document.querySelector('figure img'))]"
    browser.devtools(
        "Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}]
    )
    body, picture = browser.run(colours)
    assert max(int(part) for part in body[4:-1].split(",")) < 64
    assert picture == "rgb(255, 255, 255)"
