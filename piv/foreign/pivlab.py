"""Sessions and .mat exports of PIVlab, MAT 5 or HDF5 (7.3), read in a child process."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy import ndarray
from scipy.io import loadmat
from scipy.io.matlab import matfile_version

from piv.files.child_process import read_in_child
from piv.files.errors import one_line
from piv.files.hdf5 import check_hdf5
from piv.foreign.vectors import Vectors, on_grid, spelled

_VECTORS = ("u", "v", "typevector")
_NAMES = ("x", "y", *(f"{n}_{end}" for n in _VECTORS for end in ("original", "filtered")))
# rows of a session's `resultslist`
_OF_SESSION = tuple(zip((0, 1, 2, 6, 3, 7, 4, 8), _NAMES, strict=True))
_STATED = ("calxy", "calu", "expected_image_size")  # of a session
Instant = list[ndarray]  # x, y, u, v and the type of each vector


def read_pivlab(path: Path) -> Iterator[Vectors]:
    """Every instant; ValueError for another kind of file.

    Filtered vectors where there are some. Vector type 1 is measured, 0 masked, 2 rejected and
    interpolated: absent. A session is in px, and states its calibration. In
    px y points down (PIVlab's image axes); an export does not say where it points in metres.
    """
    for (x, y, u, v, kind), stated in instants(path):
        flag = np.select([kind == 1, kind == 0], [0, 2], 1)
        more = stated | ({"y_axis": "down"} if stated.get("length_unit") == "px" else {})
        yield Vectors(*on_grid(path, [x, y, u, v], flag), **more)


def instants(path: Path) -> list[tuple[Instant, dict[str, Any]]]:
    """Every instant, and what the file states of units, scale, clock and picture."""
    try:
        if new := h5py.is_hdf5(path):
            check_hdf5(path)
        found = read_in_child(_read, str(path), new)
    except Exception as error:  # scipy and HDF5 raise whatever their parts raise on foreign bytes
        raise ValueError(
            f"{path}: damaged, or not a session or .mat export of PIVlab ({one_line(error, 200)})"
        ) from error
    if not found:
        raise ValueError(f"{path}: no vectors in it")
    return found


def _read(path: str, new: bool) -> list[tuple[Instant, dict[str, Any]]]:
    mat = _hdf5(path) if new else _mat5(path)
    stated: dict[str, Any] = {}
    if "resultslist" in mat:
        mat |= {
            name: mat["resultslist"][k] for k, name in _OF_SESSION if k < len(mat["resultslist"])
        }
        stated = {"length_unit": "px", "velocity_unit": "px/frame"}
        scale, speed, size = (np.ravel(mat.get(name, [])) for name in _STATED)
        if scale.size and speed.size and scale[0] != 1:  # m per px, and m/s per px/frame
            stated |= {"scale_mm_per_px": 1e3 * float(scale[0])}
            stated |= {"interval": float(scale[0]) / abs(float(speed[0]))}
        stated |= {"image_rows": int(size[0])} if size.size else {}
    elif len(units := re.findall(r"\[([^\]]*)\]", str(mat.get("units", "")))) > 1:
        stated = {"length_unit": spelled(units[0]), "velocity_unit": spelled(units[1])}
    columns = {
        n: list(v.ravel()) if v.dtype == object else [v] for n, v in mat.items() if n in _NAMES
    }

    def numbers(name: str, k: int) -> ndarray:
        if name not in columns:
            raise ValueError(f"no variable {name!r}")
        if k >= len(columns[name]):
            raise ValueError(f"no frame {k} of {name!r}")
        values = np.asarray(columns[name][k])
        if values.dtype.kind not in "fiu":
            raise ValueError(f"{name!r} does not hold real numbers")
        return values.astype(float)

    found = []
    for k in range(len(columns.get("x", [0]))):
        x = numbers("x", k)
        if x.ndim < 2 or not x.size:  # PIVlab's [], of a pair that was not correlated
            continue
        filtered = "u_filtered" in columns and numbers("u_filtered", k).shape == x.shape
        end = "filtered" if filtered else "original"
        found.append(([x, numbers("y", k), *(numbers(f"{n}_{end}", k) for n in _VECTORS)], stated))
    return found


def _mat5(path: str) -> dict[str, Any]:
    if matfile_version(path)[0] != 1:
        raise ValueError("MAT 4 is not read; save it with -v7 or -v7.3")
    names = (*_NAMES, "units", "resultslist", *_STATED)
    mat = loadmat(path, variable_names=names)
    return mat | ({"units": np.ravel(mat["units"])[0]} if np.size(mat.get("units", [])) else {})


def _hdf5(path: str) -> dict[str, Any]:
    with h5py.File(path, "r") as file:

        def values(item: h5py.Dataset) -> ndarray:
            if item.dtype != h5py.ref_dtype:
                return item[...].T
            cells = np.empty(item.shape, object)
            for where, reference in np.ndenumerate(item[...]):
                cells[where] = values(file[reference])
            return cells.T

        names = (*_NAMES, "resultslist", *_STATED)
        mat: dict[str, Any] = {name: values(file[name]) for name in names if name in file}
        if "units" in file:
            mat["units"] = "".join(map(chr, np.ravel(file["units"][...])))
        return mat
