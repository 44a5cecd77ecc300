"""The plane-series format: velocity on a regular plane over time (docs/formats.md)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from fileio.errors import one_line
from fileio.hdf5 import open_netcdf, whole_netcdf
from fileio.provenance import versions

FORMAT = "plane-series"
FORMAT_VERSION = 1
UNITS = {
    "time": "s",
    "x": "m",
    "y": "m",
    "u": "m/s",
    "v": "m/s",
    "w": "m/s",
    "u_std": "m/s",
    "v_std": "m/s",
    "dwdz": "1/s",
    "p": "Pa",
    "valid": "1",
    "flag": "1",
    "outline": "m",
    "outline_velocity": "m/s",
    "tip": "m",
    "tip_direction": "1",
    "dorsal_direction": "1",
    "bend": "rad",
}
BLOCK = 2**18  # vectors looked at at once
FINGER_VARIABLES = ("outline", "outline_velocity", "tip", "tip_direction", "dorsal_direction", "bend")


LIBRARIES = ("numpy", "scipy", "opencv-python-headless", "numba", "xarray", "h5py")


def provenance(**settings: Any) -> dict[str, str]:
    """Attributes that say what made a file: library versions and the settings given, as JSON."""
    return {
        "versions": json.dumps(versions(*LIBRARIES)),
        "settings": json.dumps(settings, sort_keys=True, default=str),
    }


def make_plane(
    x: np.ndarray,
    y: np.ndarray,
    u: np.ndarray,
    v: np.ndarray,
    *,
    time: np.ndarray | None = None,
    valid: np.ndarray | None = None,
    **more: np.ndarray,
) -> xr.Dataset:
    """A checked plane (y, x) or plane series (time, y, x) from arrays in SI.

    `more` holds further variables of docs/formats.md by name. Raises ValueError where shapes or axes do not fit.
    """
    grid: tuple[str, ...] = ("y", "x") if time is None else ("time", "y", "x")
    coords = {"x": np.asarray(x, float), "y": np.asarray(y, float)}
    if time is not None:
        coords["time"] = np.asarray(time, float)
    fields: dict[str, tuple[tuple[str, ...], np.ndarray]] = {"u": (grid, u), "v": (grid, v)}
    ok = np.isfinite(u) & np.isfinite(v) if valid is None else np.asarray(valid).astype(bool)
    fields["valid"] = (grid, ok.astype(np.uint8))
    lead = () if time is None else ("time",)
    for name, values in more.items():
        if name in FINGER_VARIABLES:
            fields[name] = (*lead, "finger", *finger_axes(name)), values
        else:
            fields[name] = (grid, values)
    plane = xr.Dataset({k: (d, np.asarray(a)) for k, (d, a) in fields.items()}, coords=coords)
    for name in map(str, plane.variables):
        if name in UNITS:
            plane[name].attrs["units"] = UNITS[name]
    check_plane(plane)
    return plane


def finger_axes(name: str) -> tuple[str, ...]:
    """Dimensions, beside time and finger, of a variable of FINGER_VARIABLES."""
    axes: dict[str, tuple[str, ...]] = {
        "outline": ("point", "axis"),
        "outline_velocity": ("point", "axis"),
        "bend": (),
    }
    return axes.get(name, ("axis",))


def check_plane(plane: xr.Dataset) -> None:
    """Raise ValueError with one sentence where `plane` is not a plane (series)."""
    for name in ("x", "y", "u", "v", "valid"):
        if name not in plane.variables:
            raise ValueError(
                f"a plane needs the variable {name!r}; this one has {sorted(map(str, plane.variables))}"
            )
    for axis in ("x", "y"):
        c = plane[axis].values
        if c.ndim != 1 or c.size < 2 or not np.all(np.diff(c) > 0):
            raise ValueError(
                f"axis {axis!r} of a plane must be one-dimensional and ascending, got shape {c.shape}"
            )
        if np.ptp(np.diff(c)) > 1e-6 * (c[-1] - c[0]):
            raise ValueError(f"axis {axis!r} of a plane must be regularly spaced")
    check_vectors(plane)


def check_vectors(plane: xr.Dataset) -> None:
    """ValueError where a vector marked valid is no number; a series that is not in memory is read a block at a time."""
    u, v, valid = (plane[name].variable for name in ("u", "v", "valid"))
    if not (u.dims == v.dims == valid.dims and u.dims in (("y", "x"), ("time", "y", "x"))):
        dims = ", ".join(f"{n} over {a.dims}" for n, a in (("u", u), ("v", v), ("valid", valid)))
        raise ValueError(f"u, v and valid of a plane are over (y, x) or (time, y, x), not {dims}")
    series = u.ndim == 3
    step = max(1, BLOCK // max(1, u.shape[-1] * u.shape[-2]))
    for k in range(0, u.shape[0], step) if series else (0,):
        # one instant as it is: what is read of it stays for the caller
        a, b, good = (f[k : k + step].values if series else f.values for f in (u, v, valid))
        wrong = ~(np.isfinite(a) & np.isfinite(b)) & (good != 0)
        if wrong.any():
            instant = k + int(np.argmax(wrong.any(axis=(1, 2)))) if series else 0
            when = f" at {plane['time'].values.flat[instant]:g} s" if "time" in plane.coords else ""
            raise ValueError(f"a plane has vectors marked valid{when} whose u or v is not finite")


def write_plane(plane: xr.Dataset, path: str | Path, **attrs: Any) -> None:
    """Write a plane series to HDF5, whole or not at all; `attrs` become root attributes."""
    check_plane(plane)
    out = plane.assign_attrs(plane.attrs | {"format": FORMAT, "format_version": FORMAT_VERSION} | attrs)
    deflate = {str(n): {"zlib": True, "complevel": 1} for n, d in out.data_vars.items() if d.ndim >= 2}
    whole_netcdf(out, path, encoding=deflate)


def read_plane(path: str | Path) -> xr.Dataset:
    """Open a plane series lazily; ValueError where the file is another one or damaged."""
    plane = open_netcdf(path, "HDF5 plane series")
    if plane.attrs.get("format") != FORMAT:
        raise ValueError(f"{path}: format is {plane.attrs.get('format')!r}, expected {FORMAT!r}")
    if int(plane.attrs.get("format_version", 0)) > FORMAT_VERSION:
        raise ValueError(f"{path}: written by a newer version of this project; update it to read the file")
    return plane


def read_checked_plane(path: str | Path) -> xr.Dataset:
    """`read_plane` of a file that may be another program's: its grid and every vector are looked at, block by block.

    That reads the file once more: what goes through a long series once anyway opens it with `read_plane` and calls
    `check_vectors` on each instant.
    """
    return checked(read_plane(path), path)


def checked(plane: xr.Dataset, path: str | Path) -> xr.Dataset:
    """The plane as it is, after `check_plane`; where that refuses it, it is closed and the ValueError names the file."""
    try:
        check_plane(plane)
    except Exception as error:  # of damaged data h5py raises more than one kind
        plane.close()
        raise ValueError(f"{path}: {one_line(error, 300)}") from error
    return plane
