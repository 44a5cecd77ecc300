"""Masks per frame, polygons in time and regions, in the whole picture's coordinates."""

import json

import cv2
import numpy as np
import pytest

from docs.evidence.piv.flows import uniform
from docs.evidence.piv.particles import render
from piv import open_recording, part_of_recording
from piv.__main__ import main
from piv.formats.plane_series import read_plane

SHAPE = (128, 160)


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    folder = tmp_path_factory.mktemp("frames")
    a, b = render(uniform(2, 1), shape=SHAPE, seed=3, noise=0.01)
    for k, image in enumerate((a, b, a)):
        grey = np.clip(image / image.max() * 255, 0, 255).astype(np.uint8)
        cv2.imwrite(str(folder / f"f{k}.png"), grey)
    return folder


def correlate(frames, output, *options):
    words = f"correlate {frames} -o {output} --window 16 --spacing 8 --search 32".split()
    return main([*words, "--quiet", *map(str, options)])


def masked(path):
    with read_plane(path) as plane:
        return list(plane["flag"].values == 2), plane["x"].values


def test_one_mask_per_frame(frames, tmp_path):
    folder = tmp_path / "masks"
    folder.mkdir()
    for k in range(3):  # a body that moves right by 40 px a frame
        mask = np.zeros(SHAPE, np.uint8)
        mask[:, 40 * k : 40 * k + 40] = 255
        cv2.imwrite(str(folder / f"mask_{k:06d}.png"), mask)
    assert correlate(frames, tmp_path / "a.h5", "--mask", folder) == 0
    (first, second), x = masked(tmp_path / "a.h5")
    # a vector is masked where either of its two frames hides more than half of its window
    for hidden, ends in ((first, (0, 80)), (second, (40, 120))):
        inside = (x > ends[0] + 4) & (x < ends[1] - 4)
        # a window of 16 px that has moved by 2 px reaches 10 px; so do the picture's own edges
        outside = ((x < ends[0] - 10) | (x > ends[1] + 10)) & (x > 10) & (x < 150)
        assert hidden[:, inside].all()
        assert not hidden[2:-2, outside].any()
    assert correlate(frames, tmp_path / "b.h5", "--mask", folder / "mask_*.png") == 0
    assert [m.tolist() for m in masked(tmp_path / "b.h5")[0]] == [first.tolist(), second.tolist()]


@pytest.mark.parametrize("kind", ["m.tif", "m.png", "folder", "pattern", "drawn.json"])
def test_a_photograph_for_a_mask_is_refused_before_the_work(kind, frames, tmp_path, capsys):
    photograph = np.full(SHAPE, 40, np.uint8)
    photograph[7, 9] = 0
    mask = tmp_path / kind
    if kind == "drawn.json":
        corners = [[0, 0], [200, 0], [200, 200], [0, 200]]
        mask.write_text(json.dumps({"bodies": [{"corners": corners}]}))
    elif kind in ("folder", "pattern"):
        (tmp_path / kind).mkdir()
        for k in range(3):
            cv2.imwrite(str(tmp_path / kind / f"f{k}.png"), photograph)
        mask = mask if kind == "folder" else mask / "f*.png"
    else:
        cv2.imwrite(str(mask), photograph)
    assert correlate(frames, tmp_path / "a.h5", "--mask", mask) == 2
    said = capsys.readouterr().err
    assert str(mask) in said
    assert "of the picture; a mask is black but for the body" in said
    assert not (tmp_path / "a.h5").exists()


def test_masks_that_do_not_fit_are_refused(frames, tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "m0.png"), np.zeros(SHAPE, np.uint8))
    cv2.imwrite(str(tmp_path / "m1.png"), np.zeros(SHAPE, np.uint8))
    assert correlate(frames, tmp_path / "a.h5", "--mask", tmp_path / "m*.png") == 2
    assert "2 masks for 3 frames" in capsys.readouterr().err
    cv2.imwrite(str(tmp_path / "m2.png"), np.zeros((50, 50), np.uint8))
    assert correlate(frames, tmp_path / "a.h5", "--mask", tmp_path / "m2.png") == 2
    assert "the mask is 50x50 px, the frames are 160x128 px" in capsys.readouterr().err
    assert not (tmp_path / "a.h5").exists()


@pytest.mark.parametrize("output", ["still.png", "each"])
def test_an_image_is_no_polygon(output, frames, tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "m.png"), np.zeros(SHAPE, np.uint8))
    mask, out = str(tmp_path / "m.png"), tmp_path / output
    assert main(["mask", str(frames), "-o", str(out), "--polygon", mask, "--quiet"]) == 2
    assert f"{mask}: is not UTF-8 text" in capsys.readouterr().err
    assert not out.exists()


SQUARE = [[0, 0], [40, 0], [40, 127], [0, 127]]


def moved(by):
    return [[x + by, y] for x, y in SQUARE]


