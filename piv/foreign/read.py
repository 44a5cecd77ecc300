"""From other programs' vectors to plane series, and from plane series to what others open."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from fileio.errors import one_line
from fileio.formats.plane_series import checked, make_plane, read_checked_plane, read_plane
from fileio.json_text import natural_key
from piv.foreign.pivpy import netcdf_layout, own_netcdf, read_pivpy
from piv.foreign.vector_files import (
    READERS,
    Vectors,
    guess_format,
    read_davis,
    read_openpiv,
    read_pivlab,
    read_tecplot,
)

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}
VELOCITIES = {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "um/s": 1e-6, "µm/s": 1e-6}


def to_plane(
    vectors: Vectors,
    name: str,
    *,
    length_unit: str | None = None,
    velocity_unit: str | None = None,
    y_axis: str | None = None,
    scale_mm_per_px: float | None = None,
    interval_s: float | None = None,
    image_rows: int | None = None,
) -> xr.Dataset:
    """A plane in m and m/s, y up, from vectors in the file's units and the stated options.

    Displacements in px stay px unless `scale_mm_per_px` or `interval_s` is given, then both are
    needed; lengths per frame need `interval_s`; px with y down need `image_rows`, the height of the
    image, because 0 is to be its bottom row. ValueError names the missing option, and refuses an
    option that contradicts the file.
    """
    length = _agreed(name, "--length-unit", vectors.length_unit, length_unit, [*LENGTHS, "px"])
    speeds = [*VELOCITIES, "px/frame", *(f"{u}/frame" for u in LENGTHS)]
    stated = "px/frame" if vectors.velocity_unit == "px" else vectors.velocity_unit
    velocity = _agreed(name, "--velocity-unit", stated, velocity_unit, [*speeds, "px/s"])
    direction = _agreed(name, "--y-axis", vectors.y_axis, y_axis, ["up", "down"])

    in_px = (
        (length, velocity) == ("px", "px/frame") and scale_mm_per_px is None and interval_s is None
    )

    def factor(unit: str) -> float:
        if in_px:
            return 1.0
        if unit != "px":
            return LENGTHS[unit]
        if scale_mm_per_px is None or not scale_mm_per_px > 0:
            raise ValueError(
                f"{name}: the file is in px; give a positive --scale-mm-per-px or --calibration"
            )
        return scale_mm_per_px * 1e-3

    if velocity in VELOCITIES:
        speed = VELOCITIES[velocity]
    else:
        unit, per = velocity.split("/")
        if per == "frame" and not in_px and (interval_s is None or not interval_s > 0):
            raise ValueError(
                f"{name}: displacements per frame; give the time between exposures, --interval"
            )
        speed = factor(unit) / (interval_s if per == "frame" and interval_s else 1.0)
    x, y, u, v, flag = (
        vectors.x * factor(length),
        vectors.y,
        vectors.u * speed,
        vectors.v * speed,
        vectors.flag,
    )
    if direction == "down":
        if length == "px":
            if image_rows is None:
                raise ValueError(
                    f"{name}: y is in px from the top; give the image's height, --image-rows"
                )
            y = (image_rows - 1) - y
        else:
            y = -y
        y, u, v, flag = y[::-1], u[::-1], -v[::-1], flag[::-1]
    y = y * factor(length)
    valid = (flag == 0) | (flag == 4)
    valid &= np.isfinite(u) & np.isfinite(v)
    u, v = np.where(valid, u, np.nan), np.where(valid, v, np.nan)
    plane = make_plane(x, y, u, v, valid=valid, flag=np.ascontiguousarray(flag, np.uint8))
    return with_units(plane, "px", "px", "frame") if in_px else plane


def with_units(plane: xr.Dataset, length: str, velocity: str, time: str) -> xr.Dataset:
    """The plane with the units that its numbers are in."""
    units = (
        {"time": time}
        | dict.fromkeys("xy", length)
        | dict.fromkeys(("u", "v", "u_std", "v_std"), velocity)
    )
    for name in units.keys() & plane.variables.keys():
        plane[name].attrs["units"] = units[str(name)]
    return plane


def _agreed(
    name: str, option: str, stated: str | None, option_value: str | None, known: Sequence[str]
) -> str:
    if stated and option_value and stated != option_value:
        raise ValueError(
            f"{name}: {option} {option_value} contradicts the file, which states {stated}"
        )
    value = stated or option_value
    if not value:
        raise ValueError(f"{name}: the file does not state it; give {option} ({', '.join(known)})")
    if value not in known:
        raise ValueError(
            f"{name}: unknown {option.lstrip('-')} {value!r}; known are {', '.join(known)}"
        )
    return value


def read_vectors(
    paths: Sequence[str | Path],
    *,
    kind: str | None = None,
    frame_rate_hz: float | None = None,
    keep_replaced: bool = False,
    zero_is_absent: bool = False,
    **units: object,
) -> xr.Dataset:
    """Vectors of one file (a plane) or of several, one instant each (a series), as a plane in SI.

    `kind` overrides the guess from the name; `units` go to `to_plane`. A series needs
    `frame_rate_hz`. `zero_is_absent`: vectors of exactly (0, 0), which some programs write where
    they have none, become masked.
    """
    files = [Path(p) for p in paths]
    if not files:
        raise ValueError("no vector file given")
    kinds = {kind or guess_format(p) for p in files}
    if len(kinds) > 1:
        raise ValueError(f"vector files of several kinds: {', '.join(sorted(kinds))}")
    kind = kinds.pop()
    if kind in ("plane", "csv", "pivpy") and len(files) > 1:
        raise ValueError(f"{files[0]}: give one {kind} file; it holds all instants itself")
    if kind in ("plane", "csv"):
        return _read_nc_or_plane(files[0]) if kind == "plane" else read_csv(files[0])
    if kind not in READERS:
        raise ValueError(f"unknown format {kind!r}; known are {', '.join(READERS)}")
    files.sort(key=natural_key)
    planes, names = [], []
    for path in files:
        for vectors in _instants(path, kind, keep_replaced):
            if zero_is_absent:
                vectors.flag[(vectors.u == 0) & (vectors.v == 0)] = 2
            planes.append(to_plane(vectors, str(path), **units))  # type: ignore[arg-type]
            names.append(path)
    attrs = {"source": "lab", "imported_from": json.dumps([p.name for p in files])}
    if len(planes) == 1:
        return planes[0].assign_attrs(attrs)
    first = planes[0]
    in_px = first["x"].attrs["units"] == "px"
    if in_px and frame_rate_hz is not None:
        raise ValueError(
            "displacements in px have their time in frames; leave out --frame-rate-hz, or give a "
            "scale too"
        )
    if not in_px and (frame_rate_hz is None or not frame_rate_hz > 0):
        raise ValueError(f"{len(planes)} instants are a series in time; give --frame-rate-hz")
    for path, plane in zip(names, planes, strict=True):
        for axis in ("x", "y"):
            if plane[axis].shape != first[axis].shape or not np.allclose(plane[axis], first[axis]):
                raise ValueError(f"{path}: its grid differs from that of {files[0].name}")
    stack = {n: np.stack([p[n].values for p in planes]) for n in ("u", "v", "valid", "flag")}
    time = np.arange(len(planes)) / (frame_rate_hz or 1.0)
    series = make_plane(first["x"].values, first["y"].values, time=time, **stack).assign_attrs(
        attrs
    )
    return with_units(series, "px", "px", "frame") if in_px else series


def open_vectors(path: str | Path) -> xr.Dataset:
    """Vectors of one file that this project writes; .h5 and .nc lazily (see `check_vectors`).

    ValueError, or FileNotFoundError, in one sentence.
    """
    path = Path(path)
    if path.suffix.lower() == ".h5":
        return read_plane(path)
    if path.suffix.lower() == ".nc" and netcdf_layout(path) == "plane":
        return own_netcdf(path)
    if path.suffix.lower() not in (".csv", ".txt", ".dat", ".vc7"):
        raise ValueError(
            f"{path}: no file of vectors; piv convert makes one of other programs' files, piv "
            "correlate of images"
        )
    return read_vectors([path])


def _instants(path: Path, kind: str, keep_replaced: bool) -> Iterable[Vectors]:
    if kind == "pivlab":
        return read_pivlab(path, keep_replaced=keep_replaced)
    if kind == "pivpy":
        return [Vectors(*instant) for instant in read_pivpy(path)]
    return [{"openpiv": read_openpiv, "tecplot": read_tecplot, "davis": read_davis}[kind](path)]


def _read_nc_or_plane(path: Path) -> xr.Dataset:
    return (
        checked(own_netcdf(path), path)
        if path.suffix.lower() == ".nc"
        else read_checked_plane(path)
    )


def read_csv(path: Path) -> xr.Dataset:
    """A plane (series) from `write_csv`."""
    try:
        with path.open() as file:
            first = file.readline()
        head = json.loads(first.lstrip("# "))
        table = pd.read_csv(path, comment="#")
        x, y, time = (np.unique(table[n]) for n in ("x", "y", "time"))
        table = table.sort_values(["time", "y", "x"])
        shape = (time.size, y.size, x.size)
        names = [n for n in table.columns if n not in ("time", "x", "y")]
        fields = {n: table[n].to_numpy(float).reshape(shape) for n in names}
        if missing := [n for n in ("u", "v", "valid") if n not in names]:
            raise ValueError(f"column {missing[0]!r} is missing")
        for n in ("valid", "flag"):
            if n in names and not np.isin(fields[n], range(256)).all():
                raise ValueError(f"column {n!r} holds other than whole numbers from 0 to 255")
        units = head["length_unit"], head["velocity_unit"], head.get("time_unit", "s")
    except FileNotFoundError:
        raise
    except Exception as error:
        raise ValueError(
            f"{path}: not a CSV of vectors as this program writes ({one_line(error)})"
        ) from error
    for n in ("valid", "flag"):
        if n in fields:
            fields[n] = fields[n].astype(np.uint8)
    if not head.get("series", True):
        fields = {n: a[0] for n, a in fields.items()}
    plane = make_plane(x, y, time=time if head.get("series", True) else None, **fields)
    return with_units(plane, *units)
