"""The plane-series format: velocity on a regular plane over time (docs/formats.md)."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy import ndarray

from piv.files.errors import StageError, one_line
from piv.files.hdf5 import open_netcdf, whole_netcdf
from piv.files.provenance import versions
from piv.files.schema import Schema, variables

FLAGS = (
    "valid", "outlier", "masked", "second peak taken", "replaced on request", "uncertain",
    "no picture", "repeated picture",
)  # fmt: skip
VALID, OUTLIER, MASKED, SECOND_PEAK, REPLACED, UNCERTAIN, NO_PICTURE, REPEATED = range(len(FLAGS))
REMEDY = "make it again with this version of the program"
FINGERS = variables("""
outline?~  time?, finger, point, axis  m  closed polygon of the body in the sheet, last ≠ first
outline_velocity?~  time?, finger, point, axis  m/s  of its points; with it the body moves particles
tip?~  time?, finger, axis  m  middle of the finger's tip
tip_direction?~  time?, finger, axis  1  unit vector out of the tip, along the finger
dorsal_direction?~  time?, finger, axis  1  unit vector at the tip, from ventral to dorsal side
bend?~  time?, finger  rad  bend angle, positive towards the ventral side
""")
_LOADS = variables("""
p_outline?~  time, finger, point  Pa  pressure of the water on the outline
p_outline_std?~  time, finger, point  Pa  its standard uncertainty
line_force?~  time, finger, axis  N/m  force of that pressure per length across the sheet
line_force_std?~  time, finger, axis  N/m  its standard uncertainty
line_moment?~  time, finger  N  its moment about `moment_about`, per length across the sheet
line_moment_std?~  time, finger  N  its standard uncertainty
pressure_reference?  -  -  where `p` is 0
pressure_boundary?  -  -  what was taken as known on the outline
moment_about?  -  m  x, y of the moment's point
""")
ORIGIN = variables("""
source?  -  -  `cfd`, `piv`, `truth` or `lab`
tip_width?  -  m  of the finger
seed?  -  -  of random numbers
fixed_bodies?  -  -  JSON: closed polygons [[x, y], …] of bodies that do not move, m
versions?  -  -  JSON: of the libraries
settings?  -  -  JSON: with which it was made
""")
SCHEMA = Schema(
    "plane-series",
    variables("""
time?  time  s  ascending; of PIV: the middle of the two exposures
y  y  m  ascending, regular
x  x  m  ascending, regular
u~  time?, y, x  m/s  velocity along x; absent (NaN) where `valid` is 0 and `flag` not 5
v~  time?, y, x  m/s  velocity along y, likewise
valid~  time?, y, x  1  uint8: 1 = measured; 0 = inside a body, masked, or rejected
flag?~  time?, y, x  1  uint8: 0 valid, 1 outlier, 2 masked, 3 second peak taken, 4 replaced on
  request, 5 uncertain (`u`, `v` and `u_std` are there, `valid` is 0); of a whole field that is
  absent: 6 a picture is missing or shows no particles, 7 a picture repeats the one before it
u_std?~  time?, y, x  m/s  standard uncertainty of u
v_std?~  time?, y, x  m/s  standard uncertainty of v
correlation?~  time?, y, x  1  of PIV: height of the peak, 1 = the two windows are alike
w?~  time?, y, x  m/s  out-of-plane velocity on the sheet
dwdz?~  time?, y, x  1/s  its gradient across the sheet
p?~  time?, y, x  Pa  pressure without the hydrostatic part, zero far away; of PIV: see
  `pressure_reference`
