"""The report in a real browser: opens from disk without any request; slider and film work."""

import json
import time

import numpy as np
import pytest

from pipeline.scene.scene import load_scene
from piv.plots.film import write_film
from postprocess.compare.stage import compare
from postprocess.draw.animation import write_picture
from postprocess.evidence.stage_files import StageFiles
from postprocess.lab.page import page as lab_report
from postprocess.report import figures, flow_figures
from postprocess.report.stage import make_report
from tests.axe.check import OPEN, serious_findings
from tests.synthetic_stroke import copy_findings, write_case
from tests.unit.lab.test_lab_wording import quantity
from tests.unit.lab.test_lab_wording import result as lab_result
from tests.webdriver import CHROMEDRIVER, CHROMIUM, Browser

needs = "needs chromium and chromedriver (apt: chromium chromium-driver)"
pytestmark = pytest.mark.skipif(not (CHROMIUM and CHROMEDRIVER), reason=needs)
HOME, RIGHT, END = "\ue011", "\ue014", "\ue010"  # WebDriver's key codes
FRAMES = 7
FILM_HZ = 10.0


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    root = tmp_path_factory.mktemp("report")
    case = copy_findings(write_case(root, spacing=0.004, frames=21))
    files = StageFiles(load_scene(case, "coarse"))
    compare(files)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flow_figures, "FRAMES", FRAMES)
        patch.setattr(figures, "_space", made_up_film)
        figures.make_figures(files)
    return make_report(files).resolve().as_uri()


def made_up_film(album, *_):
    """In place of the flow in space, which takes the fields of a run."""
    images = [np.full((64, 80, 3), 20 * k, np.uint8) for k in range(FRAMES)]
    for name in ("space_middle.webp", "space_end.webp"):
        write_picture(images[0], album.folder / name)
        album.add(None, name, "space", "A made-up picture in space")
    write_film(images, album.folder / "space.webm", FILM_HZ)
    album.add(None, "space.webm", "film", "A made-up film in space", "A film.")


@pytest.fixture(scope="module")
def lab_page(tmp_path_factory):
    path = tmp_path_factory.mktemp("lab") / "report.html"
    path.write_text(lab_report("A finger", judged(), {}), encoding="utf-8")
    return path.as_uri()


def judged():
    """comparison.json of a laboratory with long names and numbers in every cell."""
    how = "FEA's band, scaled from the run of the pressure"
    source = {"name": "geometry and material", "kind": "input", "std": [2.34e-4], "how": how}
    numbers = {
        "u_num": [1.23e-4], "u_input": [2.34e-4], "u_D": [3.45e-4], "significance": 12.34,
        "simulation": [7.7e-3], "window": None,
        "dominant": source["name"],
        "sources": [source],
    }  # fmt: skip
    verdicts = {
        "final_bend": ("model error", "rad"), "circulation": ("agrees", "m²/s"),
        "radius": ("undecided", "m"), "velocity_field": ("agrees", "m/s"),
    }  # fmt: skip
    quantities = []
    for name, (verdict, unit) in verdicts.items():
        quantities.append(quantity(name, -2.3e-3, 3e-4, verdict, unit=unit) | numbers)
    names = "scale_mm_per_px scale_std_percent turn_deg turn_std_deg delay_ms delay_std_ms"
    registration = dict.fromkeys(names.split(), 0.1)
    registration |= {"root_px": [100.0, 900.0], "root_std_mm": [0.1, 0.1]}
    against = ("scale_against_stated_percent", "turn_against_stated_deg")
    registration |= dict.fromkeys(against, 0.1) | {"root_against_stated_px": [0.1, 0.1]}
    whole = lab_result(*quantities)
    return whole | {
        "scene": "finger", "level": "coarse", "data": "A laboratory",
        "numerics": "Level coarse errs by 3 % at worst.",
        "quality": {"pictures": 40.0, "density_ppp": 0.05}, "repeats": [],
        "registration": whole["registration"] | registration,
        "provenance": {
            "dpiv_sha256": "0" * 64, "seed": 1,
            "versions": {"python": "3.11"},
        },
    }  # fmt: skip


def colour_scheme(browser, scheme):
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.devtools("Emulation.setEmulatedMedia", features=features)


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    with Browser(tmp_path_factory.mktemp("profile")) as started:
        yield started


@pytest.fixture
def browser(session, page):
    """The browser with the report open, in light colours and at its own size."""
    session.devtools("Emulation.clearDeviceMetricsOverride")
    session.devtools("Emulation.setEmulatedMedia", features=[])
    session.open(page)
    return session


def shown(browser):
    time, frame = "getElementById('shown').textContent", "getElementById('frame').src"
    return browser.run(f"return [document.{time}, document.{frame}]")


