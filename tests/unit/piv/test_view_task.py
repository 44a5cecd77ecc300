"""A new user's task in `piv view`: mask a moving finger, find the vortex, read its circulation.

python -m tests.viewer_session    (the repository's root; `make docs` runs it, too)
"""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from piv.commands.correlate import make as correlate
from piv.formats.plane_series import make_plane
from piv.synthetic.camera import Camera, Seeding
from piv.synthetic.virtual_camera import Recorder
from piv.vortices.lamb_oseen_fit import lamb_oseen
from tests.viewer import click, drag, key, polygon, ready, serving, tool, until
from tests.webdriver import CHROMEDRIVER, CHROMIUM, Browser

GAMMA, CENTRE = 0.006, (0.030, 0.018)  # m²/s, m
FRAMES, PIXEL = 6, 1e-4  # m
FINGER = np.array([[0.006, 0.020], [0.012, 0.020], [0.012, 0.036], [0.006, 0.036]])  # m
STEP = 4e-4  # m that the finger moves to the right from frame to frame


def film(folder: Path) -> None:
    """Frames of a vortex beside a finger that moves."""
    x, y = np.arange(0, 0.0451, 5e-4), np.arange(0, 0.0361, 5e-4)
    flow = lamb_oseen(*np.meshgrid(x, y), *CENTRE, GAMMA, 2e-3)
    u, v = (np.tile(f, (FRAMES, 1, 1)) for f in flow)
    moves = STEP * np.arange(FRAMES)[:, None, None] * np.array([1.0, 0.0])
    outline = (FINGER + moves)[:, None]
    series = make_plane(x, y, u, v, time=np.arange(FRAMES) / 500, outline=outline)
    recorder = Recorder(series, Camera(width_px=448, height_px=352, scale_mm_per_px=0.1),
                        Seeding(), seed=1)  # fmt: skip
    folder.mkdir()
    for k, frame in enumerate(recorder.frames()):
        cv2.imwrite(str(folder / f"frame_{k}.png"), frame.image)


def session(browser: Browser, folder: Path) -> str:
    """Do the task with pictures `view_mask.png` and `view.png`; return what the page shows."""
    run, drawn, vectors = folder / "run", folder / "regions.json", folder / "piv.h5"
    with serving(run, "-o", drawn) as address:
        browser.open(address)
        ready(browser)
        tool(browser, "mask")
        corners = FINGER / PIXEL + [[-4, -4], [4, -4], [4, 4], [-4, 4]]
        polygon(browser, np.clip(corners, 1, 350).tolist())
        for _ in range(FRAMES - 2):  # the page steps by pairs
            key(browser, "ArrowRight", 39)
        ready(browser)
        moved = STEP * (FRAMES - 2) / PIXEL
        drag(browser, (90, 280), (90 + moved, 280))
        browser.run("$('save').click()")
        until(browser, "saved", "1 polygon")
        browser.screenshot(folder / "view_mask.png")
    correlate(run, vectors, {"mask": str(drawn), "rate": 500.0, "scale_mm_per_px": 0.1}, quiet=True)
    with serving(vectors, "--images", run) as address:
        browser.open(address)
        ready(browser)
        browser.run("$('every').value = 2; $('length').value = 2.5; $('vortices').click()")
        ready(browser)
        tool(browser, "area")
        x, y = CENTRE
        polygon(browser, [[x - a, y - b] for a, b in ((0.01, 0.01), (-0.01, 0.01),
                                                      (-0.01, -0.01), (0.01, -0.01))])  # fmt: skip
        text = until(browser, "inside", "±")
        tool(browser, "look")
        click(browser, x - 0.004, y)
        until(browser, "vector", "vorticity")
        browser.screenshot(folder / "view.png")
    return text


@pytest.mark.skipif(not (CHROMIUM and CHROMEDRIVER), reason="needs chromium and chromedriver")
def test_a_moving_finger_is_masked_and_the_circulation_of_a_vortex_is_read(tmp_path):
    film(tmp_path / "run")
    with Browser(tmp_path / "profile", 1400, 820) as browser:
        text = session(browser, tmp_path)
    circulation = float(re.search(r"circulation (\S+)", text)[1])
    # PIV of six frames at the vortex' edge: the drawn square holds all of it but 0.01 %
    assert circulation == pytest.approx(GAMMA, rel=0.05)
