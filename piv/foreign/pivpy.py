"""netCDF files in pivpy's layout: dimensions y, x, t; `chc` 1 = measured."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import xarray as xr

from piv.files.errors import one_line
from piv.files.hdf5 import open_netcdf, whole_netcdf
from piv.formats.plane_series import SCHEMA, read_plane

# which pivpy writes for whatever it has read, metres among them: it states nothing
_DEFAULT_UNIT = "pix"


def _open(path: Path) -> xr.Dataset:
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    with path.open("rb") as file:
        # netCDF-3, which pivpy writes where netCDF4 is not installed
        classic = file.read(3) == b"CDF"
    if not classic:
        return open_netcdf(path, "netCDF file", decode_times=False)
    try:
        return xr.open_dataset(path, engine="scipy", decode_times=False)
    except Exception as error:  # of damaged files scipy raises many kinds
        raise ValueError(f"{path}: not a readable netCDF file ({one_line(error)})") from error


def netcdf_layout(path: Path) -> str:
    """ "plane" for a file of this project, "pivpy" for another; ValueError for neither layout."""
    with _open(path) as data:
        if data.attrs.get("format") == SCHEMA.format:
            return "plane"
        if {"u", "v", "x", "y"} <= set(data.variables) and {"x", "y"} <= set(data["u"].dims) <= {
            "x",
            "y",
            "t",
        }:
            return "pivpy"
        names = ", ".join(map(str, data.variables))
    raise ValueError(f"{path}: no vectors as pivpy stores them (u, v over y, x, t), but {names}")


def own_netcdf(path: Path) -> xr.Dataset:
    """Our own file as a plane series, lazily."""
    data = _open(path)
    if "t" not in data.dims:
        data.close()
        return read_plane(path)
    back = data.rename(t="time", chc="valid").transpose("time", "y", "x", ...)
    if not back.attrs.pop("series", 1):
        back = back.isel(time=0, drop=True)
    back.attrs.pop("delta_t", None)
    back.set_close(data.close)
    return back


def write_pivpy(plane: xr.Dataset, path: Path) -> None:
    """netCDF-4 in the layout of pivpy: dimensions y, x, t; `chc` 1 = measured; every variable."""
    single = "time" not in plane.dims
    series = plane.expand_dims(time=[0.0]) if single else plane
    out = series.rename(time="t", valid="chc").transpose("y", "x", "t", ...)
    interval = float(np.diff(out["t"].values[:2])[0]) if out.sizes["t"] > 1 else 0.0
    out["t"].attrs.setdefault("units", "frame" if plane["x"].attrs.get("units") == "px" else "s")
    out.attrs = (
        plane.attrs | SCHEMA.label | {"delta_t": interval} | ({"series": 0} if single else {})
    )
    whole_netcdf(out, path)


def read_pivpy(path: Path) -> Iterator[tuple]:
    """Every instant of a pivpy file: x, y, u, v, flag and both units, rows by ascending y."""
    with _open(path) as data:
        try:
            data = data.sortby(["y", "x"])
            units = [_unit(data[n]) for n in ("x", "u")]
            instants = [
                _instant(data.isel(t=k) if "t" in data.dims else data)
                for k in range(data.sizes.get("t", 1))
            ]
        except Exception as error:  # of damaged data the libraries raise more than one kind
            raise ValueError(
                f"{path}: damaged, or not in pivpy's layout ({one_line(error)})"
            ) from error
    yield from ((*instant, *units) for instant in instants)


def _instant(data: xr.Dataset) -> tuple[np.ndarray, ...]:
    plane = data.transpose("y", "x", ...).load()
    x, y, u, v = (plane[n].values.astype(float) for n in ("x", "y", "u", "v"))
    measured = np.isfinite(u) & np.isfinite(v)
    if "chc" in plane:
        measured &= plane["chc"].values > 0
    return x, y, u, v, np.where(measured, 0, 1).astype(np.uint8)


def _unit(variable: xr.DataArray) -> str | None:
    unit = str(variable.attrs.get("units", "")).strip()
    return None if unit == _DEFAULT_UNIT else unit or None