def test_the_page_opens_without_errors_and_without_a_request(browser):
    assert "CFD and PIV" in browser.run("return document.title")
    assert browser.run("return document.getElementById('answer').textContent").startswith("Agrees")
    assert browser.run("return [...document.images].every(i => i.complete && i.naturalWidth > 0)")
    assert not [e for e in browser.log("browser") if e["level"] in ("SEVERE", "WARNING")]
    events = [json.loads(entry["message"])["message"] for entry in browser.log("performance")]
    sent = [e["params"] for e in events if e["method"] == "Network.requestWillBeSent"]
    addresses = [parameters["request"]["url"] for parameters in sent]
    assert any(url.startswith("file:") for url in addresses), "the log must have the page itself"
    # chromium's own new-tab page requests chrome:// addresses
    local = ("file:", "data:", "chrome:", "chrome-untrusted:")
    assert [url for url in addresses if not url.startswith(local)] == []


def test_the_slider_moves_by_keyboard(browser):
    browser.keys("#instant", HOME)
    first = shown(browser)
    assert first[0] == "0.010 s"  # the first instant of PIV: the middle of a pair 20 ms apart
    browser.keys("#instant", RIGHT)
    second = shown(browser)
    assert second[0] > first[0]
    assert second[1] != first[1]
    assert second[1].startswith("data:image/webp")
    browser.keys("#instant", END)
    assert shown(browser)[0] > second[0]
    assert browser.run("return document.getElementById('instant').value") == str(FRAMES - 1)


def test_sources_switch_and_figures_over_time_follow_and_set_the_instant(browser):
    browser.keys("#instant", HOME)
    flow = shown(browser)[1]
    browser.click("#switch label:nth-of-type(2) input")
    assert shown(browser)[1] != flow
    line = "document.querySelector('figure[data-axis] i').style.left"
    first = browser.run(f"return {line}")
    browser.keys("#instant", END)
    assert browser.run(f"return {line}") != first
    assert "bend" in browser.run("return document.getElementById('values').textContent")
    browser.click("figure[data-axis] .plot")  # WebDriver clicks in the middle
    assert 0 < int(browser.run("return document.getElementById('instant').value")) < FRAMES - 1


def test_without_scripts_the_page_is_whole_and_offers_no_dead_control(browser, page):
    browser.devtools("Emulation.setScriptExecutionDisabled", value=True)
    try:
        browser.open(page)
        style = "getComputedStyle(document.querySelector('{}')).display"
        shown = {}
        for css in (".controls", "#switch", "#frame"):
            asked = {"expression": style.format(css), "returnByValue": True}
            shown[css] = browser.devtools("Runtime.evaluate", **asked)["result"]["value"]
    finally:
        browser.devtools("Emulation.setScriptExecutionDisabled", value=False)
    assert shown == {".controls": "none", "#switch": "none", "#frame": "block"}


def test_play_and_pause(browser):
    browser.keys("#instant", HOME)
    start = shown(browser)[0]
    browser.click("#play")
    button = "document.getElementById('play')"
    assert browser.run(f"return {button}.getAttribute('aria-pressed')") == "true"
    browser.until(f"document.getElementById('shown').textContent != {json.dumps(start)}")
    browser.click("#play")
    assert browser.run(f"return {button}.textContent") == "Play"
    paused = shown(browser)[0]
    time.sleep(0.3)  # three intervals of the timer
    assert shown(browser)[0] == paused


def test_the_film_can_be_decoded(browser):
    video = "document.querySelector('video')"
    browser.until(f"{video}.readyState >= 1")
    assert browser.run(f"return {video}.videoWidth") > 0
    length = browser.run(f"return {video}.duration || 0")
    # a container rounds to its time base
    assert length == pytest.approx(FRAMES / FILM_HZ, abs=0.05)


@pytest.mark.parametrize("width", [360, 400, 768, 1024, 1300, 1920])
@pytest.mark.parametrize("which", ["report", "lab"])
def test_nothing_sticks_out_sideways(browser, page, lab_page, which, width):
    browser.show(lab_page if which == "lab" else page, width)
    sizes = "return [document.documentElement.scrollWidth, window.innerWidth]"
    needed, there = browser.run(sizes)
    assert needed <= there == width
    browser.run(OPEN)
    table = "const t = document.querySelector('#verdict .scroll');"
    needed, there = browser.run(f"{table} return [t.scrollWidth, t.clientWidth]")
    assert needed <= there, "the verdict is cut off"


def test_cells_of_a_narrow_table_name_their_column(browser, lab_page):
    browser.show(lab_page, 400)
    cells = "[...document.querySelectorAll('.verdict > tbody > tr:first-child > td')]"
    heads = browser.run(f"return {cells}.map(c => getComputedStyle(c, '::before').content)")
    names = ("Simulation S", "Laboratory D", "E", "Uncertainty u_val")
    assert heads[2:6] == [f'"{name}: "' for name in names]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [400, 1300])
@pytest.mark.parametrize("which", ["report", "lab"])
def test_axe_has_no_serious_finding(browser, page, lab_page, which, width, scheme):
    colour_scheme(browser, scheme)
    browser.show(lab_page if which == "lab" else page, width)
    assert serious_findings(browser) == {}


def test_dark_mode_keeps_pictures_on_white(browser):
    colour_scheme(browser, "dark")
    style, elements = "return getComputedStyle({}).backgroundColor", ("body", "figure img")
    body, picture = (browser.run(style.format(f"document.querySelector('{e}')")) for e in elements)
    assert max(int(part) for part in body[4:-1].split(",")) < 64
    assert picture == "rgb(255, 255, 255)"
