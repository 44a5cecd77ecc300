"""From other programs' vectors to plane series, and from plane series to what others open."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy import ndarray

from piv.files.json_text import natural_key
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
from piv.foreign.write import units_of
from piv.formats.plane_series import checked, make_plane, read_plane
from piv.images.calibration import Calibration, calibrate_plane

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}
_VELOCITIES = [f"{unit}/{per}" for per in ("s", "frame") for unit in (*LENGTHS, "px")]


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

    Displacements in px stay px unless `scale_mm_per_px` or `interval_s` is stated, then both are
    needed; lengths per frame need `interval_s`; px with y down need `image_rows`, the height of the
    image, because 0 is to be its bottom row. ValueError names the missing option, and refuses an
    option that contradicts the file.
    """
    length = _agreed(name, "--length-unit", vectors.length_unit, length_unit, [*LENGTHS, "px"])
    stated = "px/frame" if vectors.velocity_unit == "px" else vectors.velocity_unit
    velocity = _agreed(name, "--velocity-unit", stated, velocity_unit, _VELOCITIES)
    direction = _agreed(name, "--y-axis", vectors.y_axis, y_axis, ["up", "down"])

    pixels = (
        (length, velocity) == ("px", "px/frame") and scale_mm_per_px is None and interval_s is None
    )

    def factor(unit: str) -> float:
        if pixels:
            return 1.0
        if unit != "px":
            return LENGTHS[unit]
        if scale_mm_per_px is None or not scale_mm_per_px > 0:
            raise ValueError(f"{name}: the file is in px; give a positive --scale-mm-per-px")
        return scale_mm_per_px * 1e-3

    unit, per = velocity.split("/")
    speed = factor(unit)
    if per == "frame" and not pixels:
        if interval_s is None or not interval_s > 0:
            raise ValueError(
                f"{name}: displacements per frame; give the time between exposures, --interval"
            )
        speed /= interval_s
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
    return in_px(plane, "frame") if pixels else plane


def in_px(plane: xr.Dataset, time: str) -> xr.Dataset:
    """The plane with px as the unit of axes and vectors, and the unit `time` of its instants."""
    units = {"time": time} | dict.fromkeys(("x", "y", "u", "v", "u_std", "v_std"), "px")
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
    rate: float | None = None,
    keep_replaced: bool = False,
    zero_is_absent: bool = False,
    **units: Any,
) -> xr.Dataset:
    """Vectors of one file (a plane) or of several, one instant each (a series), as a plane in SI.

    `kind` overrides the guess from the name; `units` go to `to_plane`. A series needs its `rate`
    (Hz) where its files hold no times. `zero_is_absent`: vectors of exactly (0, 0), which some
    programs write where they have none, become masked. Files of this project stay as they are but
    for vectors in px, which scale and interval take to SI.
    """
    files = [Path(p) for p in paths]
    if not files:
        raise ValueError("name at least one file of vectors")
    if kind in (None, "plane") and (plane := read_own(files[0])) is not None:
        if len(files) > 1:
            raise ValueError(f"{files[1]}: a second file of a series; give {files[0].name} alone")
        if keep_replaced or zero_is_absent:
            raise ValueError(
                f"{files[0]}: --keep-replaced and --zero-is-absent are of other programs' files"
            )
        return _in_units(checked(plane, files[0]), str(files[0]), rate, **units)
    kinds = {kind or guess_format(p) for p in files}
    if len(kinds) > 1:
        raise ValueError(f"vector files of several kinds: {', '.join(sorted(kinds))}")
    kind = kinds.pop()
    if kind == "pivpy" and len(files) > 1:
        raise ValueError(f"{files[1]}: a second file of a series; give one, which holds it whole")
    if kind not in READERS:
        raise ValueError(f"unknown format {kind!r}; known are {', '.join(READERS)}")
    files.sort(key=natural_key)
    planes, names, times = [], [], []
    for path in files:
        for vectors in _instants(path, kind, keep_replaced):
            if zero_is_absent:
                vectors.flag[(vectors.u == 0) & (vectors.v == 0)] = 2
            planes.append(to_plane(vectors, str(path), **units))
            names.append(path)
            times.append(vectors.time)
    attrs: dict[str, Any] = {
        "source": "lab", "imported_from": json.dumps([p.name for p in files])
    }  # fmt: skip
    if units.get("interval_s") is not None:
        attrs["interval"] = float(units["interval_s"])
    if len(planes) == 1:
        return planes[0].assign_attrs(attrs)
    first = planes[0]
    for path, plane in zip(names, planes, strict=True):
        for axis in ("x", "y"):
            if plane[axis].shape != first[axis].shape or not np.allclose(plane[axis], first[axis]):
                raise ValueError(f"{path}: its grid differs from that of {files[0].name}")
    stack = {n: np.stack([p[n].values for p in planes]) for n in ("u", "v", "valid", "flag")}
    pixels = first["x"].attrs["units"] == "px"
    try:
        time, unit = _times(times, rate, pixels)
    except ValueError as error:
        raise ValueError(f"{files[0]}: {error}") from None
    series = make_plane(first["x"].values, first["y"].values, time=time, **stack)
    series["time"].attrs["units"] = unit
    series = series.assign_attrs(attrs)
    return in_px(series, unit) if pixels else series


