"""Recordings to plane series: units, resume, threads, masks, the command line."""

import json
import os
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
import xarray as xr

from docs.evidence.piv.flows import uniform
from docs.evidence.piv.particles import render
from piv.commands.correlate import make
from piv.correlation.options import Options
from piv.correlation.pair import correlate_pair
from piv.formats.plane_series import read_plane
from piv.formats.recording import RecordingWriter
from piv.formats.resumable import FIELDS, SeriesWriter
from piv.images.open_recording import open_recording
from piv.sequence.frame_sets import SequenceOptions
from piv.sequence.multiframe import correlate_frames
from piv.sequence.sequence import correlate_recording
from tests.piv_command import made, piv

SHAPE = (96, 128)


def frames(count):
    return render(uniform(2, 1), shape=SHAPE, seed=9, frames=range(count))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("frames")
    for k, image in enumerate(frames(6)):
        cv2.imwrite(str(path / f"f{k}.tif"), image)
    return path


@pytest.fixture(scope="module")
def recording_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "images.h5"
    attrs = {"scale_mm_per_px": 0.1, "origin_x_px": 10.0, "origin_y_px": -5.0}
    attrs |= {"frame_rate_hz": 500.0, "bits": 8}
    images = frames(4)
    mask = np.zeros(SHAPE, np.uint8)
    mask[:40, 90:] = 1
    with RecordingWriter(path, SHAPE, np.uint8, 4, attrs, mask=True) as writer:
        for k, image in enumerate(images):
            writer.write(k, image, mask)
        writer.add("tip", ("time", "finger", "axis"), np.arange(8.0).reshape(4, 1, 2), "m")
        writer.finish()
    return path


def test_two_images_on_the_command_line(folder, tmp_path):
    out = tmp_path / "out.h5"
    made("correlate", folder / "f0.tif", folder / "f1.tif", "-o", out)
    with read_plane(out) as plane:
        assert plane.sizes["time"] == 1
        assert plane["u"].attrs["units"] == "px"
        # a hundred small windows: the median is good to 0.02 px
        assert float(plane["u"].median()) == pytest.approx(2, abs=0.03)
        assert float(plane["v"].median()) == pytest.approx(1, abs=0.03)


def test_pictures_that_lost_detail_are_told_before_the_work(folder, tmp_path, capsys, monkeypatch):
    given = []
    for k in (0, 1):
        given.append(str(tmp_path / f"f{k}.jpg"))
        cv2.imwrite(given[-1], cv2.imread(str(folder / f"f{k}.tif"), cv2.IMREAD_GRAYSCALE))
    calls = []

    def correlated(part, *args, **options):
        """In place of the work: by then it is said, and the files may be moved."""
        calls.append(capsys.readouterr().err)
        return correlate_recording(part, *args, **options)

    monkeypatch.setattr("piv.sequence.correlate.correlate_recording", correlated)
    output = ["-o", str(tmp_path / "out.h5"), "--quiet"]
    assert piv("correlate", *given, *output) == 0
    tifs = [str(folder / f"f{k}.tif") for k in (0, 1)]
    assert piv("correlate", *tifs, *output) == 0
    assert [said.count("JPEG loses detail of the particles") for said in calls] == [1, 0]


def test_recording_becomes_si_with_mask_and_finger(recording_file, tmp_path):
    out = tmp_path / "piv.h5"
    made("correlate", recording_file, "-o", out, "--threads", "2")
    with read_plane(out) as plane:
        assert plane["u"].attrs["units"] == "m/s"
        assert float(plane["u"].median()) == pytest.approx(2 * 1e-4 * 500, rel=0.02)
        np.testing.assert_allclose(plane["time"], [0.001, 0.003, 0.005])
        assert plane["x"].values[0] == pytest.approx((3.5 - 10) * 1e-4)
        assert plane["y"].values[0] == pytest.approx((3.5 + 5) * 1e-4)
        corner = {"x": slice((110 - 10) * 1e-4, None), "y": slice((70 + 5) * 1e-4, None)}
        body = plane.isel(time=0).sel(corner)
        assert (body["flag"] == 2).all()
        np.testing.assert_allclose(plane["tip"][:, 0, 0], [1, 3, 5])  # the mean of both frames
        assert json.loads(plane.attrs["settings"])["window"] == 32


def test_memory_does_not_grow_with_the_number_of_fields(tmp_path):
    """HDF5 kept 8 MB of every variable: 29 MB of these thousand fields."""

    def resident():
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    axes = np.arange(40.0), np.arange(30.0), np.arange(1050.0)
    units = {"x": "m", "y": "m", "time": "s", "u": "m/s"}
    fields = dict.fromkeys(FIELDS, np.ones((30, 40)))
    with SeriesWriter(tmp_path / "o.h5", *axes, units, {}, ["a"]) as writer:
        for k in range(50):
            writer.write(k, fields)
        before = resident()
        for k in range(50, 1050):
            writer.write(k, fields)
        assert resident() - before < 5e6  # a fifth of their size


def test_threads_change_no_bit(folder, tmp_path):
    planes = []
    for threads in (1, 2):
        options = Options(), SequenceOptions(threads=threads)
        with open_recording(folder) as recording:
            path = correlate_recording(recording, tmp_path / f"{threads}.h5", *options)
        planes.append(xr.load_dataset(path, engine="h5netcdf"))
    xr.testing.assert_identical(planes[0], planes[1])


