"""Readers, pairing and the recording writer: round trips, and one sentence for bad input."""

import struct

import cv2
import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from piv.correlation.options import Options
from piv.formats.recording import RecordingWriter
from piv.images import recording as recording_of_frames
from piv.images.open_recording import open_recording, pairs
from piv.sequence.frame_sets import SequenceOptions
from piv.sequence.sequence import correlate_recording


def frames(n=5, shape=(40, 50), top=4096, seed=0):
    return np.random.default_rng(seed).integers(0, top, (n, *shape)).astype(np.uint16)


def one_sentence(error) -> bool:
    text = str(error.value)
    return "\n" not in text and len(text) < 300


@pytest.mark.parametrize("suffix", ["tif", "png", "bmp"])
@pytest.mark.parametrize("bits", [8, 16])
def test_folder_in_natural_order(tmp_path, suffix, bits):
    if suffix == "bmp" and bits == 16:
        pytest.skip("BMP holds 8 bit")
    data = frames(11) if bits == 16 else (frames(11) >> 4).astype(np.uint8)
    for k, image in enumerate(data):
        cv2.imwrite(str(tmp_path / f"run{k}.{suffix}"), image)
    with open_recording(tmp_path) as recording:
        assert len(recording) == 11
        assert recording.shape == (40, 50)
        assert recording.attrs["bits"] == bits
        assert np.array_equal(np.stack(list(recording)), data)
    with open_recording(str(tmp_path / f"run*.{suffix}")) as recording:
        assert np.array_equal(recording.frame(10), data[10])
        assert recording.times is None


def test_stack_is_read_page_by_page_and_a_cut_stack_is_refused(tmp_path):
    data = frames()
    path = tmp_path / "stack.tif"
    cv2.imwritemulti(str(path), list(data))
    assert np.array_equal(open_recording(path).frame(3), data[3])
    whole = path.read_bytes()
    for size in (0, 3, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:size])
        with pytest.raises(ValueError, match=r"stack\.tif") as error:
            open_recording(path).frame(4)
        assert one_sentence(error)


def test_mixed_sizes_name_the_file(tmp_path):
    cv2.imwrite(str(tmp_path / "a1.png"), np.zeros((20, 30), np.uint8))
    cv2.imwrite(str(tmp_path / "a2.png"), np.zeros((20, 31), np.uint8))
    recording = open_recording(tmp_path)
    recording.frame(0)
    with pytest.raises(ValueError, match=r"a2.png: 31x20 px"):
        recording.frame(1)


def test_empty_mixed_and_missing_sources(tmp_path):
    with pytest.raises(ValueError, match="holds no image"):
        open_recording(tmp_path)
    with pytest.raises(FileNotFoundError, match="no such file"):
        open_recording(tmp_path / "none.tif")
    with pytest.raises(FileNotFoundError, match="no file matches"):
        open_recording(str(tmp_path / "*.tif"))
    (tmp_path / "a.tif").touch()
    (tmp_path / "b.png").touch()
    with pytest.raises(ValueError, match="mixes"):
        open_recording(tmp_path)


def test_colour_is_refused_unless_a_rule_is_given(tmp_path):
    colour = np.zeros((20, 30, 3), np.uint8)
    colour[..., 1] = 100
    path = tmp_path / "c.png"
    cv2.imwrite(str(path), colour)
    with pytest.raises(ValueError, match="colour"):
        open_recording(path).frame(0)
    assert open_recording(path, colour="green").frame(0)[0, 0] == 100
    assert open_recording(path, colour="luma").frame(0)[0, 0] == 59  # 0.587 of 100, Rec. 601
    colour[:] = 7
    cv2.imwrite(str(path), colour)
    assert open_recording(path).frame(0)[0, 0] == 7


def test_video_in_any_order(tmp_path):
    data = (frames(14) >> 4).astype(np.uint8)
    path = tmp_path / "v.avi"
    out = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"FFV1"), 25, (50, 40))
    for image in data:
        out.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    out.release()
    with open_recording(path) as recording:
        for i in (0, 1, 12, 11, 2, 13, 0):
            assert np.array_equal(recording.frame(i), data[i])  # FFV1 is lossless
        assert recording.times is None  # a playing rate is not a frame rate


@pytest.mark.parametrize("bits", [12, 16])
def test_photron(tmp_path, bits):
    import pyMRAW

    data = frames()
    pyMRAW.save_mraw(data, str(tmp_path / "a.cih"), 16, info_dict={"Record Rate(fps)": 500})
    if bits == 12:  # two pixels in three bytes, high bits first
        a, b = data.ravel()[::2], data.ravel()[1::2]
        packed = np.stack([a >> 4, (a & 15) << 4 | b >> 8, b & 255], axis=1).astype(np.uint8)
        (tmp_path / "a.mraw").write_bytes(packed.tobytes())
        header = tmp_path / "a.cih"
        header.write_text(header.read_text().replace("Color Bit : 16", "Color Bit : 12"))
    with open_recording(tmp_path / "a.mraw") as recording:
        assert np.array_equal(np.stack(list(recording)), data)
        assert recording.attrs["bits"] == 12
        assert recording.times[1] == pytest.approx(0.002)
    raw = (tmp_path / "a.mraw").read_bytes()
    (tmp_path / "a.mraw").write_bytes(raw[:-1])
    with pytest.raises(ValueError, match="announces 5 frames"):
        open_recording(tmp_path / "a.mraw")


