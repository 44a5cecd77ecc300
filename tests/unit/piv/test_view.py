"""The page of `piv view`: its parts without a browser, and the page itself in a real one."""

import json
import re
import signal
import socket
import subprocess
import sys
import time

import cv2
import numpy as np
import pytest

from fileio.formats.plane_series import make_plane, write_plane
from piv import open_recording, part_of_recording
from piv.commands import view
from piv.foreign.read import with_units
from piv.view.regions import clipped, write_regions
from piv.view.scene import open_scene
from tests.piv_command import piv
from tests.webdriver import CHROMEDRIVER, CHROMIUM, Browser

SQUARE = [[10.0, 10.0], [30.0, 10.0], [30.0, 40.0]]
SHAPE = (96, 128)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("view")
    (folder / "run").mkdir()
    for k in range(4):
        cv2.imwrite(
            str(folder / f"run/{k}.png"),
            np.full(SHAPE, 10 * k, np.uint8) + np.eye(*SHAPE, dtype=np.uint8),
        )
    x, y = np.arange(8, 128, 16.0), np.arange(8, 96, 16.0)
    u = np.arange(3)[:, None, None] + np.zeros((3, y.size, x.size))
    plane = make_plane(x, y, u + 2, u + x, time=np.arange(3) + 0.5)
    write_plane(with_units(plane, "px", "px", "frame"), folder / "piv.h5")
    return folder


def test_images_behind_vectors_are_the_first_of_their_pair(folder):
    scene = open_scene(str(folder / "piv.h5"), str(folder / "run"))
    assert (scene.count, scene.unit, scene.extent()) == (3, "px", (-0.5, -0.5, 127.5, 95.5))
    assert [scene.frame_number(k) for k in range(3)] == [0, 1, 2]
    assert scene.image(0).shape == SHAPE
    vectors = scene.vectors(2)
    np.testing.assert_array_equal(vectors["v"], vectors["x"] + 2)
    assert scene.time_text(2) == "2.5 frame"
    assert open_scene(str(folder / "run")).count == 4


def test_what_is_drawn_is_read_by_correlate(folder, tmp_path):
    path = tmp_path / "r.json"
    said = write_regions(
        path, "px", {0: [SQUARE], 3: [[[x + 30, y] for x, y in SQUARE]]}, (0.0, 0.0, 99.0, 90.0)
    )
    assert "1 polygons at 2 frames, a region" in said
    with open_recording(folder / "run") as recording:
        part = part_of_recording(recording, path)
        assert part.shape == (91, 100)
        assert np.flatnonzero(part.mask(3).any(axis=0)).tolist() == list(range(40, 61))
    write_regions(path, "px", {2: [SQUARE]}, None)
    assert json.loads(path.read_text())["bodies"] == [{"corners": SQUARE}]


@pytest.mark.parametrize(
    "kept, message",
    [
        ({0: []}, "nothing is drawn"),
        ({0: [SQUARE], 1: []}, "as many polygons"),
        ({0: [SQUARE], 1: [[*SQUARE, [0.0, 0.0]]]}, "same number of corners"),
        ({0: [SQUARE[:2]]}, "at least 3 corners"),
    ],
)
def test_drawings_that_do_not_fit_are_refused(tmp_path, kept, message):
    with pytest.raises(ValueError, match=message):
        write_regions(tmp_path / "r.json", "px", kept, None)


def test_a_region_is_cut_at_the_picture():
    assert clipped((10, 10, 40, 10), (-0.5, -0.5, 20, 20)) == (-0.5, 5, 20, 15)
    assert clipped((100, 10, 4, 4), (0, 0, 20, 20)) is None


def test_without_the_library_one_sentence(folder, monkeypatch, capsys):
    monkeypatch.setattr(view, "find_spec", lambda name: None)
    assert piv("view", folder / "piv.h5") == 2
    assert "requirements-view.lock" in capsys.readouterr().err


def test_polygons_moved_after_they_were_kept_are_said_not_to_be_saved(folder, tmp_path):
    pytest.importorskip("bokeh", reason="the page needs bokeh: requirements-view.lock")
    from piv.view.page import Page

    page = Page(open_scene(str(folder / "piv.h5")), tmp_path / "r.json")
    corners = np.array(SQUARE).T
    page.masks.data = {"xs": [list(corners[0])], "ys": [list(corners[1])]}
    page.save()
    assert "keep them" not in page.status.text
    page.keep()
    page.save()
    assert "keep them" not in page.status.text
    page.masks.data = {"xs": [list(corners[0] + 5)], "ys": [list(corners[1])]}
    page.save()
    assert "not saved: the polygons as drawn now; keep them" in page.status.text
    assert json.loads((tmp_path / "r.json").read_text())["bodies"] == [{"corners": SQUARE}]