def _times(times: list[float | None], rate: float | None, pixels: bool) -> tuple[ndarray, str]:
    """Times of instants and their unit: the files' own, else of `rate` (Hz), else frames.

    ValueError where `rate` contradicts the files, and where vectors in m/s have no times.
    """
    stated = np.array([np.nan if t is None else t for t in times])
    if np.isfinite(stated).all() and (np.diff(stated) > 0).all():
        if rate is not None and not np.allclose(np.diff(stated) * rate, 1, atol=1e-3):
            own = 1 / float(np.diff(stated).mean())
            raise ValueError(f"--rate {rate:g} contradicts its own times, {own:.6g} Hz in the mean")
        return stated, "s"
    if rate is not None:
        return np.arange(len(times)) / rate, "s"
    if not pixels:
        raise ValueError(f"{len(times)} instants are a series in time; give --rate")
    return np.arange(len(times), dtype=float), "frame"


def _in_units(plane: xr.Dataset, name: str, rate: float | None, **units: Any) -> xr.Dataset:
    """A file of this project in what the caller states; ValueError for what contradicts it."""
    length, velocity = units_of(plane)
    stated = {"length_unit": length, "velocity_unit": velocity, "y_axis": "up"}
    if velocity == "px":
        stated["velocity_unit"] = "px/frame"
    for key, value in stated.items():
        _agreed(name, f"--{key.replace('_', '-')}", value, units.get(key), [value])
    scale, interval = units.get("scale_mm_per_px"), units.get("interval_s")
    if units.get("image_rows") is not None:
        raise ValueError(f"{name}: --image-rows is of files that count px downwards")
    if scale is None and interval is None and rate is None:
        return plane
    if length != "px":
        raise ValueError(
            f"{name}: is in {length} and {velocity}; a scale or a clock would contradict it"
        )
    if scale is None:
        raise ValueError(f"{name}: is in px; give --scale-mm-per-px too")
    try:
        return calibrate_plane(plane, Calibration(scale), interval, rate)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def open_vectors(path: str | Path) -> xr.Dataset:
    """Vectors of one file that this project writes; .h5 and .nc lazily (see `check_vectors`).

    ValueError, or FileNotFoundError, in one sentence.
    """
    path = Path(path)
    if not path.is_file():
        kind = "is a folder; give a file" if path.is_dir() else "no such file"
        raise FileNotFoundError(f"{path}: {kind}")
    if (plane := read_own(path)) is not None:
        return plane
    if path.suffix.lower() not in (".txt", ".dat", ".vc7"):
        raise ValueError(
            f"{path}: no file of vectors; piv convert makes one of other programs' files, piv "
            "correlate of images"
        )
    return read_vectors([path])


def read_own(path: Path) -> xr.Dataset | None:
    """A file that this project wrote, those of HDF5 lazily; None for other programs' files."""
    suffix = path.suffix.lower()
    if suffix == ".h5":
        return read_plane(path)
    if suffix == ".nc":
        return own_netcdf(path) if netcdf_layout(path) == "plane" else None
    return None


def _instants(path: Path, kind: str, keep_replaced: bool) -> Iterable[Vectors]:
    if kind == "pivlab":
        return read_pivlab(path, keep_replaced=keep_replaced)
    if kind == "pivpy":
        return [Vectors(*instant) for instant in read_pivpy(path)]
    if kind == "tecplot":
        return read_tecplot(path)
    return [{"openpiv": read_openpiv, "davis": read_davis}[kind](path)]