def test_recording_resumes_and_keeps_finished_frames(tmp_path):
    data, path = frames(), tmp_path / "images.h5"
    attrs = {"frame_rate_hz": 500.0, "scale_mm_per_px": 0.1, "bits": 12, "camera": {"name": "UX"}}
    with RecordingWriter(path, (40, 50), np.uint16, 5, attrs, mask=True) as writer:
        writer.write(3, data[3], data[3] > 2000)
        with pytest.raises(ValueError, match="4 of 5 frames"):
            writer.finish()
    assert not path.exists()
    with RecordingWriter(path, (40, 50), np.uint16, 5, attrs, mask=True) as writer:
        assert writer.resumed
        assert writer.done == {3}
        for i in (0, 1, 2, 4):
            writer.write(i, data[i], data[i] > 2000)
        writer.add("outline", ("time", "finger", "point", "axis"), np.zeros((5, 1, 7, 2)), "m")
        writer.finish()
    with open_recording(path) as recording:
        assert np.array_equal(np.stack(list(recording)), data)
        assert np.array_equal(recording.mask(2), data[2] > 2000)
        assert recording.attrs["scale_mm_per_px"] == 0.1
        assert recording.times[4] == pytest.approx(0.008)
    with xr.open_dataset(path, engine="h5netcdf") as opened:
        assert opened["frames"].dims == ("time", "row", "column")
        assert opened["outline"].attrs["units"] == "m"


def test_pairs():
    assert pairs(4) == [(0, 1), (1, 2), (2, 3)]
    assert pairs(4, "1-2,3-4") == [(0, 1), (2, 3)]
    assert pairs(6, skip=1, every=2) == [(0, 2), (2, 4)]
    with pytest.raises(ValueError, match="last frame has no partner"):
        pairs(5, "1-2,3-4")


@given(n=st.integers(0, 30), skip=st.integers(0, 5), every=st.integers(1, 5))
def test_pairs_stay_inside(n, skip, every):
    try:
        indices = pairs(n, skip=skip, every=every)
    except ValueError:
        assert n < skip + 2
        return
    assert all(0 <= a < b < n and b - a == skip + 1 for a, b in indices)


def named(folder, *names):
    for name in names:
        cv2.imwrite(str(folder / name), np.zeros((8, 8), np.uint8))
    return folder


@pytest.mark.parametrize("glob", ["", "*.tif"])
def test_a_missing_frame_keeps_its_place_and_many_are_refused(tmp_path, glob):
    named(tmp_path, *(f"f{k:03d}.tif" for k in (1, 2, 4, 5, 6)))
    recording = open_recording(str(tmp_path / glob))
    assert (len(recording), recording.missing) == (6, {2})
    with pytest.raises(ValueError, match=r"f003\.tif: this picture is missing") as error:
        recording.frame(2)
    assert one_sentence(error)
    named(tmp_path, *(f"f{k:03d}.tif" for k in (901, 902, 903)))
    words = r"f006\.tif: 894 are missing between it and f901\.tif"
    with pytest.raises(ValueError, match=words) as error:
        open_recording(str(tmp_path / glob))
    assert one_sentence(error)


@pytest.mark.parametrize(
    "names",
    [
        [f"f{k}.tif" for k in (2, 4, 6, 8)],  # every other frame
        [f"f{k}.tif" for k in (1, 2, 11, 12, 21, 22)],  # couples
        [f"f{k}_{c}.tif" for k in (1, 2, 3, 7) for c in "ab"],  # of a case each
        [f"t{k}.tif" for k in (0, 33, 67, 100)],  # times, ms
        ["before.tif", "f1.tif", "f3.tif", "f4.tif"],
    ],
)
def test_numbers_that_do_not_count_frames_lack_none(tmp_path, names):
    assert len(open_recording(named(tmp_path, *names))) == len(names)


def test_a_big_tiff_of_impossible_numbers_and_a_picture_of_no_camera_are_told_by_name(
    tmp_path, monkeypatch
):
    entries = struct.pack("<Q", 2**63)
    path = tmp_path / "bigcount.tif"
    path.write_bytes(b"II" + struct.pack("<HHHQ", 43, 8, 0, 16) + entries)
    with pytest.raises(ValueError, match=r"bigcount\.tif: not readable as a TIFF image"):
        open_recording(path)
    cv2.imwrite(str(tmp_path / "a.png"), frames(1)[0])
    monkeypatch.setattr(recording_of_frames, "LARGEST_CHUNK", 1999)
    with pytest.raises(ValueError, match=r"a\.png: 50x40 px are more than PIV takes"):
        open_recording(tmp_path / "a.png").frame(0)


def test_pictures_smaller_than_a_window_are_told_by_name(tmp_path):
    for k in (0, 1):
        cv2.imwrite(str(tmp_path / f"a{k}.png"), frames(1, (24, 32))[0])
    words = r"a0\.png \.\.\. a1\.png: images of 32x24 px"
    with open_recording(tmp_path) as recording, pytest.raises(ValueError, match=words):
        correlate_recording(recording, tmp_path / "o.h5", Options(), SequenceOptions())


@pytest.mark.parametrize(
    "index, frame, mask, message",
    [
        (0, np.zeros((4, 5)), None, "float64"),
        (0, np.zeros((1, 5), np.uint8), None, "expected"),
        (-1, np.zeros((4, 5), np.uint8), None, "outside the 2 frames"),
        (0, np.zeros((4, 5), np.uint8), np.zeros((4, 5), bool), "with every frame or with none"),
    ],
)
def test_a_frame_that_does_not_fit_its_recording_is_refused(tmp_path, index, frame, mask, message):
    attrs = {"frame_rate_hz": 100.0}
    with (
        pytest.raises(ValueError, match=message),
        RecordingWriter(tmp_path / "a.h5", (4, 5), np.uint8, 2, attrs) as writer,
    ):
        writer.write(index, frame, mask)
