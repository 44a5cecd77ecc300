"""Masks and pre-processing on images whose body and background are known."""

import cv2
import numpy as np
import pytest
import xarray as xr

from docs.evidence.piv.flows import uniform
from docs.evidence.piv.particles import render
from piv.correlation.options import Options
from piv.correlation.pair import correlate_pair
from piv.fields.summary import summary
from piv.formats.plane_series import read_plane
from piv.images.masks import dark_body, outline_masks, polygon_mask, polygons_mask
from piv.images.open_recording import open_recording
from piv.images.preprocess import Preprocessor, background
from piv.sequence.frame_sets import SequenceOptions
from piv.sequence.sequence import correlate_recording
from tests.piv_command import piv


def particles(shape=(512, 640), seed=0, density=0.04):
    rng = np.random.default_rng(seed)
    image = np.full(shape, 12.0)
    n = int(density * image.size)
    at = rng.integers(0, shape[0], n), rng.integers(0, shape[1], n)
    np.add.at(image, at, rng.uniform(200, 1500, n))
    return cv2.GaussianBlur(image, (0, 0), 0.8), rng


def test_a_threshold_that_masks_everything_is_refused():
    picture = np.full((40, 50), 30, np.uint8)
    words = "below grey level 900 masks the whole image; give a lower `threshold`"
    with pytest.raises(ValueError, match=words):
        dark_body(picture, threshold=900)
    # a frame of dark round it: all is masked once the hole in it is filled
    picture = np.full((80, 100), 30, np.uint8)
    picture[20:60, 20:80] = 200
    with pytest.raises(ValueError, match="masks the whole image"):
        dark_body(picture, threshold=100)


@pytest.mark.parametrize("shade", [1.0, 0.6])
def test_dark_finger_is_found_whole(shade):
    image, rng = particles()
    finger = [[250, 511], [280, 511], [290, 300], [350, 200], [330, 190], [265, 280]]
    truth = polygon_mask(np.array(finger, float), image.shape)
    image[:, 320:450] *= shade  # the finger's shadow in the sheet is no body
    image[truth] = 3
    frame = np.clip(image + rng.normal(0, 3, image.shape), 0, 255).astype(np.uint8)
    mask = dark_body(frame)
    assert not (truth & ~mask).any()  # a missed body pixel would be correlated
    # Gaps between particles at the edge (mean spacing 5 px) and the margin of 3 px cannot be told
    # from the body.
    beyond = cv2.distanceTransform((~truth).astype(np.uint8), cv2.DIST_L2, 5)[mask & ~truth]
    assert np.percentile(beyond, 95) < 12
    assert (mask & ~truth).sum() < 0.45 * truth.sum()


def test_no_body_is_said():
    image, _ = particles()
    with pytest.raises(ValueError, match="no dark"):
        dark_body(np.clip(image, 0, 255).astype(np.uint8))


def test_outline_moves_between_instants_and_is_not_extended():
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * 1e-2
    outline = ("time", "point", "axis"), np.stack([square, square + np.array([0.02, 0])])
    series = xr.Dataset({"outline": outline}, coords={"time": [0.0, 1.0]})
    bodies = outline_masks(series, np.array([0.5]), 1e-3, (5.0, 5.0))
    mask = polygons_mask(bodies[0], (40, 60))
    rows, columns = np.nonzero(mask)
    assert (columns.min(), columns.max()) == (15, 25)  # 5 px origin + 10 px half way
    assert (39 - rows.max(), 39 - rows.min()) == (5, 15)
    with pytest.raises(ValueError, match="covers 0 to 1 s"):
        outline_masks(series, np.array([1.5]), 1e-3, (5.0, 5.0))


def test_chain_names_its_steps_and_takes_a_still_background_away(tmp_path):
    still = np.tile(np.linspace(20, 60, 50), (40, 1)).astype(np.uint8)
    for k in range(4):
        frame = still.copy()
        frame[10, 5 + 10 * k] = 200
        cv2.imwrite(str(tmp_path / f"{k}.png"), frame)
    recording = open_recording(tmp_path)
    assert np.array_equal(background(recording, "min"), still)
    chain = Preprocessor(["background", "cap=5"], recording)
    assert chain.steps == ["background=min", "cap=5"]
    clean = chain(recording.frame(1))
    assert clean.dtype == np.float32
    assert np.unravel_index(clean.argmax(), clean.shape) == (10, 15)
    assert np.count_nonzero(clean) == 1


def test_where_no_background_can_be_the_remedy_can_be_followed(tmp_path, capsys):
    image = particles((96, 96))[0].astype(np.uint8)
    names = [str(tmp_path / f"{k}.tif") for k in "ab"]
    for name in names:
        cv2.imwrite(name, image)
    asked = ["correlate", *names, "-o", str(tmp_path / "a.h5"), "--quiet", "--preprocess"]
    assert piv(*asked, "background=min") == 2
    assert "give --preprocess none" in capsys.readouterr().err
    assert piv(*asked, "none") == 0


def test_static_background_is_taken_off_where_particles_pass_and_particles_at_rest_stay(tmp_path):
    still = np.zeros((384, 512))
    cv2.line(still, (120, 60), (260, 300), 200.0, 5, cv2.LINE_AA)
    cv2.ellipse(still, (400, 250), (40, 20), 20, 0, 360, 400.0, -1, cv2.LINE_AA)  # saturates
    at, speed = np.arange(8) - 4.0, 3.0

    def recording(name, moved, light):
        (tmp_path / name).mkdir()
        frames = render(uniform(moved, 0), shape=still.shape, seed=81, noise=0.02, frames=at)
        for k, frame in enumerate(frames):
            lit = np.clip(frame + light, 0, 255).astype(np.uint8)
            cv2.imwrite(str(tmp_path / name / f"{k}.png"), lit)
        return open_recording(tmp_path / name)

    rest = recording("rest", 0.0, 0 * still)
    assert Preprocessor(["background=static"], rest).steps == []
    streaks = recording("streaks", speed, still)
    clean = Preprocessor(["background=static"], streaks)
    assert clean.steps == ["background=static"]
    options = Options(spacing=32), SequenceOptions(every=7)
    with read_plane(correlate_recording(streaks, tmp_path / "v.h5", *options)) as plane:
        assert "taken off (`preprocess = none` keeps it)" in summary(plane)
    near = cv2.dilate((still > 30).astype(np.uint8), np.ones((17, 17), np.uint8)) > 0

    def wrong(image, mask):
        field = correlate_pair(*(image(streaks.frame(k)) for k in (3, 4)), mask=mask)
        columns, rows = np.meshgrid(field["x"].astype(int), 383 - field["y"].astype(int))
        off = np.hypot(field["u"].values - speed, field["v"].values) > 0.5
        return np.mean((off & (field["valid"].values != 0))[near[rows, columns]])

    assert wrong(lambda image: image, None) > 0.05
    assert wrong(clean, clean.mask(None)) <= 0.001  # asked for


@pytest.mark.parametrize("step", ["blur", "cap=x", "cap=0", "background=max"])
def test_bad_steps(step, tmp_path):
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.ones((8, 8), np.uint8))
    recording = open_recording(tmp_path)
    with pytest.raises(ValueError):  # noqa: PT011 - each step has its own sentence
        Preprocessor([step], recording)(recording.frame(0))
