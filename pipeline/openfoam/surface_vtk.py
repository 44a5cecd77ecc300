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

from pipeline.formats.mesh_intervals import Interval
from piv.files.atomic import check_room
from piv.files.errors import StageError
from piv.files.record import check_whole

_TYPES = {"float": ">f4", "double": ">f8", "int": ">i4", "long": ">i8"}
_Layout = dict[str, tuple[int, int, str]]


def is_whole_vtk(path: Path) -> bool:
    """Whether a file of OpenFOAM's (format version 2.0) is there and as long as its headers say."""
    return _layout_of(path) is not None


def _layout_of(path: Path) -> _Layout | None:
    """Offset, number and type of each array's values; None of a missing or cut file."""
    try:
        with path.open("rb") as file:
            return _layout(file)
    except FileNotFoundError:
        return None


def _layout(file: BinaryIO) -> _Layout | None:
    size = os.fstat(file.fileno()).st_size
    sections: list[bytes] = []
    found = {}
    try:
        version = file.readline()
        if version.startswith(b"# vtk") and version.endswith(b"\n") and b" 2.0" not in version:
            return {}  # another layout than OpenFOAM's: VTK reads it
        for _ in range(3):  # title, BINARY, DATASET
            file.readline()
        while line := file.readline():
            if not line.strip():
                continue
            sections.append(line.split()[0])
            for name, count, kind in _arrays(line.split(), file):
                if not 0 <= count <= size:
                    return None
                found[name] = file.tell(), count, _TYPES[kind]
                file.seek(count * int(_TYPES[kind][-1]) + 1, io.SEEK_CUR)
    except (ValueError, IndexError, KeyError):
        return None
    values = sections[-2:] in ([b"POINT_DATA", b"FIELD"], [b"CELL_DATA", b"FIELD"])
    return found if values and b"POINTS" in sections and file.tell() == size else None


def _arrays(line: list[bytes], file: BinaryIO) -> Iterator[tuple[str, int, str]]:
    """Name, number of values and type of each array of the section that begins with `line`."""
    if line[0] == b"POINTS":
        yield "POINTS", 3 * int(line[1]), line[2].decode()
    elif line[0] == b"POLYGONS":
        yield "POLYGONS", int(line[2]), "int"
    elif line[0] == b"FIELD":
        for _ in range(int(line[2])):
            words = file.readline().split()
            yield words[0].decode(), int(words[1]) * int(words[2]), words[3].decode()
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
            raise StageError(f"{folder}: the solver wrote no {name}; run the stage 'solve' first")
        # the overlap belongs to the interval before
        surfaces += sorted(file for file in files if file[0] > interval.start + 1e-9)
    return surfaces


def _check(path: Path) -> _Layout:
    """StageError where a sample was cut off, OSError where the disk is full."""
    layout = _layout_of(path)
    if layout is None:
        check_room(path.parent)
        raise StageError(
            f"{path}: missing or cut off, as by a full disk; run make again: the solver resumes"
            " before that time"
        )
    check_whole(path, "delete it and run make again: the solver resumes before that time")
    return layout


def read_surface(path: Path) -> pv.PolyData:
    """A surface; errors as of `_check`."""
    _check(path)
    return cast(pv.PolyData, pv.read(path))


def wall_forces(path: Path, density: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres (face, 3) m of a wall's faces, force of the water on each (N), and velocity (m/s).

    The sample has cell values p (m²/s²), wallShearStress and U. Errors as of `_check`.
    """
    # without VTK: a coupled run reads one in each step
    layout, content = _check(path), path.read_bytes()
    if not layout:
        raise StageError(f"{path}: not of VTK format version 2.0; run it again by OpenFOAM v1912")

    def values(name: str) -> np.ndarray:
        offset, count, kind = layout[name]
        return np.frombuffer(content, kind, count, offset).astype(kind[1:])

    first, of_polygon, polygons = [], 0, values("POLYGONS")
    while of_polygon < len(polygons):  # each begins with the number of its corners
        first.append(of_polygon)
        of_polygon += int(polygons[of_polygon]) + 1
    corners = values("POINTS").reshape(-1, 3)[np.delete(polygons, first)].astype(float)
    count = polygons[first]
    start = np.cumsum(count) - count
    after = np.arange(1, len(corners) + 1)
    after[start + count - 1] = start
    # from a corner of its own: a face is small, and far from 0
    arms = corners - np.repeat(corners[start], count, axis=0)
    area = 0.5 * np.add.reduceat(np.cross(arms, arms[after]), start)
    centre = np.add.reduceat(corners, start) / count[:, None]
    shear, velocity = (values(name).reshape(-1, 3) for name in ("wallShearStress", "U"))
    # normals point into the finger; wallShearStress is that of the wall on the water
    size = np.linalg.norm(area, axis=1)[:, None]
    return centre, density * (values("p")[:, None] * area - shear * size), velocity
