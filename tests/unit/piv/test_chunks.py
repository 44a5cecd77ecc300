"""A recording in chunks: joined, equal to the serial file to the last byte."""

import shutil
import time
import tracemalloc
from pathlib import Path

import h5py
import numpy as np
import pytest

from docs.evidence.piv.flows import uniform
from docs.evidence.piv.particles import render
from piv.correlation.options import Options
from piv.formats.recording import RecordingWriter
from piv.images.open_recording import open_recording
from piv.images.part_of_recording import part_of_recording
from piv.images.recording import Recording
from piv.sequence.chunks import chunk_path, join, parts_of
from piv.sequence.frame_sets import SequenceOptions
from piv.sequence.sequence import correlate_recording
from tests.piv_command import made, piv

SHAPE = (64, 80)
FRAMES = 12


@pytest.fixture(scope="module")
def recording_file(tmp_path_factory):
    """Twelve small frames with mask, scale and a finger with unit direction vectors."""
    path = tmp_path_factory.mktemp("recording") / "images.h5"
    images = render(uniform(1.5, 0), shape=SHAPE, seed=4, frames=range(FRAMES))
    attrs = {"scale_mm_per_px": 0.1, "origin_x_px": 3.0, "origin_y_px": 0.0}
    attrs |= {"frame_rate_hz": 500.0, "bits": 8}
    angle = np.linspace(0, 1, FRAMES)[:, None]
    with RecordingWriter(path, SHAPE, np.uint8, FRAMES, attrs, mask=True) as writer:
        for k, image in enumerate(images):
            writer.write(k, image, np.zeros(SHAPE, np.uint8))
        axes, tip = ("time", "finger", "axis"), np.arange(2.0 * FRAMES).reshape(FRAMES, 1, 2)
        writer.add("tip", axes, tip, "m")
        writer.add("tip_direction", axes, np.stack([np.cos(angle), np.sin(angle)], -1), "1")
        writer.finish()
    return path


@pytest.fixture(scope="module")
def serial(recording_file, tmp_path_factory):
    out = tmp_path_factory.mktemp("serial") / "piv.h5"
    made("correlate", recording_file, "-o", out)
    return out.read_bytes()


def chunked(recording_file, out: Path, of: int, *more: str) -> None:
    for k in range(1, of + 1):
        made("correlate", recording_file, "-o", out, "--chunk", f"{k}/{of}", *more)


def test_chunks_joined_are_the_serial_file_to_the_last_byte(recording_file, serial, tmp_path):
    out = tmp_path / "piv.h5"
    chunked(recording_file, out, 4)
    time.sleep(1.1)  # a time stamp in the file would differ
    made("join", out)
    assert out.read_bytes() == serial
    assert [p.name for p in tmp_path.iterdir()] == ["piv.h5"]


def test_a_finished_chunk_is_kept_unless_settings_changed(recording_file, tmp_path, capsys):
    out = tmp_path / "piv.h5"
    chunked(recording_file, out, 2)
    first = chunk_path(out, 1, 2)
    before = first.stat().st_mtime_ns
    chunked(recording_file, out, 2)
    assert first.stat().st_mtime_ns == before
    arguments = f"correlate {recording_file} -o {out} --quiet --chunk 1/2 --window 24".split()
    assert piv(*arguments) == 0
    assert first.stat().st_mtime_ns > before
    assert piv("join", out) == 2  # one half has other windows
    assert "other settings" in capsys.readouterr().err


def test_a_chunk_with_another_mask_is_made_anew_and_not_joined(recording_file, tmp_path):
    """The mask is no setting of the correlation, but part of the identity."""
    out = tmp_path / "piv.h5"
    body = np.zeros(SHAPE, bool)
    body[:, :40] = True

    def part(k: int, mask: np.ndarray | None) -> int:
        with open_recording(recording_file) as recording:
            seen = part_of_recording(recording, mask)
            path = correlate_recording(seen, out, Options(), SequenceOptions(), chunk=(k, 2))
        return path.stat().st_mtime_ns

    first = part(1, None)
    assert part(1, None) == first
    assert part(1, body) > first
    part(2, None)
    with pytest.raises(ValueError, match="other settings"):
        join(parts_of(out), out)


def test_a_chunk_that_is_missing_or_of_no_use_is_named_with_how_it_is_made(
    recording_file, tmp_path, capsys
):
    out = tmp_path / "piv.h5"
    chunked(recording_file, out, 3)
    part = chunk_path(out, 2, 3)
    for damage in ("missing", "another file"):
        part.unlink()
        if damage == "another file":
            shutil.copy(recording_file, part)
        assert piv("join", out) == 2
        said = capsys.readouterr().err
        assert str(part) in said
        assert "make it with the same piv correlate and --chunk 2/3" in said
        part.unlink(missing_ok=True)  # as it says
        made("correlate", recording_file, "-o", out, "--chunk", "2/3")
    assert piv("join", out) == 0


@pytest.mark.parametrize(
    "extra",
    [["--chunk", "3"], ["--chunk", "0/2"], ["--chunk", "1/99"], ["--chunk", "1/2", "--ensemble"]],
)
def test_bad_chunks_end_with_one_sentence(recording_file, tmp_path, capsys, extra):
    assert piv("correlate", recording_file, "-o", tmp_path / "x.h5", "--quiet", *extra) == 2
    assert capsys.readouterr().err.count("\n") == 1


class Session(Recording):
    """A recording of any length, drawn on demand: shifted cuts of one picture."""

    def __init__(self, count: int) -> None:
        super().__init__("session", count)
        self.times = np.arange(count) / 500.0
        self.picture = render(lambda x, y: (0 * x, 0 * y), shape=(64, 192), seed=1, frames=(0,))[0]

    def _read(self, i: int) -> np.ndarray:
        return np.ascontiguousarray(self.picture[:, i % 128 : i % 128 + 64])


def test_memory_does_not_grow_with_the_chunk(tmp_path):
    """Of 100,000 frames four times the fields take no more memory than the list of times."""
    peaks = []
    for fields in (8, 32):
        of = 99_999 // fields
        session, path = Session(100_000), tmp_path / "piv.h5"
        options = Options(spacing=16), SequenceOptions()
        tracemalloc.start()
        out = correlate_recording(session, path, *options, chunk=(of // 2, of))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        with h5py.File(out) as file:
            assert file["u"].shape[0] in (fields, fields + 1)
            # every 128th pair of cuts jumps back: elsewhere the picture moves by a pixel
            assert np.nanmedian(file["u"][...]) == pytest.approx(-1 * 1.0, abs=0.02)
    assert peaks[1] < peaks[0] + 24 * 64 * 64  # less than the frames themselves would take
