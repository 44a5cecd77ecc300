"""Declared schemas: what is checked of a file, in one sentence; docs/reference lists them."""

import h5py
import numpy as np
import pytest

from piv.files.errors import StageError
from piv.files.hdf5 import whole_netcdf
from piv.files.schema import Schema, variables

SCHEMA = Schema(
    "track",
    variables("""
time  time  s  instants
at  time, axis  Pa  place
std?~  time  1  if
  known
width  -  m  of it
"""),
    variables("node  node  1  number"),
    version=3,
    remedy="make it again",
)
GOOD = {"time": np.arange(3.0), "at": np.zeros((3, 2)), "width": 0.1}


def test_what_is_written_is_read_with_units_and_the_roots_attributes(tmp_path):
    path = tmp_path / "new" / "a.h5"
    values = GOOD | {"std": np.array([1, np.nan, 2])}
    SCHEMA.write(path, values, {"g": {"node": np.arange(4)}}, units={"at": "m"})
    assert SCHEMA.read(path)["at"].attrs == {"units": "m", "long_name": "place"}
    assert SCHEMA.read(path)["std"].attrs["long_name"] == "if known"
    group = SCHEMA.read(path, "g")
    assert group["node"].values.tolist() == [0, 1, 2, 3]
    assert group.attrs["width"] == 0.1


@pytest.mark.parametrize(
    "change, words",
    [
        ({"at": None}, r"variable 'at' is missing"),
        ({"width": None}, r"attribute 'width' is missing"),
        ({"at": ("time", np.zeros(3))}, r"'at' is over \(time\), not \(time, axis\)"),
        ({"at": (("time", "axis"), np.full((3, 2), np.inf))}, r"'at' holds NaN or infinite values"),
    ],
)
def test_a_file_that_is_incomplete_or_wrong_is_one_sentence(tmp_path, change, words):
    path = tmp_path / "a.h5"
    SCHEMA.write(path, GOOD)
    with SCHEMA.read(path) as good:
        new = {name: value for name, value in change.items() if value is not None}
        bad = good.drop_vars(list(change.keys() & set(good))).assign(new)
    bad.attrs = {name: value for name, value in good.attrs.items() if name not in change}
    whole_netcdf(bad, path)
    with pytest.raises(StageError, match=rf"^\S+a\.h5: {words}; make it again$"):
        SCHEMA.read(path)


@pytest.mark.parametrize("version", [2, 4])
def test_an_older_or_newer_file_is_refused_with_what_to_do(tmp_path, version):
    path = tmp_path / "a.h5"
    SCHEMA.write(path, GOOD)
    with h5py.File(path, "a") as file:
        file.attrs["format_version"] = version
    words = rf"a\.h5: format_version of this track file is {version}, this program reads 3; make"
    with pytest.raises(StageError, match=words):
        SCHEMA.read(path)


@pytest.mark.parametrize("group", [None, "g"])
def test_missing_damaged_and_foreign_files_are_one_sentence(tmp_path, group):
    path = tmp_path / "a.h5"
    with pytest.raises(StageError, match=r"a\.h5: missing; make it again$"):
        SCHEMA.read(path, group)
    path.write_bytes(b"no HDF5")
    with pytest.raises(StageError, match=r"a\.h5: not a readable HDF5 file .*; make it again$"):
        SCHEMA.read(path, group)
    Schema("other", ()).write(path, {})
    with pytest.raises(StageError, match=r"a\.h5: format is 'other', not 'track'; make it again$"):
        SCHEMA.read(path, group)


def test_a_missing_group_is_one_sentence(tmp_path):
    SCHEMA.write(tmp_path / "a.h5", GOOD)
    with pytest.raises(StageError, match=r"a\.h5: .*; make it again$"):
        SCHEMA.read(tmp_path / "a.h5", "g")


def test_a_writer_cannot_write_what_no_reader_takes(tmp_path):
    with pytest.raises(StageError, match="'at' is missing"):
        SCHEMA.write(tmp_path / "a.h5", {"time": np.arange(3.0), "width": 1.0})
    assert not (tmp_path / "a.h5").exists()