def test_interrupted_run_resumes_and_keeps_what_was_finished(folder, tmp_path, monkeypatch):
    out = tmp_path / "out.h5"
    written = []
    original = SeriesWriter.write

    def stop_after_two(self, index, fields):
        if len(written) == 2:
            raise KeyboardInterrupt
        original(self, index, fields)
        written.append(index)

    monkeypatch.setattr(SeriesWriter, "write", stop_after_two)
    arguments = ["correlate", str(folder), "-o", str(out), "--quiet"]
    assert piv(*arguments) == 130
    assert not out.exists()
    monkeypatch.setattr(
        SeriesWriter, "write", lambda self, i, f: (written.append(i), original(self, i, f))
    )
    assert piv(*arguments) == 0
    assert sorted(written) == [0, 1, 2, 3, 4]
    straight = tmp_path / "straight.h5"
    made("correlate", folder, "-o", straight)
    both = (xr.load_dataset(path, engine="h5netcdf") for path in (out, straight))
    xr.testing.assert_identical(*both)


def test_part_of_other_settings_or_damaged_is_begun_anew(folder, tmp_path):
    out = tmp_path / "out.h5"
    part = out.with_name("out.h5.part")
    part.write_bytes(b"not a file of this kind")
    made("correlate", folder, "-o", out, "--every", "5")
    with h5py.File(out) as file:
        assert file["u"].shape[0] == 1
        assert "_done" not in file


def test_settings_in_memory(folder, tmp_path):
    out = tmp_path / "out.h5"
    make(folder, out, {"window": 24, "spacing": 16, "every": 5}, threads=2, quiet=True)
    with read_plane(out) as plane:
        used = json.loads(plane.attrs["settings"])
        assert (used["window"], used["spacing"], used["every"]) == (24, 16, 5)
        assert np.diff(plane["x"])[0] == 16


@pytest.mark.parametrize(
    "settings, message",
    [({"windows": 24}, "unknown setting 'windows'"), ({"window": "24"}, "has the wrong type")],
)
def test_wrong_settings_in_memory(folder, tmp_path, settings, message):
    with pytest.raises(ValueError, match=message):
        make(folder, tmp_path / "out.h5", settings, quiet=True)


BAD = "pairing=1-3 frames=4 frames=9 threads=0 window=500 preset=x mask=nowhere.png"


@pytest.mark.parametrize("flag", [*BAD.split(), "preprocess=magic=1", "preprocess=none,cap=3"])
def test_bad_flags_end_with_one_sentence(folder, tmp_path, capsys, flag):
    assert piv("correlate", folder, "-o", tmp_path / "x.h5", "--quiet", f"--{flag}") == 2
    said = capsys.readouterr().err.strip()
    assert said.startswith("piv correlate: ")
    assert "\n" not in said


def test_ensemble_and_multi_frame_and_couples(folder, tmp_path, capsys):
    ways = {"e": ("--ensemble",), "m": ("--frames", "3"), "c": ("--pairing", "1-2,3-4")}
    for (name, extra), count in zip(ways.items(), (1, 4, 3), strict=True):
        out = tmp_path / f"{name}.h5"
        made("correlate", folder, "-o", out, *extra)
        with read_plane(out) as plane:
            assert plane.sizes["time"] == count
            assert float(plane["u"].median()) == pytest.approx(2, abs=0.03)
        # frames of 96 px are too small to tell the camera's shake
        said = capsys.readouterr().err
        assert ("could not be measured in 4 of 4 fields" in said) == (name == "m")


def test_shake_of_the_camera_does_not_cost_the_multi_frame_mode_its_accuracy():
    rng = np.random.default_rng(82)
    camera = rng.normal(size=(5, 2))
    camera -= camera[2]

    def flow(x, y):
        return 3 + 1.5 * np.sin(y / 40), 1.5 * np.cos(x / 45)

    def path(x, y, t):
        u, v = flow(x, y)
        return x + t * u + camera[round(t) + 2, 0], y + t * v + camera[round(t) + 2, 1]

    instants = (-2.0, -1.0, 0.0, 1.0, 2.0)
    frames = render(None, shape=(256, 320), seed=82, noise=0.03, frames=instants, path=path)

    def error(field):
        """RMS about the field's common error, px; the common error's size."""
        at = np.meshgrid(field["x"].values, field["y"].values)
        off = np.array([field[n].values - w for n, w in zip("uv", flow(*at), strict=True)])
        off = off[:, 4:-4, 4:-4]
        assert np.isfinite(off).mean() > 0.99
        common = np.nanmean(off, axis=(1, 2), keepdims=True)
        return np.sqrt(np.nanmean((off - common) ** 2)), np.hypot(*common[:, 0, 0])

    pair, five = correlate_pair(*frames[2:4]), correlate_frames(frames)
    assert not five.attrs["shake_unknown"]
    assert error(five)[0] < error(pair)[0] / 1.5  # asked for; 4 to 5 measured
    slope = np.arange(-2, 3) @ camera / 10
    # frames' own shifts to 0.01 px
    assert error(five)[1] == pytest.approx(np.hypot(*slope), abs=0.03)
    # 1.5 here, 4 to 16 of other shakes
    assert error(correlate_frames(frames, shake=False))[0] > 1.2 * error(five)[0]
