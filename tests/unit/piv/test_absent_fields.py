"""Fields of black, saturated, damaged, missing and repeated pictures are absent, and named."""

import os
import shutil

import cv2
import numpy as np
import pytest

from docs.evidence.piv.flows import uniform
from docs.evidence.piv.particles import render
from piv.fields.statistics import statistics
from piv.fields.summary import summary
from piv.formats.plane_series import NO_PICTURE, REPEATED, absent, make_plane, read_plane
from piv.formats.resumable import SeriesWriter
from piv.images.absent_frames import absent_frames
from piv.images.open_recording import open_recording
from piv.images.preprocess import background
from piv.momentum.pressure import pressure
from piv.vortices.table import tabulate_vortices
from tests.piv_command import made, piv

SHAPE = (96, 128)
FILM = render(uniform(2, 1), shape=SHAPE, seed=5, frames=range(12), noise=0.01)


def film(folder, changed=None, left_out=()):
    """A film of 12 frames in `folder`, some of them changed or left out."""
    folder.mkdir(exist_ok=True)
    for k, image in enumerate(FILM):
        if k not in left_out:
            cv2.imwrite(str(folder / f"f_{k:03d}.tif"), (changed or {}).get(k, image))
    return folder


def flags(path):
    with read_plane(path) as plane:
        found = plane["flag"].values
        assert all(len(np.unique(f)) == 1 for f in found[absent(plane)])  # the whole field
        return np.where(absent(plane), found[:, 0, 0], 0).tolist()


LOST = [NO_PICTURE if k in (4, 5) else 0 for k in range(11)]


@pytest.mark.parametrize("fault", ["black", "noise", "saturated", "missing", "damaged"])
def test_a_lost_picture_leaves_two_absent_fields_and_is_named(tmp_path, capsys, fault):
    dark = np.random.default_rng(1).normal(4, 2, SHAPE).clip(0, 255).astype(np.uint8)
    pictures = {"black": np.zeros(SHAPE, np.uint8), "noise": dark}
    bright = np.where(np.arange(SHAPE[0])[:, None] < 80, 255, FILM[5]).astype(np.uint8)
    pictures["saturated"] = bright
    changed = {5: pictures[fault]} if fault in pictures else {}
    source = film(tmp_path / "f", changed, (5,) if fault == "missing" else ())
    if fault == "damaged":
        (source / "f_005.tif").write_bytes((source / "f_005.tif").read_bytes()[:300])
    made("correlate", source, "-o", tmp_path / "o.h5", "--rate", 100)
    assert flags(tmp_path / "o.h5") == LOST
    said = capsys.readouterr().err
    assert "f_005.tif: " in said
    assert "absent, 2 of 11" in said
    with read_plane(tmp_path / "o.h5") as plane:
        np.testing.assert_allclose(plane["time"], (np.arange(11) + 0.5) / 100)
        assert "11 fields of 16 x 12 vectors, 2 absent, " in summary(plane)
        # a hundred small windows: the median is good to 0.02 px
        np.testing.assert_allclose(plane["u"].median(("y", "x"))[[3, 6]], 2, atol=0.03)