p_std?~  time?, y, x  Pa  standard uncertainty of p
""")
    + FINGERS
    + _LOADS
    + ORIGIN
    + variables("interval?  -  s  between the exposures of a pair, where it is the same for all"),
    remedy=REMEDY,
)
AXES = {v.name: v.axes for v in SCHEMA.root}  # dimensions of a series, by variable
UNITS = {v.name: v.units for v in SCHEMA.root if v.dims != "-"}
BLOCK = 2**18  # vectors in memory at once
FINGER_VARIABLES = tuple(v.name for v in FINGERS)
# of a vector, where a series has them
VECTORS = ("u", "v", "valid", "flag", "u_std", "v_std")
_LIBRARIES = ("numpy", "scipy", "opencv-python-headless", "numba", "xarray", "h5py")


def provenance(**settings: Any) -> dict[str, str]:
    """Attributes with the library versions and settings that made a file, as JSON."""
    return {
        "versions": json.dumps(versions(*_LIBRARIES)),
        "settings": json.dumps(settings, sort_keys=True, default=str),
    }


def make_plane(
    x: ndarray,
    y: ndarray,
    u: ndarray,
    v: ndarray,
    *,
    time: ndarray | None = None,
    valid: ndarray | None = None,
    **more: ndarray,
) -> xr.Dataset:
    """Make a plane (y, x) or a plane series (time, y, x) of arrays in SI.

    Parameters
    ----------
    x, y
        Axes, m, ascending and regular; y up.
    u, v
        Velocity over (y, x) or (time, y, x), m/s; NaN where absent.
    time
        Instants of a series, s.
    valid
        Where vectors are measured; by default where u and v are finite.
    more
        Further variables of docs/formats.md by name, such as u_std.

    Returns
    -------
    xarray.Dataset
        What every function here takes.

    Raises
    ------
    ValueError
        Where the arrays do not fit the axes.

    Examples
    --------
    >>> x = np.arange(0, 0.16, 0.008)
    >>> u, v = np.meshgrid(0.5 * x, -0.5 * x)  # flow against a wall
    >>> plane = piv.make_plane(x, x, u, v)
    >>> plane["u"].dims, plane["u"].attrs["units"]
    (('y', 'x'), 'm/s')
    """
    series = time is not None
    coords = {"x": np.asarray(x, float), "y": np.asarray(y, float)}
    if series:
        coords["time"] = np.asarray(time, float)
    ok = np.isfinite(u) & np.isfinite(v) if valid is None else np.asarray(valid).astype(bool)
    fields = {"u": u, "v": v, "valid": ok.astype(np.uint8), **more}
    axes = {name: AXES.get(name, AXES["u"])[0 if series else 1 :] for name in fields}
    plane = xr.Dataset({n: (axes[n], np.asarray(a)) for n, a in fields.items()}, coords=coords)
    for name in map(str, plane.variables):
        if name in UNITS:
            plane[name].attrs["units"] = UNITS[name]
    check_plane(plane)
    return plane


def check_plane(plane: xr.Dataset, path: Path | None = None) -> None:
    """Raise ValueError with one sentence where `plane` is not a plane (series)."""
    fault = next(filter(None, (variable.fault(plane) for variable in SCHEMA.root)), None)
    if fault:
        raise ValueError(f"a plane is not whole: {fault}")
    for axis in ("x", "y"):
        c = plane[axis].values
        if c.ndim != 1 or c.size < 2 or not np.all(np.diff(c) > 0):
            raise ValueError(
                f"axis {axis!r} of a plane must be one-dimensional and ascending, got shape"
                f" {c.shape}"
            )
        if np.ptp(np.diff(c)) > 1e-6 * (c[-1] - c[0]):
            raise ValueError(f"axis {axis!r} of a plane must be regularly spaced")
    check_vectors(plane)


class Planes:
    """The planes of a series by number, read in blocks: one costs little less than many."""

    def __init__(self, series: xr.Dataset) -> None:
        self.series = series
        self.step = max(1, BLOCK // max(1, series.sizes["y"] * series.sizes["x"]))
        self._first, self._block = -1, series

    def __getitem__(self, i: int) -> xr.Dataset:
        first = i - i % self.step
        if first != self._first:
            self._block = self.series.isel(time=slice(first, first + self.step)).load()
            self._first = first
        return self._block.isel(time=i - first)


def vectors_of(plane: xr.Dataset) -> xr.Dataset:
    """A plane (series) with `VECTORS` alone."""
    return plane[[name for name in VECTORS if name in plane]]


def fields_of(plane: xr.Dataset) -> list[str]:
    """Names of the fields: variables over (y, x), or (time, y, x)."""
    return [str(n) for n, v in plane.data_vars.items() if v.dims[-2:] == ("y", "x")]


def units_of(plane: xr.Dataset) -> tuple[str, str]:
    """(unit of length, unit of velocity) that a plane states."""
    return str(plane["x"].attrs.get("units", "m")), str(plane["u"].attrs.get("units", "m/s"))


def circulation_unit(length: str) -> str:
    """Unit of a circulation in a plane whose unit of `length` is this."""
    return "px²/frame" if length == "px" else f"{length}²/s"


def usable(plane: xr.Dataset) -> xr.DataArray:
    """Tell which vectors are usable (glossary): valid ones, and uncertain ones that are known.

    Parameters
    ----------
    plane
        A plane or series.

    Returns
    -------
    xarray.DataArray
        bool, with the axes of `valid`.

    Examples
    --------
    >>> field = piv.correlate("docs/tutorials/frames", window=24)
    >>> float(piv.usable(field).mean()) > 0.9
    True
    """
    f = plane.variables
    ok = plane["valid"] != 0
    if {"flag", "u_std", "v_std"} <= set(f):
        known = np.isfinite(f["u"] + f["v"] + f["u_std"] + f["v_std"])
        ok = ok | ((f["flag"] == UNCERTAIN) & known)
    return ok


def absent(plane: xr.Dataset) -> ndarray:
    """Whether a plane, or each instant of a series, has no field: bool, () or (time,)."""
    if "flag" not in plane:
        return np.zeros(plane["u"].shape[:-2], bool)
    return plane["flag"][..., 0, 0].values >= NO_PICTURE


def absent_field(shape: tuple[int, int], reason: int) -> dict[str, ndarray]:
    """Variables (y, x) of an instant without a field, all of whose vectors are absent."""
    return {
        "u": np.full(shape, np.nan),
        "v": np.full(shape, np.nan),
        "valid": np.zeros(shape, np.uint8),
        "flag": np.full(shape, reason, np.uint8),
    }


def check_vectors(plane: xr.Dataset) -> None:
    """ValueError where a vector marked valid is no number; a series on disk is read in blocks."""
    u, v, valid = (plane[name].variable for name in ("u", "v", "valid"))
    if not (u.dims == v.dims == valid.dims and u.dims in (("y", "x"), ("time", "y", "x"))):
        dims = ", ".join(f"{n} over {a.dims}" for n, a in (("u", u), ("v", v), ("valid", valid)))
        raise ValueError(f"u, v and valid of a plane are over (y, x) or (time, y, x), not {dims}")
    series = u.ndim == 3
    step = max(1, BLOCK // max(1, u.shape[-1] * u.shape[-2]))
    for k in range(0, u.shape[0], step) if series else (0,):
        # a single instant as it is: its values stay for the caller
        a, b, good = (f[k : k + step].values if series else f.values for f in (u, v, valid))
        wrong = ~(np.isfinite(a) & np.isfinite(b)) & (good != 0)
        if wrong.any():
            instant = k + int(np.argmax(wrong.any(axis=(1, 2)))) if series else 0
            when = f" at {plane['time'].values.flat[instant]:g} s" if "time" in plane.coords else ""
            raise ValueError(f"a plane has vectors marked valid{when} whose u or v is not finite")


def write_plane(plane: xr.Dataset, path: str | Path, **attrs: Any) -> None:
    """Write a plane or series to HDF5, which is netCDF-4, whole or not at all.

    Parameters
    ----------
    plane
        A plane or series.
    path
        The file, .h5.
    attrs
        Further root attributes.

    Raises
    ------
    ValueError
        Where the plane is not whole.

    Examples
    --------
    >>> plane = piv.make_plane(np.arange(4.0), np.arange(3.0), np.ones((3, 4)), np.zeros((3, 4)))
    >>> piv.write_plane(plane, "plane.h5")
    """
    check_plane(plane)
    out = plane.assign_attrs(plane.attrs | SCHEMA.label | attrs)
    deflate = {
        str(n): {"zlib": True, "complevel": 1} for n, d in out.data_vars.items() if d.ndim >= 2
    }
    whole_netcdf(out, path, encoding=deflate)


def read_plane(path: str | Path) -> xr.Dataset:
    """Open a plane series of this project lazily; a context manager.

    Parameters
    ----------
    path
        The file, .h5.

    Returns
    -------
    xarray.Dataset
        Variables are read when their values are used.

    Raises
    ------
    ValueError, FileNotFoundError
        Where it is damaged, of another format, or not there.

    Examples
    --------
    >>> field = piv.correlate("docs/tutorials/frames", window=24, output="vectors.h5")
    >>> with piv.read_plane("vectors.h5") as series:
    ...     series["u"].dims
    ('time', 'y', 'x')
    """
    return checked(open_netcdf(path, "HDF5 plane series"), path, SCHEMA.check)


def read_checked_plane(path: str | Path) -> xr.Dataset:
    """`read_plane` of a file of any program, with its grid and every vector checked.

    It reads the file once more: whoever goes through a long series anyway uses `read_plane` and
    `check_vectors` on each instant.
    """
    return checked(read_plane(path), path)


def checked(
    plane: xr.Dataset, path: str | Path, check: Callable[[xr.Dataset, Path], None] = check_plane
) -> xr.Dataset:
    """The plane after `check`, which closes it where it fails; the error names the file."""
    try:
        check(plane, Path(path))
    except StageError:
        plane.close()
        raise
    except Exception as error:  # of damaged data h5py raises more than one kind
        plane.close()
        raise ValueError(f"{path}: {one_line(error, 300)}") from error
    return plane
