"""Damage by a power cut, a full disk or a defect is named with file, place and remedy."""

import shutil
import struct

import numpy as np
import pytest

from pipeline.formats.bending_states import read_states
from pipeline.formats.mesh_intervals import Interval
from pipeline.kinematics.recorded_motion import recorded_law
from pipeline.openfoam.surface_vtk import is_whole_vtk, read_surface, wall_forces
from pipeline.solve.checkpoint import (
    PROGRESS,
    STATE,
    first_damaged,
    has_ended,
    prepared_for,
    read_progress,
)
from piv.files.errors import StageError
from piv.files.hdf5 import open_netcdf
from piv.formats.plane_series import make_plane
from piv.images.open_recording import open_recording
from postprocess.evidence.fields import frame


@pytest.mark.parametrize(
    "content", [b"", b'{"wall_time": 1', b"\x00" * 40, b"\xff\xfe", b"[1, 2]", b"null"]
)
def test_half_written_json_is_one_sentence(tmp_path, content):
    assert prepared_for(tmp_path) == {}
    assert read_progress(tmp_path)["wall_time"] == 0.0  # never begun
    for name, read in ((PROGRESS, read_progress), (STATE, prepared_for)):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(StageError, match="delete it and run make again") as caught:
            read(tmp_path)
        assert str(tmp_path / name) in str(caught.value)
        assert "\n" not in str(caught.value)


def surface(values):
    """A sampled surface as of OpenFOAM v1912: three points, one triangle, p on the points."""
    head = b"# vtk DataFile Version 2.0\ntime='0.1'\nBINARY\nDATASET POLYDATA\n"
    head += b"FIELD FieldData 1\nTimeValue 1 1 float\n" + struct.pack(">f", 0.1) + b"\n"
    points = b"POINTS 3 float\n" + np.eye(3).astype(">f4").tobytes() + b"\n\n"
    polygons = b"POLYGONS 1 4\n" + np.array([3, 0, 1, 2], ">i4").tobytes() + b"\n\n"
    data = b"POINT_DATA 3\nFIELD FieldData 1\np 1 3 float\n" + np.array(values, ">f4").tobytes()
    return head + points + polygons + data + b"\n"


def test_a_sample_is_whole_or_cut_off(tmp_path):
    path = tmp_path / "postProcessing" / "sheetSurface" / "0.1" / "sheet.vtk"
    path.parent.mkdir(parents=True)
    content = surface([1.0, 2.0, 3.0])
    path.write_bytes(content)
    assert is_whole_vtk(path)
    np.testing.assert_array_equal(read_surface(path)["p"], [1, 2, 3])
    for size in range(len(content)):
        path.write_bytes(content[:size])
        assert not is_whole_vtk(path), size
    with pytest.raises(StageError, match="cut off, as by a full disk; run make again"):
        read_surface(path)


def test_wall_forces_of_another_layout_are_refused(tmp_path):
    path = tmp_path / "a.vtk"
    path.write_bytes(surface([1.0, 2.0, 3.0]).replace(b"Version 2.0", b"Version 5.1"))
    with pytest.raises(StageError, match=r"a\.vtk: not of VTK format version 2\.0.*OpenFOAM v1912"):
        wall_forces(path, 1000.0)


@pytest.mark.parametrize("count", [b"-9", b"9" * 30, b"x"])
def test_a_header_of_impossible_numbers_is_damage(tmp_path, count):
    path = tmp_path / "a.vtk"
    for told in (b"POINTS 3 ", b"p 1 3 "):
        path.write_bytes(surface([1.0, 2.0, 3.0]).replace(told, told.replace(b"3", count)))
        assert not is_whole_vtk(path)


def test_a_damaged_or_foreign_hdf5_file_is_one_sentence_wherever_it_is_opened(tmp_path):
    path = tmp_path / "a.h5"
    path.write_bytes(b"no HDF5")
    remedies = (
        (lambda: open_recording(path), ValueError, "not a readable HDF5 file"),
        (lambda: open_netcdf(path, "netCDF-4 file"), ValueError, "not a readable netCDF-4 file"),
        (lambda: read_states(path, 0.01), StageError, "write it again with make fea"),
        (lambda: recorded_law(path, 1.0), StageError, "write it again"),
    )
    for read, kind, words in remedies:
        with pytest.raises(kind, match=words) as caught:
            read()
        assert str(caught.value).count(str(path)) == 1
        assert "\n" not in str(caught.value)
    with pytest.raises(FileNotFoundError):
        open_netcdf(tmp_path / "none.h5")


def sampled(case, times_of):
    for name, times in times_of.items():
        for time in times:
            folder = case / "postProcessing" / name / f"{time:g}"
            folder.mkdir(parents=True)
            (folder / "a.vtk").write_bytes(surface([0, 0, 0]))


def test_a_run_goes_on_before_its_first_damaged_sample(tmp_path):
    sampled(tmp_path, {"sheetSurface": (0.1, 0.2, 0.3), "fingerSurface": (0.1, 0.2)})
    assert first_damaged(tmp_path) == pytest.approx(0.3)  # of which one recorder has none
    path = tmp_path / "postProcessing" / "fingerSurface" / "0.2" / "a.vtk"
    path.write_bytes(path.read_bytes()[:-1])
    assert first_damaged(tmp_path) == 0.2
    assert first_damaged(tmp_path / "nothing") == np.inf


def test_an_interval_whose_last_sample_is_lost_has_not_ended(tmp_path):
    sampled(tmp_path, {"sheetSurface": (0.1, 0.2, 0.3), "fingerSurface": (0.1, 0.2, 0.3)})
    (tmp_path / PROGRESS).write_text('{"ended": true}')
    interval = Interval(0, 0.0, 0.0, 0.3, 0)
    assert has_ended(tmp_path, interval)
    (tmp_path / "postProcessing" / "sheetSurface" / "0.3" / "a.vtk").unlink()
    assert not has_ended(tmp_path, interval)


def test_recorders_of_different_rates_are_no_damage(tmp_path):
    fast = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
    sampled(tmp_path, {"sheetSurface": (0.2, 0.4, 0.6), "fingerSurface": fast})
    assert first_damaged(tmp_path) == np.inf
    shutil.rmtree(tmp_path / "postProcessing" / "fingerSurface" / "0.5")
    assert first_damaged(tmp_path) == pytest.approx(0.5)


def test_a_vector_that_is_no_number_is_told_by_its_instant():
    axis, zero = np.arange(4.0), np.zeros((3, 4, 4))
    plane = make_plane(axis, axis, zero, zero, time=np.array([0.0, 0.1, 0.2]))
    plane["u"][1, 2, 2] = np.inf
    frame(plane, 0)
    with pytest.raises(ValueError, match=r"frame 1: .* at 0\.1 s .*not finite"):
        frame(plane, 1)
