"""The .mat export of a PIVlab session, MAT 5 or HDF5 (7.3), read in a child process."""

from collections.abc import Callable
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

VECTORS = ("u", "v", "typevector")
NAMES = ("x", "y", "units", *(f"{n}_{end}" for n in VECTORS for end in ("original", "filtered")))
Instant = tuple[
    tuple[ndarray, ...], str
]  # x, y, u, v and the type of each vector; the file's text about units


def instants(path: Path) -> list[Instant]:
    """Every instant of the session; FileNotFoundError, or ValueError for another kind of file."""
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    try:
        if new := h5py.is_hdf5(path):
            check_hdf5(path)
        session = read_in_child(_hdf5_session if new else _mat5_session, str(path))
    except Exception as error:  # scipy and HDF5 raise whatever their parts raise on foreign bytes
        raise ValueError(
            f"{path}: damaged, or not a .mat export of PIVlab ({one_line(error, 200)})"
        ) from error
    if not session:
        raise ValueError(f"{path}: no vectors in it")
    return session


def _mat5_session(path: str) -> list[Instant]:
    if matfile_version(path)[0] != 1:
        raise ValueError("MAT 4 is not read; save it with -v7 or -v7.3")
    mat = loadmat(path, variable_names=NAMES)
    units = str(np.ravel(mat["units"])[0]) if "units" in mat else ""

    def get(name: str, k: int) -> ndarray:
        return np.ravel(mat[name])[k] if mat[name].dtype == object else mat[name]

    return _session(mat, get, mat["x"].size if mat["x"].dtype == object else 1, units)


def _hdf5_session(path: str) -> list[Instant]:
    with h5py.File(path, "r") as file:
        units = "".join(map(chr, np.ravel(file["units"][...]))) if "units" in file else ""

        def get(name: str, k: int) -> ndarray:
            cell = file[name]
            return (file[np.ravel(cell[...])[k]] if cell.dtype == h5py.ref_dtype else cell)[...].T

        return _session(
            file, get, file["x"].size if file["x"].dtype == h5py.ref_dtype else 1, units
        )


def _session(
    variables: Any, get: Callable[[str, int], Any], count: int, units: str
) -> list[Instant]:
    """`count` instants of the session's variables; filtered vectors where there are some."""

    def numbers(name: str, k: int) -> ndarray:
        if name not in variables:
            raise ValueError(f"no variable {name!r}")
        try:
            values = np.asarray(get(name, k))
        except IndexError:
            raise ValueError(f"no frame {k} of {name!r}") from None
        if values.dtype.kind not in "fiu":
            raise ValueError(f"{name!r} does not hold real numbers")
        return values.astype(float)

    session = []
    for k in range(count):
        x = numbers("x", k)
        # an empty array, PIVlab's [], holds its two dimensions in HDF5
        filtered = "u_filtered" in variables and numbers("u_filtered", k).shape == x.shape
        end = "filtered" if filtered else "original"
        session.append(((x, numbers("y", k), *(numbers(f"{n}_{end}", k) for n in VECTORS)), units))
    return session
