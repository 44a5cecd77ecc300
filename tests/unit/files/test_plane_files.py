"""Plane series and recordings: checked when they are read; series written by instant."""

import h5py
import numpy as np
import pytest
import xarray as xr

from piv.formats.plane_series import make_plane, read_plane, write_plane
from piv.formats.plane_writer import instant, new_series, write_blocks
from piv.formats.recording import RecordingWriter
from piv.images.open_recording import open_recording

X, Y, TIME = np.linspace(0, 0.03, 4), np.linspace(0, 0.02, 3), np.array([0.5, 0.6])
U = np.arange(24.0).reshape(2, 3, 4)
TIP = np.zeros((2, 1, 2))


def plane(path):
    write_plane(make_plane(X, Y, U, -U, time=TIME, tip=TIP), path)
    return read_plane


def recording(path):
    with RecordingWriter(path, (3, 4), np.uint8, 2, {"frame_rate_hz": 10.0}) as writer:
        for k in range(2):
            writer.write(k, np.zeros((3, 4), np.uint8))
        writer.finish()
    return open_recording


@pytest.mark.parametrize("written, name", [(plane, "v"), (recording, "frames")])
def test_another_version_and_a_missing_variable_are_refused(tmp_path, written, name):
    path = tmp_path / "a.h5"
    read = written(path)
    read(path).close()
    with h5py.File(path, "a") as file:
        del file[name]
    with pytest.raises(ValueError, match=rf"a\.h5: .*'{name}'.*; make it again"):
        read(path)
    for version in (0, 2):
        with h5py.File(path, "a") as file:
            file.attrs["format_version"] = version
        words = rf"a\.h5: format_version of this \S+ file is {version}, this program reads 1; make"
        with pytest.raises(ValueError, match=words):
            read(path)


def test_a_series_written_instant_by_instant_is_the_one_written_whole(tmp_path):
    plane(tmp_path / "whole.h5")
    valid = np.ones((3, 4), np.uint8)
    fields = [{"u": U[k], "v": -U[k], "valid": valid, "tip": TIP[k]} for k in range(2)]
    axes = new_series(TIME, X, Y).assign_attrs(source="cfd")
    write_blocks(map(instant, fields), tmp_path / "new" / "parts.h5", axes)
    whole, parts = (read_plane(tmp_path / name) for name in ("whole.h5", "new/parts.h5"))
    assert parts.attrs["source"] == "cfd"
    xr.testing.assert_equal(whole, parts)
    assert all(parts[n].attrs == whole[n].attrs for n in whole.variables)


def test_a_series_that_fails_halfway_leaves_no_file(tmp_path):
    ends = {"nothing": [{"u": U[0]}, {"nothing": U[0]}], "1 of": [{"u": U[0]}]}
    for message, parts in ends.items():
        with pytest.raises((KeyError, ValueError), match=message):
            write_blocks(map(instant, parts), tmp_path / "a.h5", new_series(TIME, X, Y))
        assert not (tmp_path / "a.h5").exists()
