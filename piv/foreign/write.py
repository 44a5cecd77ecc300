"""Plane series in the formats that other programs open."""

import io
from pathlib import Path

import numpy as np
import xarray as xr

from piv.files.atomic import write_text
from piv.foreign.export import write_csv, write_mat, write_tecplot, write_vti
from piv.foreign.pivpy import write_pivpy
from piv.formats.plane_series import check_plane, write_plane

_WHOLE = {  # which hold every variable
    ".h5": write_plane,
    ".nc": write_pivpy,
    ".csv": write_csv,
    ".mat": write_mat,
    ".dat": write_tecplot,
    ".vti": write_vti,
}
_OPENPIV = ("u", "v", "valid", "flag")  # what its files hold of each vector


def write_vectors(plane: xr.Dataset, path: str | Path) -> list[Path]:
    """Write by suffix: .h5, .nc (pivpy), .csv, .mat, .dat (Tecplot), .vti, .txt (OpenPIV).

    The last two write one file per instant, numbered where there are several; `left_out` says
    what the last one cannot hold. Returns the files.
    """
    path = Path(path)
    check_plane(plane)
    suffix = path.suffix.lower()
    if suffix in _WHOLE:
        return _WHOLE[suffix](plane, path) or [path]
    if suffix != ".txt":
        known = " ".join([*_WHOLE, ".txt"])
        raise ValueError(f"{path}: cannot write {suffix!r}; known are {known}")
    if "time" not in plane.dims:
        frames, names = [plane], [path]
    else:
        frames = [plane.isel(time=k) for k in range(plane.sizes["time"])]
        width = max(4, len(str(len(frames) - 1)))
        names = [path.with_name(f"{path.stem}_{k:0{width}d}{suffix}") for k in range(len(frames))]
    for name, frame in zip(names, frames, strict=True):
        write_text(name, _openpiv(frame))
    return names


def left_out(plane: xr.Dataset, path: str | Path) -> list[str]:
    """Names of the variables that the format of `path` does not hold."""
    openpiv = Path(path).suffix.lower() == ".txt"
    return [str(n) for n in plane.data_vars if openpiv and n not in _OPENPIV]


def units_of(plane: xr.Dataset) -> tuple[str, str]:
    """(unit of length, unit of velocity) that a plane states."""
    return str(plane["x"].attrs.get("units", "m")), str(plane["u"].attrs.get("units", "m/s"))


def circulation_unit(length: str) -> str:
    """Unit of a circulation in a plane whose unit of `length` is this."""
    return "px²/frame" if length == "px" else f"{length}²/s"


def _openpiv(plane: xr.Dataset) -> str:
    length, velocity = units_of(plane)
    x, y = (a.ravel() for a in np.meshgrid(plane["x"].values, plane["y"].values))
    u, v, absent = (plane[n].values.ravel() for n in ("u", "v", "valid"))
    absent = absent == 0
    masked = plane["flag"].values.ravel() == 2 if "flag" in plane else absent
    rows = np.column_stack([x, y, u, v, absent & ~masked, masked])
    text = io.StringIO()
    np.savetxt(
        text,
        rows,
        fmt="%.9g",
        delimiter="\t",
        header=f"length {length}; velocity {velocity}; y up\nx\ty\tu\tv\tflags\tmask",
    )
    return text.getvalue()
