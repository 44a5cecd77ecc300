"""netCDF files in pivpy's layout: dimensions y, x, t; `chc` 1 = measured."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import xarray as xr

from piv.files.errors import one_line
from piv.files.hdf5 import open_netcdf, whole_netcdf
from piv.foreign.vectors import Grid, Vectors

# which pivpy writes for whatever it has read, metres among them: it states nothing
_DEFAULT_UNIT = "pix"


def _open(path: Path) -> xr.Dataset:
    with path.open("rb") as file:
        # netCDF-3, which pivpy writes where netCDF4 is not installed
        classic = file.read(3) == b"CDF"
    if not classic:
        return open_netcdf(path, "netCDF file", decode_times=False)
    try:
        return xr.open_dataset(path, engine="scipy", decode_times=False)
    except Exception as error:  # of damaged files scipy raises many kinds
        raise ValueError(f"{path}: not a readable netCDF file ({one_line(error)})") from error


def write_pivpy(plane: xr.Dataset, path: Path) -> None:
    """netCDF-4 in the layout of pivpy: dimensions y, x, t; `chc` 1 = measured; every variable."""
    series = plane if "time" in plane.dims else plane.expand_dims(time=[0.0])
    out = series.rename(time="t", valid="chc").transpose("y", "x", "t", ...)
    out.attrs["delta_t"] = float(np.diff(out["t"].values[:2])[0]) if out.sizes["t"] > 1 else 0.0
    out["t"].attrs.setdefault("units", "frame" if plane["x"].attrs.get("units") == "px" else "s")
    whole_netcdf(out, path)


def read_pivpy(path: Path) -> Iterator[Vectors]:
    """Every instant; ValueError where the file has another layout."""
    with _open(path) as data:
        names = ", ".join(map(str, data.variables))
        if not {"u", "v", "x", "y"} <= set(data.variables) or not (
            {"x", "y"} <= set(data["u"].dims) <= {"x", "y", "t"}
        ):
            raise ValueError(
                f"{path}: no vectors as pivpy stores them (u, v over y, x, t), but {names}"
            )
        try:
            data = data.sortby(["y", "x"])
            units = [_unit(data[n]) for n in ("x", "u")]
            series = "t" in data.dims
            instants = [
                _instant(data.isel(t=k) if series else data) for k in range(data.sizes.get("t", 1))
            ]
            known = series and data["t"].attrs.get("units") == "s"
            times = data["t"].values.tolist() if known else [None] * len(instants)
        except Exception as error:  # of damaged data the libraries raise more than one kind
            raise ValueError(
                f"{path}: damaged, or not in pivpy's layout ({one_line(error)})"
            ) from error
    for instant, time in zip(instants, times, strict=True):
        yield Vectors(*instant, units[0], units[1], time=time)


def _instant(data: xr.Dataset) -> Grid:
    plane = data.transpose("y", "x", ...).load()
    x, y, u, v = (plane[n].values.astype(float) for n in ("x", "y", "u", "v"))
    measured = np.isfinite(u) & np.isfinite(v)
    if "chc" in plane:
        measured &= plane["chc"].values > 0
    return x, y, u, v, np.where(measured, 0, 1).astype(np.uint8)


def _unit(variable: xr.DataArray) -> str | None:
    unit = str(variable.attrs.get("units", "")).strip()
    return None if unit == _DEFAULT_UNIT else unit or None