def test_a_repeated_picture_is_no_field_of_rest(tmp_path, capsys):
    source = film(tmp_path / "f", {8: FILM[7]})
    made("correlate", source, "-o", tmp_path / "o.h5")
    assert flags(tmp_path / "o.h5") == [REPEATED if k in (7, 8) else 0 for k in range(11)]
    assert "f_008.tif: repeats the picture before it" in capsys.readouterr().err
    made("correlate", source, "-o", tmp_path / "o.h5", "--keep-doubles")
    assert not any(flags(tmp_path / "o.h5"))
    twice = film(tmp_path / "twice", {k: FILM[k // 2] for k in range(12)})
    assert piv("correlate", twice, "-o", tmp_path / "t.h5") == 2
    assert "give each picture once; --keep-doubles" in capsys.readouterr().err


@pytest.mark.parametrize("pictures", [[0, 0], [0, 1], [0, 1, 0]])
def test_equal_pictures_are_told_of(tmp_path, capsys, pictures):
    """They gave a field of rest without a word."""
    source = film(tmp_path / "f", {1: FILM[0]})
    names = [source / f"f_{k:03d}.tif" for k in pictures]
    made("correlate", *names, "-o", tmp_path / "o.h5")
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "all pictures are equal, so every vector is at rest; give two exposures" in said
    made("correlate", *names, "-o", tmp_path / "k.h5", "--keep-doubles")
    assert not capsys.readouterr().err


def test_water_that_begins_at_rest_repeats_no_picture(tmp_path):
    source = film(tmp_path / "f", {k: FILM[max(0, k - 6)] for k in range(12)})
    with open_recording(source) as recording:
        sets = [(k, k + 1) for k in range(11)]
        assert not absent_frames(recording, sets, slice(None), couples=False, repeats=True)


def test_water_at_rest_in_the_first_pair_repeats_no_picture(tmp_path):
    """Still water differs by the camera's noise alone, here a twentieth of what motion makes."""
    noise = np.random.default_rng(2).integers(0, 2, SHAPE, np.uint8)
    source = film(tmp_path / "f", {0: np.maximum(FILM[1], 1) - noise})
    with open_recording(source) as recording:
        sets = [(k, k + 1) for k in range(11)]
        assert not absent_frames(recording, sets, slice(None), couples=False, repeats=True)


def test_numbers_of_pairs_are_their_clock(tmp_path):
    for k in (0, 1, 2, 4):
        pair = render(uniform(2, 0), shape=SHAPE, seed=k)
        for label, image in zip(("LA", "LB"), pair, strict=True):
            cv2.imwrite(str(tmp_path / f"im{k:03d}.{label}.tif"), image)
    clock = ("--rate", 10, "--interval", 0.001, "--scale-mm-per-px", 0.1)
    for source in ([tmp_path], sorted(tmp_path.glob("*.tif"))):
        made("correlate", *source, "-o", tmp_path / "o.h5", *clock)
        with read_plane(tmp_path / "o.h5") as plane:
            np.testing.assert_allclose(plane["time"], 0.0005 + np.arange(5) / 10)
            assert absent(plane).tolist() == [False] * 3 + [True, False]


def test_a_black_frame_is_no_background(tmp_path):
    with open_recording(film(tmp_path / "f", {5: 0 * FILM[5]}, ())) as recording:
        found = background(recording, "min")
    assert np.array_equal(found, np.min([FILM[k] for k in range(12) if k != 5], axis=0))


def test_parts_find_the_same_absent_fields_as_the_whole(tmp_path):
    source = film(tmp_path / "f", {3: 0 * FILM[3], 8: FILM[7]})
    made("correlate", source, "-o", tmp_path / "o.h5")
    for k in range(1, 5):
        made("correlate", source, "-o", tmp_path / "j.h5", "--chunk", f"{k}/4")
    made("join", tmp_path / "j.h5")
    assert flags(tmp_path / "j.h5") == flags(tmp_path / "o.h5")


def test_a_replaced_picture_is_noticed_when_a_run_is_resumed(tmp_path, monkeypatch):
    source = film(tmp_path / "f")
    first, whole, out = [], SeriesWriter.write, tmp_path / "o.h5"

    def stop(self, index, fields):
        if first:
            raise KeyboardInterrupt
        first.append(whole(self, index, fields))

    monkeypatch.setattr(SeriesWriter, "write", stop)
    assert piv("correlate", source, "-o", out, "--quiet") == 130
    monkeypatch.setattr(SeriesWriter, "write", whole)
    shutil.copy(source / "f_004.tif", source / "f_001.tif")
    later = os.stat(source / "f_001.tif").st_mtime_ns + 10**9
    os.utime(source / "f_001.tif", ns=(later, later))
    made("correlate", source, "-o", out)
    made("correlate", source, "-o", tmp_path / "n.h5")
    with read_plane(out) as resumed, read_plane(tmp_path / "n.h5") as fresh:
        np.testing.assert_array_equal(resumed["u"], fresh["u"])


def vortex_series(lost):
    """A vortex that the flow carries to the right, whose instants `lost` have no field."""
    axis, times = 1e-3 * np.arange(-20, 21), 0.01 * np.arange(12)
    x, y = np.meshgrid(axis, axis)
    fields = []
    for t in times:
        r2 = (x - 0.2 * (t - 0.05)) ** 2 + y**2
        turn = 2e-3 / (2 * np.pi * r2.clip(1e-12)) * (1 - np.exp(-r2 / 4e-3**2))
        fields.append((0.2 - turn * y, turn * (x - 0.2 * (t - 0.05))))
    u, v = np.array(fields).transpose(1, 0, 2, 3)
    flag = np.zeros(u.shape, np.uint8)
    flag[lost] = NO_PICTURE
    u[lost] = v[lost] = np.nan
    std = np.full(u.shape, 1e-4)
    return make_plane(axis, axis, u, v, time=times, flag=flag, u_std=std, v_std=std)


def test_statistics_tracks_and_pressure_know_absent_instants():
    lost = [4, 5, 6, 7, 8]  # more than a track may miss
    series = vortex_series(lost)
    assert int(statistics(series)["n"].max()) == 7
    table = tabulate_vortices(series)
    strongest = table[table["track"] == 0]
    assert len(strongest) == 12
    assert strongest["bridged"].tolist() == [int(k in lost) for k in range(12)]
    found = pressure(vortex_series([4]))
    assert np.isfinite(found["p"].values).any(axis=(1, 2)).tolist() == [k != 4 for k in range(12)]
