"""The page of `piv view`: its parts without a browser, and the page itself in a real one."""

import http.client
import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from docs.evidence.piv.particles import render
from piv import VortexSettings, open_recording, part_of_recording
from piv.commands.correlate import make as make_vectors
from piv.foreign.read import in_px
from piv.formats.plane_series import make_plane, provenance, write_plane
from piv.view import answers, server
from piv.view.regions import write_regions
from piv.view.session import open_session
from piv.vortices.find import scale_of
from piv.vortices.lamb_oseen_fit import lamb_oseen
from tests.viewer import click, drag, key, mouse, polygon, ready, serving, tool, until
from tests.webdriver import CHROMEDRIVER, CHROMIUM, Browser

SQUARE = [[10.0, 10.0], [30.0, 10.0], [30.0, 40.0]]
SHAPE = (96, 128)
GAMMA, CORE = 150.0, 12.0  # px²/frame, px: of a vortex in the middle
AROUND = [[30.0, 14.0], [98.0, 14.0], [98.0, 82.0], [30.0, 82.0]]


def flow(x, y):
    return lamb_oseen(x, y, 64, 48, GAMMA, CORE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three pairs of a vortex as images, and their exact vectors with an uncertainty."""
    folder = tmp_path_factory.mktemp("view")
    (folder / "run").mkdir()
    for k in range(3):
        pair = render(flow, shape=SHAPE, seed=k, noise=0.01)
        for label, image in zip("ab", pair, strict=True):
            cv2.imwrite(str(folder / f"run/{k}_{label}.png"), image)
    x, y = np.arange(4, 128, 4.0), np.arange(4, 96, 4.0)
    u, v = (np.stack([a] * 3) for a in flow(*np.meshgrid(x, y)))
    std = np.full(u.shape, 0.02)
    time = 2 * np.arange(3) + 0.5
    plane = in_px(make_plane(x, y, u, v, time=time, u_std=std, v_std=std), "frame")
    attrs = provenance(window=16.0, pairing="1-2,3-4", every=1)
    write_plane(plane.assign_attrs(attrs), folder / "piv.h5")
    return folder


def test_images_behind_vectors_are_their_pair(folder):
    scene = open_session([str(folder / "piv.h5")], [str(folder / "run")])
    assert (scene.count, scene.unit, scene.extent()) == (3, "px", (-0.5, -0.5, 127.5, 95.5))
    assert [scene.frames_of(k) for k in range(3)] == [(0, 1), (2, 3), (4, 5)]
    shown = cv2.imdecode(np.frombuffer(scene.image(1, True), np.uint8), cv2.IMREAD_UNCHANGED)
    assert shown.shape == SHAPE
    assert scene.time_text(2) == "4.5 frame"
    alone = open_session([str(folder / "run")])
    assert [alone.frames_of(k) for k in range(3)] == [(0, 1), (0, 1), (2, 3)]


def test_fewer_images_than_fields_are_refused(folder):
    images = sorted(str(path) for path in (folder / "run").iterdir())
    with pytest.raises(ValueError, match=r"fields, but the images give 1; give --images all"):
        open_session([str(folder / "piv.h5")], images[:2])
    assert open_session([str(folder / "piv.h5")], images[:1]).frames_of(1) == (0, 0)  # behind all


def test_an_area_gives_the_circulation_round_it_and_its_uncertainty(folder):
    plane = open_session([str(folder / "piv.h5")]).plane(0)
    found = answers.inside(plane, AROUND)
    # all but exp(-8) of the vortex is inside; linear between vectors a third of a core apart
    assert found["circulation"] == pytest.approx(GAMMA, rel=0.01)
    assert answers.inside(plane, AROUND[::-1])["circulation"] == pytest.approx(GAMMA, rel=0.01)
    assert found["area"] == pytest.approx(68**2)
    assert found["mean"]["vorticity"] * found["area"] == pytest.approx(GAMMA, rel=0.05)
    rng = np.random.default_rng(4)
    window = 16.0 / 4  # in grid steps: errors correlated by exp(-2 (d/L)²) are white noise blurred
    drawn = []
    for _ in range(200):
        white = rng.normal(size=(2, *plane["u"].shape))
        noise = gaussian_filter(white, (0, *[window / np.sqrt(8)] * 2), mode="wrap")
        errors = dict(zip("uv", noise, strict=True))
        other = plane.assign({n: plane[n] + 0.02 * e / e.std() for n, e in errors.items()})
        drawn.append(answers.inside(other, AROUND)["circulation"])
    # 200 draws know a standard deviation to 5 %; at the corners errors are not independent
    assert found["circulation_std"] == pytest.approx(np.std(drawn), rel=0.2)
    with pytest.raises(ValueError, match="at least 3 corners"):
        answers.inside(plane, AROUND[:2])
    hole = plane.copy(deep=True)
    hole["valid"][3, 12] = 0
    assert answers.inside(hole, AROUND)["circulation"] is None


def test_settings_are_tried_on_the_pair_that_is_shown(folder):
    scene = open_session([str(folder / "piv.h5")], [str(folder / "run")])
    plane = answers.tried(scene, 1, {"window": 16.0, "spacing": 8, "preprocess": "none"}, [SQUARE])
    assert plane.sizes == {"y": 12, "x": 16}
    assert plane["flag"].sel(x=25, y=20, method="nearest") == 2  # masked
    u = flow(*np.meshgrid(plane["x"], plane["y"]))[0]
    ok = plane["valid"].values != 0
    assert np.sqrt(np.mean((plane["u"].values - u)[ok] ** 2)) < 0.15  # px, of 2 px at its peak
    strongest = answers.vortices(plane)[0]
    assert strongest["circulation_fit"] == pytest.approx(GAMMA, rel=0.1)


def test_a_try_starts_from_the_settings_of_the_file(folder, tmp_path):
    """The same settings give the same vectors, in m, and the same scale of the vortices."""
    own = {"window": 24.0, "spacing": 8, "epsilon": 0.3, "max_std": 0.4, "smoothing": False}
    camera = {"scale_mm_per_px": 0.1, "interval": 0.001, "preprocess": "highpass=8"}
    make_vectors(folder / "run", tmp_path / "m.h5", own | camera, quiet=True)
    scene = open_session([str(tmp_path / "m.h5")], [str(folder / "run")])
    plane, again = scene.plane(1), answers.tried(scene, 1, {}, [])
    np.testing.assert_allclose(again["u"], plane["u"], rtol=1e-6)
    made = json.loads(again.attrs["settings"])
    assert {name: made[name] for name in own} == own
    assert scale_of(again, VortexSettings()) == pytest.approx(1.2e-3)  # half the window of 24 px
    assert scale_of(plane, VortexSettings()) == pytest.approx(1.2e-3)
    flags = "--no-smoothing --epsilon 0.3 --max-std 0.4 --preprocess highpass=8"
    assert answers.proposal(scene, {"window": 32}) == {"flags": flags, "note": ""}
    assert {f["name"]: f["value"] for f in answers.about(scene, "")["form"]}["window"] == 24


def test_a_try_of_a_set_of_frames_is_of_a_pair_and_says_so(folder, tmp_path):
    sets = {"frames": 3, "pairing": "1-2,2-3", "every": 2, "preset": "fast"}
    make_vectors(folder / "run", tmp_path / "m.h5", sets, quiet=True)
    scene = open_session([str(tmp_path / "m.h5")], [str(folder / "run")])
    assert [scene.frames_of(k) for k in range(scene.count)] == [(1, 2), (3, 4)]
    found = answers.proposal(scene, {"preset": "balanced"})
    assert "--pairing 1-2,2-3 --every 2 --frames 3" in found["flags"]  # names state 1-2,3-4
    assert found["note"] == "tried as a pair; a field of the file is of 3 frames"


def test_what_is_drawn_is_read_by_correlate(folder, tmp_path):
    path = tmp_path / "r.json"
    kept = {0: [SQUARE], 3: [[[x + 30, y] for x, y in SQUARE]]}
    said = write_regions(path, "px", kept, (0.0, 0.0, 99.0, 90.0))
    assert "1 polygon at 2 frames, a region" in said
    with open_recording(sorted((folder / "run").iterdir())[:4]) as recording:
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


@pytest.fixture(scope="module")
def address(folder):
    drawn = folder / "drawn.json"
    with serving(folder / "piv.h5", "--images", folder / "run", "-o", drawn) as address:
        yield address


def test_a_pair_that_is_tried_keeps_the_mask(folder):
    body = np.zeros(SHAPE, np.uint8)
    body[:40, 90:] = 255
    cv2.imwrite(str(folder / "body.png"), body)
    mask = str(folder / "body.png")
    scene = open_session([str(folder / "piv.h5")], [str(folder / "run")], mask)
    assert "--mask" in answers.proposal(scene, {})["flags"]
    masked = answers.tried(scene, 1, {}, [])["flag"] == 2
    assert masked.sel(x=slice(100, None), y=slice(66, None)).all()
    assert not masked.sel(x=slice(30, 70), y=slice(20, 50)).any()
    with pytest.raises(ValueError, match="a mask is of images; give --images"):
        open_session([str(folder / "piv.h5")], mask=mask)


def test_a_stranger_is_refused(address, folder):
    _, port, secret = re.match(r"http://(.*):(\d+)/(.*)/", address).groups()

    def status(path, host=f"127.0.0.1:{port}", **headers):
        line = http.client.HTTPConnection("127.0.0.1", int(port), timeout=30)
        line.putrequest("POST", path, skip_host=True)
        body = json.dumps({"kept": {"0": [SQUARE]}, "roi": None}).encode()
        known = {"Host": host, "Content-Type": "application/json", "Content-Length": len(body)}
        for name, value in (known | headers).items():
            line.putheader(name, str(value))
        line.endheaders(body)
        return line.getresponse().status

    save = f"/{secret}/save"
    rebound = f"stranger.example:{port}"  # a name that a stranger lets resolve to 127.0.0.1
    assert status(save, rebound, Origin=f"http://{rebound}") == 403
    assert status(save, Origin="http://stranger.example") == 403
    assert status("/save") == status(f"/{secret[:-1]}x/save") == 403
    assert status(save, **{"Content-Type": "text/plain"}) == 400  # what a form can send
    assert status(f"/{secret}/__init__") == 404
    assert not (folder / "drawn.json").exists()
    assert status(save) == 200
    (folder / "drawn.json").unlink()


def test_a_bad_message_is_one_sentence_and_writes_nothing(address, folder):
    """The log, which ends without a traceback, is read where the server stops."""
    _, port, secret = re.match(r"http://(.*):(\d+)/(.*)/", address).groups()

    def reply(method, path, body=None, length=None):
        line = http.client.HTTPConnection("127.0.0.1", int(port), timeout=30)
        headers = {"Content-Type": "application/json"} | (length or {})
        line.request(method, f"/{secret}/{path}", body, headers)
        answer = line.getresponse()
        return answer.status, answer.read().decode(errors="replace")

    nan = json.dumps({"kept": {"0": [[[float("nan"), 1.0], [2.0, 3.0], [4.0, 9.0]]]}, "roi": None})
    bad = [
        ("save", "{"), ("save", "[]"), ("save", "7"), ("save", "{}"), ("save", nan),
        ("save", json.dumps({"kept": {"0": [[["a", "b"]] * 3]}, "roi": None})),
        ("save", json.dumps({"kept": {"x": [SQUARE]}, "roi": None})),
        ("save", json.dumps({"kept": {}, "roi": [1]})), ("field", '{"step": "a"}'),
        ("field", '{"step": 999}'), ("inside", '{"step": 0, "polygon": 3}'),
        ("profile", '{"step": 0, "line": []}'), ("vortices", "[" * 5000),
    ]  # fmt: skip
    for name, body in bad:
        status, text = reply("POST", name, body)
        assert status == 422, (name, body, text)
        assert text.strip().count("\n") == 0
    assert reply("GET", "image?step=x")[0] == reply("GET", "image")[0] == 422
    assert reply("POST", "save", "{}", {"Content-Length": "x"})[0] == 400
    assert not (folder / "drawn.json").exists()
    assert reply("GET", "image?step=0&second=1&low=1&high=99.5")[0] == 200


def test_the_browser_gets_no_secret_by_its_words(monkeypatch):
    """The list of processes shows them to every user of the machine."""
    seen = []
    monkeypatch.setattr("piv.view.server._SHOWN", 0.0)
    read = lambda words: seen.append((words, Path(words.removeprefix("file://")).read_text()))  # noqa: E731
    monkeypatch.setattr("webbrowser.open", read)
    server._show("http://127.0.0.1:1/secret/")
    ((words, page),) = seen
    assert "secret" not in words
    assert "url=http://127.0.0.1:1/secret/" in page


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    if not (CHROMIUM and CHROMEDRIVER):
        pytest.skip("needs chromium and chromedriver (apt: chromium chromium-driver)")
    with Browser(tmp_path_factory.mktemp("profile"), 1400, 950) as browser:
        yield browser


@pytest.fixture
def page(browser, address):
    """The page as a visitor finds it: nothing drawn, at its first step."""
    browser.open(address)
    ready(browser)
    return browser


def test_the_page_shows_and_asks_nobody_else(page, address):
    assert until(page, "time", "frame") == "0.5 frame"
    click(page, 40, 40)
    text = until(page, "vector", "vorticity")
    u, v = flow(40.0, 40.0)
    assert "x 40, y 40 px" in text
    assert float(re.search(r"\bu (\S+)", text)[1]) == pytest.approx(u, rel=1e-3)
    assert float(re.search(r"\bv (\S+)", text)[1]) == pytest.approx(v, rel=1e-3)
    page.run("$('vortices').click()")
    ready(page)
    swirls = page.run("return viewer.swirls()")
    assert swirls[0]["circulation_fit"] == pytest.approx(GAMMA, rel=0.02)
    wrong = [e for e in page.log("browser") if e["level"] == "SEVERE"]
    assert wrong == []
    events = [json.loads(e["message"])["message"] for e in page.log("performance")]
    sent = [e["params"] for e in events if e["method"] == "Network.requestWillBeSent"]
    asked = [params["request"]["url"] for params in sent]
    assert any(url.endswith("/field") for url in asked)
    assert [u for u in asked if not u.startswith((address, "data:", "blob:", "chrome"))] == []


def test_measures_of_an_area_and_a_line_and_limits(page):
    tool(page, "area")
    polygon(page, AROUND)
    text = until(page, "inside", "±")
    assert float(re.search(r"circulation (\S+) ±", text)[1]) == pytest.approx(GAMMA, rel=0.02)
    tool(page, "line")
    drag(page, (20, 48), (108, 48))
    until(page, "linetext", "piv profile")
    page.run("$('scatter').scrollIntoView()")
    box = page.run("const b = $('scatter').getBoundingClientRect(); return [b.x, b.y, b.width]")
    mouse(page, "Pressed", box[0] + box[2] / 2, box[1] + 10)
    mouse(page, "Moved", box[0] + box[2] - 8, box[1] + 100)
    mouse(page, "Released", box[0] + box[2] - 8, box[1] + 100)
    assert "--u-limits" in until(page, "limits", "vectors outside")


def test_a_mask_that_moves_is_drawn_tried_and_saved(page, folder):
    tool(page, "mask")
    polygon(page, SQUARE)
    for _ in range(2):  # faster than the fields arrive
        key(page, "ArrowRight", 39)
    ready(page)
    assert until(page, "time", "4.5") == "4.5 frame"
    drag(page, (25, 20), (35, 20))
    kept = page.run("return viewer.masks()")
    # the mouse moves in whole pixels of the screen, a fifth of the picture's
    np.testing.assert_allclose(kept["0"][0], SQUARE, atol=0.3)
    np.testing.assert_allclose(kept["4"][0], np.array(SQUARE) + np.array([10, 0]), atol=0.3)
    tool(page, "region")
    drag(page, (5, 90), (120, 5))
    page.run("$('set_window').value = 16; $('try').click()")
    assert "--window 16 --mask" in until(page, "tried", "piv correlate")
    page.run("$('save').click()")
    until(page, "saved", "1 polygon at 3 frames, a region")
    with open_recording(folder / "run") as recording:
        part = part_of_recording(recording, folder / "drawn.json")
        assert part.shape in {(h, w) for h in (85, 86) for w in (115, 116)}
        first, last = (np.flatnonzero(part.mask(k).any(axis=0))[0] for k in (0, 5))
        assert last - first == pytest.approx(10, abs=1)
    page.run("$('clear').click()")
    assert page.run("return viewer.masks()") == {}
