"""The solver's sampled surfaces (VTK's legacy format, binary).

On a full disk OpenFOAM continues and leaves cut files, which VTK reads without an error.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np
import pyvista as pv

from fileio.atomic import check_room
from fileio.errors import StageError
from fileio.formats.mesh_intervals import Interval
from fileio.record import check_whole

_SIZES = {"float": 4, "double": 8, "int": 4, "long": 8}  # bytes


def is_whole_vtk(path: Path) -> bool:
    """Whether a file of OpenFOAM's (format version 2.0) is there and as long as its headers say."""
    try:
        with path.open("rb") as file:
            return _is_whole(file)
    except FileNotFoundError:
        return False


def _is_whole(file: BinaryIO) -> bool:
    """The same of an open file: reads its headers and skips its values."""
    size = os.fstat(file.fileno()).st_size
    sections: list[bytes] = []
    try:
        version = file.readline()
        if version.startswith(b"# vtk") and version.endswith(b"\n") and b" 2.0" not in version:
            return True  # another layout than OpenFOAM's: VTK reads it
        for _ in range(3):  # title, BINARY, DATASET
            file.readline()
        while line := file.readline():
            if not line.strip():
                continue
            sections.append(line.split()[0])
            for count, kind in _arrays(line.split(), file):
                if not 0 <= count <= size:
                    return False
                file.seek(count * _SIZES[kind] + 1, io.SEEK_CUR)
    except (ValueError, IndexError, KeyError):
        return False
    values = sections[-2:] in ([b"POINT_DATA", b"FIELD"], [b"CELL_DATA", b"FIELD"])
    return values and b"POINTS" in sections and file.tell() == size


def _arrays(line: list[bytes], file: BinaryIO) -> Iterator[tuple[int, str]]:
    """Number of values and their type of each array of the section that begins with `line`."""
    if line[0] == b"POINTS":
        yield 3 * int(line[1]), line[2].decode()
    elif line[0] == b"POLYGONS":
        yield int(line[2]), "int"
    elif line[0] == b"FIELD":
        for _ in range(int(line[2])):
            words = file.readline().split()
            yield int(words[1]) * int(words[2]), words[3].decode()
    elif line[0] not in (b"POINT_DATA", b"CELL_DATA"):
        raise ValueError(line[0])


def sampled_surfaces(
    case: Path, intervals: tuple[Interval, ...], name: str
) -> list[tuple[float, Path]]:
    """Times and files of the surface `name` over all intervals, ascending; StageError if none."""
    surfaces = []
    for interval in intervals:
        folder = case / interval.name / "postProcessing" / f"{name}Surface"
        files = [(float(file.parent.name), file) for file in folder.glob(f"*/{name}.vtk")]
        if not files:
            raise StageError(f"{folder}: the solver wrote no {name}; run the stage 'run' first")
        # the overlap belongs to the interval before
        surfaces += sorted(file for file in files if file[0] > interval.start + 1e-9)
    return surfaces


def read_surface(path: Path) -> pv.PolyData:
    """A surface; StageError where it was cut off, OSError where the disk is full."""
    if not is_whole_vtk(path):
        check_room(path.parent)
        raise StageError(
            f"{path}: missing or cut off, as by a full disk; run make again: the solver resumes"
            " before that time"
        )
    check_whole(path, "delete it and run make again: the solver resumes before that time")
    return cast(pv.PolyData, pv.read(path))


def area_vectors(surface: pv.PolyData) -> np.ndarray:
    """Area (m²) times unit normal of each plane polygon (face, 3), in the sense of its corners."""
    faces = surface.GetPolys()
    corners = surface.points[pv.convert_array(faces.GetConnectivityArray())].astype(float)
    first = pv.convert_array(faces.GetOffsetsArray())
    after = np.arange(1, len(corners) + 1)
    after[first[1:] - 1] = first[:-1]
    # from a corner of its own: a face is small, and far from 0
    arms = corners - np.repeat(corners[first[:-1]], np.diff(first), axis=0)
    return 0.5 * np.add.reduceat(np.cross(arms, arms[after]), first[:-1])