@pytest.fixture(scope="module")
def served(folder, tmp_path_factory):
    """A browser, and the address of the page, which is made anew for each visit."""
    pytest.importorskip("bokeh", reason="the page needs bokeh: requirements-view.lock")
    if not (CHROMIUM and CHROMEDRIVER):
        pytest.skip("needs chromium and chromedriver (apt: chromium chromium-driver)")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = [
        folder / "piv.h5",
        "--images",
        folder / "run",
        "-o",
        folder / "drawn.json",
        "--no-browser",
        "--port",
        port,
    ]
    command = [sys.executable, "-m", "piv", "view", *map(str, words)]
    server = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        # a job in the background of a shell ignores Ctrl-C, and so would what it starts
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    try:
        address = re.match(r"http://127\.0\.0\.1:\d+/", server.stdout.readline())
        assert address, server.stdout.read()
        with Browser(tmp_path_factory.mktemp("profile")) as browser:
            yield browser, address.group()
        server.send_signal(signal.SIGINT)
        rest = server.communicate(timeout=60)[0]
    finally:
        server.kill()
    # Ctrl-C: the log holds no traceback, and the usual exit code
    assert "Traceback" not in rest
    assert server.returncode == 130


@pytest.fixture
def page(served):
    """The page as a visitor finds it: nothing drawn, at its first step."""
    browser, address = served
    browser.open(address)
    ready = "return window.Bokeh && Bokeh.documents.length == 1 && Bokeh.documents[0].is_idle"
    until(lambda: browser.run(ready))
    return browser


def until(true, seconds=90):
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "the page did not get there"
        time.sleep(0.2)


def model(browser, name, what):
    return browser.run(f"return Bokeh.documents[0].get_model_by_name('{name}').{what}")


def place(browser, x, y):
    """Position in the window of a point of the plot."""
    return browser.run(
        "const view = Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name('plot'));"
        "const frame = view.frame, box = view.canvas_view.el.getBoundingClientRect();"
        f"return [box.x + frame.x_scale.compute({x}), box.y + frame.y_scale.compute({y})];"
    )


def press(browser, x, y, hold=0.0):
    """A click at a point of the plot, or the button held down for so many s."""
    left, top = place(browser, x, y)
    at = {"x": left, "y": top, "button": "left"}
    browser.devtools("Input.dispatchMouseEvent", type="mouseMoved", x=left, y=top)
    browser.devtools("Input.dispatchMouseEvent", type="mousePressed", clickCount=1, buttons=1, **at)
    time.sleep(hold)
    browser.devtools("Input.dispatchMouseEvent", type="mouseReleased", clickCount=1, **at)


def drag(browser, start, end):
    """From one point of the plot to another with Shift, as the box tool wants it."""
    (x, y), (left, top) = place(browser, *start), place(browser, *end)
    at = {"button": "left", "modifiers": 8}
    browser.devtools("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, modifiers=8)
    browser.devtools(
        "Input.dispatchMouseEvent", type="mousePressed", clickCount=1, x=x, y=y, buttons=1, **at
    )
    for part in (0.3, 0.7, 1.0):
        now = {"x": x + part * (left - x), "y": y + part * (top - y)}
        browser.devtools("Input.dispatchMouseEvent", type="mouseMoved", buttons=1, **now, **at)
    browser.devtools(
        "Input.dispatchMouseEvent", type="mouseReleased", clickCount=1, x=left, y=top, **at
    )


def activate(browser, tool):
    browser.run(
        "Bokeh.documents[0].get_model_by_name('plot').toolbar.tools.forEach("
        f"t => {{ if (/Draw|Edit/.test(t.type)) t.active = t.type == '{tool}' }})"
    )
    time.sleep(0.3)


def test_the_page_shows_images_and_vectors_and_asks_nobody(page):
    assert model(page, "plot", "title.text") == "0.5 frame, 48 vectors"
    assert [
        e for e in page.log("browser") if e["level"] == "SEVERE" and "favicon" not in e["message"]
    ] == []
    events = [json.loads(e["message"])["message"] for e in page.log("performance")]
    asked = [
        e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"
    ]
    assert any("bokeh" in url for url in asked)
    assert [
        u for u in asked if not u.startswith(("http://127.0.0.1", "data:", "blob:", "chrome"))
    ] == []


def test_a_click_on_a_vector_gives_its_numbers(page):
    press(page, 40, 40)
    until(lambda: "u = 2" in model(page, "numbers", "text"))
    assert model(page, "numbers", "text") == "x = 40, y = 40, u = 2, v = 40"


def test_stepping_and_drawing_and_saving(page, folder):
    page.run("Bokeh.documents[0].get_model_by_name('step').value = 2")
    until(lambda: model(page, "plot", "title.text").startswith("2.5 frame"))
    activate(page, "PolyDrawTool")
    first, middle, last = SQUARE
    press(page, *first, hold=0.6)
    press(page, *middle)
    time.sleep(0.5)  # not a double click
    press(page, *last, hold=0.6)
    activate(page, "BoxEditTool")
    drag(page, (20, 80), (100, 20))
    time.sleep(0.5)
    page.run(
        "const b = Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name('save'));"
        "b.shadow_el.querySelector('button').click()"
    )
    until(lambda: "1 polygons, a region" in model(page, "status", "text"))
    saved = json.loads((folder / "drawn.json").read_text())
    # the mouse moves in whole pixels of the screen, a seventh of the picture's
    np.testing.assert_allclose(saved["bodies"][0]["corners"], SQUARE, atol=0.3)
    np.testing.assert_allclose(saved["roi"], [20, 20, 100, 80], atol=0.3)
    with open_recording(folder / "run") as recording:
        assert part_of_recording(recording, folder / "drawn.json").shape in {
            (h, w) for h in (60, 61) for w in (80, 81)
        }
