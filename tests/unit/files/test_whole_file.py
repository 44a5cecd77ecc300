"""Files are whole or not there, also on a disk that becomes full."""

import errno
import os

import h5py
import numpy as np
import pytest

from piv.files import atomic as whole_file
from piv.files import hdf5_disk
from piv.files.atomic import check_room, whole, write_bytes, write_text
from piv.files.errors import StageError, sentence
from piv.files.hdf5_disk import DiskFile
from piv.formats.recording import RecordingWriter
from piv.formats.resumable import SeriesWriter
from piv.plots import film

SHAPE = (64, 96)


def no_space():
    """The error of a full disk."""
    return OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.fixture
def room(monkeypatch):
    """Sets how many more bytes the disk of HDF5's files takes, beyond those reserved."""
    left, reserved = [10**12], [0]
    write, reserve = os.pwrite, os.posix_fallocate

    def pwrite(descriptor, content, offset):
        take = len(content)
        if offset + take > reserved[0]:
            take = min(take, left[0])
            left[0] -= take
        if not take:
            raise OSError(errno.EDQUOT, os.strerror(errno.EDQUOT))
        return write(descriptor, content[:take], offset)

    def fallocate(descriptor, offset, size):
        if size - reserved[0] > left[0]:
            raise no_space()
        left[0] -= size - reserved[0]
        reserved[0] = size
        reserve(descriptor, offset, size)

    monkeypatch.setattr(hdf5_disk.os, "pwrite", pwrite)
    monkeypatch.setattr(hdf5_disk.os, "posix_fallocate", fallocate)

    def set_room(size):
        left[0] = size

    return set_room


def test_a_file_that_cannot_be_finished_is_not_there(tmp_path):
    path = tmp_path / "table.csv"
    write_text(path, "old")

    def cut_off():
        with whole(path) as part:
            part.write_text("ne")
            raise no_space()  # as of write(): it names no file

    with pytest.raises(OSError, match="No space") as caught:
        cut_off()
    assert caught.value.filename == str(path)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["table.csv"]
    assert sentence(caught.value) == (
        f"{path}: No space left on device; free some of the disk, then run it again: what is"
        " finished is kept"
    )


@pytest.mark.parametrize("write", [check_room, lambda folder: write_bytes(folder / "a", b"x")])
def test_the_disk_may_refuse_what_it_took_at_first(tmp_path, monkeypatch, write):
    """A quota, and disks in the network, refuse content only when it is sent."""
    write(tmp_path / "new")

    def refused(descriptor):
        raise no_space()

    monkeypatch.setattr(whole_file.os, "fsync", refused)
    with pytest.raises(OSError, match="No space"):
        write(tmp_path)
    assert os.listdir(tmp_path) == ["new"]


@pytest.mark.parametrize("size", [0, 100, 3000, 20_000])
def test_hdf5_never_meets_a_full_disk(tmp_path, room, size):
    """The library itself crashes of it, in close() or when the process ends."""
    room(size)
    path = tmp_path / "a.h5"

    def fill():
        layout = {"chunks": (1, 32, 32), "compression": "gzip"}
        with whole(path) as part, DiskFile(part, "w") as file:
            data = file.create_dataset("u", (40, 32, 32), "f8", **layout)
            for k in range(40):
                data[k] = np.random.default_rng(k).random((32, 32))

    with pytest.raises(OSError, match=r"No space|quota") as caught:
        fill()
    assert caught.value.filename == str(path)
    assert not os.listdir(tmp_path)


def picture(k):
    return np.random.default_rng(k).integers(0, 255, SHAPE).astype(np.uint8)


def recorder(path):
    return RecordingWriter(path, SHAPE, np.uint8, 8, {"frame_rate_hz": 100.0}, mask=True)


@pytest.mark.parametrize("extra", [0, 700, 1500])
def test_a_recording_goes_on_where_the_disk_became_full(tmp_path, room, extra):
    """The masks, which are compressed, need room as they come; written frames stay."""
    room(SHAPE[0] * SHAPE[1] * 4)
    path = tmp_path / "images.h5"
    with pytest.raises(OSError, match="No space"):  # refused before its first frame
        recorder(path)
    assert not os.listdir(tmp_path)
    room(10**12)
    written = []
    mask = np.random.default_rng(0).random(SHAPE) > 0.5

    def render():
        with recorder(path) as writer:
            for k in (k for k in range(8) if k not in writer.done):
                if len(written) == 3:
                    room(extra)
                writer.write(k, picture(k), mask)
                written.append(k)
            writer.add("tip", ("time", "axis"), np.zeros((8, 2)), "m")
            writer.finish()

    with pytest.raises(OSError, match=r"No space|quota"):
        render()
    assert not path.exists()
    room(10**12)
    with recorder(path) as again:
        assert again.resumed
        assert set(written) <= set(again.done)
    written.extend(range(100, 200))
    render()
    with h5py.File(path) as file:
        assert all((file["frames"][k] == picture(k)).all() for k in range(8))
        assert all((file["mask"][k] == mask).all() for k in range(8))


def test_a_film_that_ffmpeg_cannot_finish_is_told_in_its_words(tmp_path):
    images = [np.zeros((32, 32, 3), np.uint8)] * 3
    path = tmp_path / "film.mp4"
    film.write_film(images, path, 20.0)
    assert path.stat().st_size > 500
    with pytest.raises(ValueError, match="ffmpeg ended with code"):
        film.write_film(images, tmp_path / "film.nonsense", 20.0)
    with pytest.raises(OSError, match="No space"):
        film._check(1, f"av_interleaved_write_frame(): {os.strerror(errno.ENOSPC)}\n", path)
    assert os.listdir(tmp_path) == ["film.mp4"]


def test_a_folder_that_is_not_there_is_told_by_both_writers(tmp_path):
    path = tmp_path / "nosuch" / "a.h5"
    with pytest.raises(FileNotFoundError) as caught:
        RecordingWriter(path, SHAPE, np.uint8, 2, {"frame_rate_hz": 100.0})
    assert "nosuch" in (sentence(caught.value) or "")
    units = {"x": "px", "y": "px", "time": "1", "u": "px"}
    with pytest.raises(FileNotFoundError):
        SeriesWriter(path, [0.0, 1.0], [0.0, 1.0], [0.0], units, {}, "a")


def test_an_unfinished_file_that_may_not_be_opened_is_kept(tmp_path, monkeypatch):
    def refused(*_):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(part))

    part = tmp_path / "a.h5.part"
    part.write_bytes(b"frames of another day")
    monkeypatch.setattr(hdf5_disk, "Disk", refused)
    with pytest.raises(PermissionError):
        RecordingWriter(tmp_path / "a.h5", SHAPE, np.uint8, 2, {"frame_rate_hz": 100.0})
    assert part.read_bytes() == b"frames of another day"


def test_a_folder_is_not_replaced_and_no_part_is_left(tmp_path):
    (tmp_path / "folder").mkdir()
    with pytest.raises(StageError, match="is no file but a folder"):
        write_text(tmp_path / "folder", "x")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder"]


def test_a_link_in_the_place_of_an_unfinished_file_is_not_followed(tmp_path):
    other = tmp_path / "other"
    other.write_text("another's")
    for name in ("a.csv", "a.h5"):
        (tmp_path / f"{name}.part").symlink_to(other)
    write_text(tmp_path / "a.csv", "mine")
    with recorder(tmp_path / "a.h5") as writer:
        writer.write(0, picture(0), picture(0) > 100)
    assert other.read_text() == "another's"
    assert (tmp_path / "a.csv").read_text() == "mine"
