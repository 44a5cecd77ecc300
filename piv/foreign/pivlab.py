"""The .mat export of a PIVlab session (any version of the format): its instants, from a file that is read once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.io import loadmat

from fileio.child_process import check_walkable
from fileio.errors import one_line
from piv.foreign.mat_check import check_mat

NAMES = (
    "x", "y", "units", "u_original", "v_original", "typevector_original", "u_filtered", "v_filtered", "typevector_filtered",
)  # fmt: skip
DAMAGES = (RuntimeError, KeyError, OSError, TypeError, AttributeError, OverflowError, MemoryError)
Instant = tuple[
    tuple[np.ndarray, ...], str
]  # x, y, u, v and the type of each vector; what the file says of units


def instants(path: Path) -> Iterator[Instant]:
    """Every instant of the session; FileNotFoundError, or ValueError where it is damaged or another kind of file."""
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    count = 0
    for found in _of_hdf5(path) if h5py.is_hdf5(path) else _of_mat5(path):  # HDF5: version 7.3
        count += 1
        yield found
    if not count:
        raise ValueError(f"{path}: no vectors in it")


def _of_mat5(path: Path) -> Iterator[Instant]:
    mat = _load(path, NAMES)
    cells = mat["x"].size if "x" in mat and mat["x"].dtype == object else 1
    for k in range(cells):
        try:
            found = _mat5_instant(mat, k)
        except IndexError:
            raise ValueError(f"{path}: no frame {k} in it") from None
        except Exception as error:  # scipy's reader raises whatever its parts raise on foreign bytes
            raise ValueError(f"{path}: not a .mat export of PIVlab ({one_line(error)})") from error
        yield found


def _mat5_instant(mat: dict[str, Any], k: int) -> Instant:
    get = lambda n: np.ravel(mat[n])[k] if mat[n].dtype == object else mat[n]  # noqa: E731
    units = str(np.ravel(mat["units"])[0]) if "units" in mat else ""
    end = "filtered" if "u_filtered" in mat and np.size(get("u_filtered")) else "original"
    return tuple(np.asarray(get(n), float) for n in _vector_names(end)), units


def _vector_names(end: str) -> tuple[str, ...]:
    return "x", "y", f"u_{end}", f"v_{end}", f"typevector_{end}"


def _load(path: Path, names: Sequence[str]) -> dict[str, Any]:
    """Those of the variables `names` that a MAT 5 file holds; ValueError where it is damaged or another format."""
    try:
        found: dict[str, Any] = loadmat(path, variable_names=check_mat(path, names))
    except Exception as error:  # scipy's reader raises whatever its parts raise on foreign bytes
        if str(error).startswith(f"{path}: "):
            raise
        raise ValueError(f"{path}: not a .mat export of PIVlab ({one_line(error)})") from error
    return found


def _of_hdf5(path: Path) -> Iterator[Instant]:
    check_walkable(path)
    with _told(path, lambda: h5py.File(path, "r")) as file:
        cells = _told(path, lambda: file["x"].size if file["x"].dtype == h5py.ref_dtype else 1)
        for k in range(cells):
            yield _told(path, partial(_hdf5_instant, path, file, k))


def _told(path: Path, read: Callable[[], Any]) -> Any:
    """What `read` gives; ValueError with one sentence where the file is damaged."""
    try:
        return read()
    except DAMAGES as error:
        raise ValueError(f"{path}: damaged, or not a .mat export of PIVlab ({one_line(error)})") from error


def _hdf5_instant(path: Path, file: h5py.File, k: int) -> Instant:
    def get(name: str) -> np.ndarray:
        if name not in file:
            raise ValueError(f"{path}: not a .mat export of PIVlab (no {name!r})")
        cell = file[name]
        if cell.dtype == h5py.ref_dtype:
            if k >= cell.size:
                raise ValueError(f"{path}: no frame {k}, it holds {cell.size}")
            cell = file[np.ravel(cell[...])[k]]
        return np.asarray(cell[...], float).T

    filtered = "u_filtered" in file and get("u_filtered").shape == get("x").shape
    units = "".join(map(chr, np.ravel(file["units"][...]))) if "units" in file else ""
    return tuple(get(n) for n in _vector_names("filtered" if filtered else "original")), units