@pytest.mark.parametrize("suffix", [".json", ".toml"])
def test_polygons_move_linearly_between_their_instants(frames, tmp_path, suffix):
    path = tmp_path / f"body{suffix}"
    if suffix == ".json":
        body = {"frames": [0, 2], "corners": [SQUARE, moved(80)]}
        path.write_text(json.dumps({"bodies": [body]}))
    else:
        path.write_text(f"[[bodies]]\nframes = [0, 2]\ncorners = [{SQUARE}, {moved(80)}]\n")
    with open_recording(frames) as recording:
        part = part_of_recording(recording, path)
        for k, left in enumerate((0, 40, 80)):
            columns = np.flatnonzero(part.mask(k)[64])
            assert (columns[0], columns[-1]) == (left, left + 40)


def test_polygons_in_metres_and_seconds(frames, tmp_path):
    path = tmp_path / "body.json"
    corners = np.array([SQUARE, moved(80)]) * 1e-3 - [0.01, 0]
    body = {"times": [0.0, 0.2], "corners": corners.tolist()}
    path.write_text(json.dumps({"unit": "m", "bodies": [body], "roi": [0.0, 0.0, 0.09, 0.1]}))
    with open_recording(frames) as recording:
        recording.times = np.arange(len(recording)) / 10
        with pytest.raises(ValueError, match="metres need its scale"):
            part_of_recording(recording, path)
        recording.attrs |= {"scale_mm_per_px": 1.0, "origin_x_px": 10.0, "origin_y_px": 0.0}
        part = part_of_recording(recording, path)
        assert part.corner_px == (10.0, 0.0)
        assert part.shape == (101, 91)
        columns = np.flatnonzero(part.mask(1)[64])
        assert (columns[0], columns[-1]) == (30, 70)


@pytest.mark.parametrize(
    "content, message",
    [
        ({"bodies": [{"frames": [0, 1], "corners": [SQUARE, SQUARE]}]}, "from 0 to 1, the recor"),
        ({"bodies": [{"frames": [0, 2], "corners": [SQUARE, SQUARE[:3]]}]}, "mask polygons"),
        ({"bodies": [{"frames": [2, 0], "corners": [SQUARE, SQUARE]}]}, "ascending instants"),
        ({"bodies": [{"times": [0, 1], "corners": [SQUARE, SQUARE]}]}, "the recording has none"),
        ({"body": []}, "unknown key 'body'"),
        ({}, "no body and no roi"),
        ({"roi": [0, 0, 500, 20]}, "not within the picture"),
    ],
)
def test_polygon_files_that_are_refused(frames, tmp_path, content, message):
    path = tmp_path / "body.json"
    path.write_text(json.dumps(content))
    with open_recording(frames) as recording, pytest.raises(ValueError, match=message):
        part_of_recording(recording, path)


def test_a_region_keeps_the_coordinates_of_the_whole_picture(frames, tmp_path):
    assert correlate(frames, tmp_path / "px.h5", "--roi", 40, 20, 119, 99) == 0
    scale = ["--scale-mm-per-px", 1, "--origin-x-px", 10, "--rate", 100]
    region = ["--roi", 0.03, 0.02, 0.109, 0.099, "--roi-unit", "m"]
    assert correlate(frames, tmp_path / "m.h5", *region, *scale) == 0
    with read_plane(tmp_path / "px.h5") as px, read_plane(tmp_path / "m.h5") as m:
        assert px["x"].min() >= 40
        assert px["x"].max() <= 119
        assert px["y"].min() >= 20
        assert px["y"].max() <= 99
        np.testing.assert_allclose(m["x"], (px["x"] - 10) * 1e-3, atol=1e-12)
        np.testing.assert_allclose(m["y"], px["y"] * 1e-3, atol=1e-12)
        np.testing.assert_allclose(m["u"], px["u"] * 1e-3 * 100, rtol=1e-6)
        assert m.attrs["origin_x_px"] == 10
        # uniform displacement of (2, 1) px, second pair back; window 16 px, 1 % noise: 0.1 px is
        # ten standard errors
        np.testing.assert_allclose(np.nanmedian(px["u"][0]), 2.0, atol=0.1)


@pytest.mark.parametrize("roi", [(50, 0, 40, 10), (0, 0, 400, 20), (-10, 0, 40, 20)])
def test_a_region_outside_the_picture_is_refused(frames, tmp_path, roi, capsys):
    assert correlate(frames, tmp_path / "a.h5", "--roi", *roi) == 2
    assert "the region" in capsys.readouterr().err


def test_another_mask_begins_anew(frames):
    """A `.part` of other masks is not continued."""
    with open_recording(frames) as recording:
        keys = [part_of_recording(recording, roi=(0, 0, 80, edge)).key for edge in (80, 90)]
    assert keys[0] != keys[1]
