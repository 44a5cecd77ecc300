"""From other programs' vectors to plane series."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy import ndarray

from piv.files.json_text import natural_key
from piv.foreign.davis import read_davis
from piv.foreign.pivlab import read_pivlab
from piv.foreign.text_files import read_text
from piv.foreign.vectors import Vectors
from piv.formats.plane_series import checked, make_plane, read_plane, units_of
from piv.images.calibration import Calibration, calibrate_plane

_PLANES = (".h5", ".nc")  # files of this project
_READ = {
    **dict.fromkeys((".txt", ".csv", ".dat", ".tec", ".plt", ".vec"), read_text),
    **dict.fromkeys((".vc7", ".vec7"), read_davis), ".mat": read_pivlab,
}  # fmt: skip
LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}
# what a file states or the caller: the known words, None for numbers
_OPTIONS: dict[str, list[str] | None] = {
    "length_unit": [*LENGTHS, "px"],
    "velocity_unit": [f"{unit}/{per}" for per in ("s", "frame") for unit in (*LENGTHS, "px")],
    "y_axis": ["up", "down"], "scale_mm_per_px": None, "interval": None, "image_rows": None,
}  # fmt: skip
_ROWS = "omit `image_rows`, which is of files that count px downwards"
_SINGLE = "holds a single instant; omit `rate`, which is of a series"


def to_plane(vectors: Vectors, name: str, **units: Any) -> xr.Dataset:
    """A plane in m and m/s, y up, from vectors in the file's units and the stated options.

    Displacements in px stay px unless scale and interval are known, or one of them is stated: then
    both are needed. Lengths per frame need the interval; px with y down need `image_rows`, the
    height of the image, because 0 is to be its bottom row. ValueError names the missing option, and
    refuses an option that contradicts the file or that is not used.
    """
    own = {option: getattr(vectors, option) for option in _OPTIONS}
    if own["velocity_unit"] == "px":
        own["velocity_unit"] = "px/frame"
    length, velocity, direction, scale, interval, rows = _agreed(name, own, units).values()
    unit, per = velocity.split("/")
    of_caller = [units.get(option) is not None for option in ("scale_mm_per_px", "interval")]
    pixels = (length, velocity) == ("px", "px/frame") and not (
        any(of_caller) or (scale and interval)
    )
    if of_caller[0] and "px" not in (length, unit):
        raise ValueError(
            f"{name}: is in {length} and {velocity}; omit `scale_mm_per_px`, which is of px"
        )
    if units.get("image_rows") is not None and (length, direction) != ("px", "down"):
        raise ValueError(f"{name}: {_ROWS}")
    if "px" in (length, unit) and scale is None and not pixels:
        raise ValueError(f"{name}: the file is in px; give `scale_mm_per_px`")
    if per == "frame" and interval is None and not pixels:
        raise ValueError(
            f"{name}: displacements per frame; give the time between exposures, `interval`"
        )
    sizes = LENGTHS | {"px": 1.0 if pixels else 1e-3 * (scale or 0.0)}
    speed = sizes[unit] / (interval if per == "frame" and not pixels else 1.0)
    y, u, v, flag = vectors.y, vectors.u * speed, vectors.v * speed, vectors.flag
    if direction == "down":
        if length == "px" and rows is None:
            raise ValueError(
                f"{name}: y is in px from the top; give the image's height, `image_rows`"
            )
        y = (rows - 1 if length == "px" else 0) - y
        y, u, v, flag = y[::-1], u[::-1], -v[::-1], flag[::-1]
    valid = (flag == 0) & np.isfinite(u) & np.isfinite(v)
    u, v = np.where(valid, u, np.nan), np.where(valid, v, np.nan)
    axes = vectors.x * sizes[length], y * sizes[length]
    plane = make_plane(*axes, u, v, valid=valid, flag=np.ascontiguousarray(flag, np.uint8))
    if interval is not None:
        plane.attrs["interval"] = float(interval)
    return in_px(plane, "frame") if pixels else plane


def in_px(plane: xr.Dataset, time: str) -> xr.Dataset:
    """The plane with px as the unit of axes and vectors, and the unit `time` of its instants."""
    units = {"time": time} | dict.fromkeys(("x", "y", "u", "v", "u_std", "v_std"), "px")
    for name in units.keys() & plane.variables.keys():
        plane[name].attrs["units"] = units[str(name)]
    return plane


def _agreed(name: str, own: Mapping[str, Any], units: Mapping[str, Any]) -> dict[str, Any]:
    """Of each option what the file states, its `own`, or the caller; None for an absent number.

    ValueError where the two differ, for an unknown word or a number that is not positive, and with
    the names of all words that are missing; TypeError for an unknown option.
    """
    if unknown := sorted(set(units) - set(_OPTIONS)):
        raise TypeError(f"no option {unknown[0]!r}; known are {', '.join(_OPTIONS)}")
    found, missing = {}, []
    for option, known in _OPTIONS.items():
        stated, value = own.get(option), units.get(option)
        if value is not None and known is None and not value > 0:
            raise ValueError(f"{name}: `{option}` must be positive, got {value:g}")
        if stated and value and (stated != value if known else abs(value / stated - 1) > 1e-3):
            texts = (stated, value) if known else (f"{stated:g}", f"{value:g}")
            raise ValueError(
                f"{name}: `{option}` {texts[1]} contradicts the file, which states {texts[0]}"
            )
        found[option] = stated or value
        if known and not found[option]:
            missing.append(f"`{option}` ({', '.join(known)})")
        elif known and found[option] not in known:
            raise ValueError(
                f"{name}: unknown `{option}` {found[option]!r}; known are {', '.join(known)}"
            )
    if missing:
        raise ValueError(f"{name}: the file does not state all; give {' and '.join(missing)}")
    return found


def read_vectors(
    paths: str | Path | Sequence[str | Path],
    *,
    rate: float | None = None,
    zero_is_absent: bool = False,
    assumed: Mapping[str, Any] | None = None,
    **units: Any,
) -> xr.Dataset:
    """Read vectors of any program: one file as a plane, several as a series, in SI or px.

    Parameters
    ----------
    paths
        One name, or those of a series, one instant each. Files of this project stay as they are but
        for vectors in px, which scale and interval take to SI.
    rate
        Instants per second, where the files hold no times.
    zero_is_absent
        Whether vectors of exactly (0, 0) are masked.
    assumed
        `rate` and numbers of `units` that are taken where the files need them and state none.
    units
        length_unit, velocity_unit, y_axis ("up" or "down"), scale_mm_per_px, interval (s between
        the exposures), image_rows (of px that count downwards), where the files do not state them.

    Returns
    -------
    xarray.Dataset
        A plane or series, y up.

    Raises
    ------
    ValueError, FileNotFoundError
        With the names of the options that are missing, not used, or that contradict the file.

    Examples
    --------
    >>> rows = "".join(f"{x} {y} 1.5 0.5\\n" for y in (8, 16) for x in (8, 16, 24))
    >>> _ = open("openpiv.txt", "w").write(rows)
    >>> plane = piv.read_vectors("openpiv.txt", length_unit="px", velocity_unit="px/frame",
    ...                          y_axis="down", image_rows=32)
    >>> plane["y"].values, float(plane["v"][0, 0])
    (array([15., 23.]), -0.5)
    """
    files = [Path(p) for p in ([paths] if isinstance(paths, str | Path) else paths)]
    if not files:
        raise ValueError("name at least one file of vectors")
    for path in files:
        if path.suffix.lower() not in (*_PLANES, *_READ):
            named = " ".join((*_PLANES, *_READ))
            raise ValueError(f"{path}: unknown kind of vector file; known are {named}")
        if path.suffix.lower() in _PLANES and len(files) > 1:
            raise ValueError(f"{path}: one of several, but it may be a series; give it alone")
        if not path.is_file():
            raise FileNotFoundError(f"{path}: no such file")
    if files[0].suffix.lower() in _PLANES:
        if zero_is_absent:
            raise ValueError(f"{files[0]}: `zero_is_absent` is of other programs' files")
        plane = checked(read_plane(files[0]), files[0])
        return _in_units(plane, str(files[0]), rate, assumed or {}, **units)
    files.sort(key=natural_key)
    planes, names, times = [], [], []
    known = {n: v for n, v in (assumed or {}).items() if n != "rate" and units.get(n) is None}
    for path in files:
        for vectors in _READ[path.suffix.lower()](path):
            if zero_is_absent:
                vectors.flag[(vectors.u == 0) & (vectors.v == 0)] = 2
            lacks = {n: v for n, v in known.items() if getattr(vectors, n) is None}
            planes.append(to_plane(replace(vectors, **lacks), str(path), **units))
            names.append(path)
            times.append(vectors.time)
    first = planes[0]
    attrs = first.attrs | {"source": "lab", "imported_from": json.dumps([p.name for p in files])}
    if len(planes) == 1:
        if rate is not None:
            raise ValueError(f"{files[0]}: {_SINGLE}")
        return first.assign_attrs(attrs)
    for path, plane in zip(names, planes, strict=True):
        for axis in ("x", "y"):
            if plane[axis].shape != first[axis].shape or not np.allclose(plane[axis], first[axis]):
                raise ValueError(f"{path}: its grid differs from that of {files[0].name}")
    stack = {n: np.stack([p[n].values for p in planes]) for n in ("u", "v", "valid", "flag")}
    pixels = first["x"].attrs["units"] == "px"
    try:
        time, unit = _times(times, rate, pixels, (assumed or {}).get("rate"))
    except ValueError as error:
        raise ValueError(f"{files[0]}: {error}") from None
    series = make_plane(first["x"].values, first["y"].values, time=time, **stack)
    series["time"].attrs["units"] = unit
    series = series.assign_attrs(attrs)
    return in_px(series, unit) if pixels else series


def _times(
    times: list[float | None], rate: float | None, pixels: bool, assumed: float | None
) -> tuple[ndarray, str]:
    """Times of instants and their unit: the files' own, else of a rate (Hz), else frames.

    ValueError where `rate` contradicts the files, and where vectors in m/s have no times.
    """
    stated = np.array([np.nan if t is None else t for t in times])
    if np.isfinite(stated).all() and (np.diff(stated) > 0).all():
        if rate is not None and not np.allclose(np.diff(stated) * rate, 1, atol=1e-3):
            own = 1 / float(np.diff(stated).mean())
            raise ValueError(f"`rate` {rate:g} contradicts its own times, {own:.6g} Hz in the mean")
        return stated, "s"
    if rate := rate or assumed:
        return np.arange(len(times)) / rate, "s"
    if not pixels:
        raise ValueError(f"{len(times)} instants are a series in time; give `rate`")
    return np.arange(len(times), dtype=float), "frame"


def _in_units(
    plane: xr.Dataset, name: str, rate: float | None, assumed: Mapping[str, Any], **units: Any
) -> xr.Dataset:
    """A file of this project in what the caller states; ValueError for what contradicts it."""
    length, velocity = units_of(plane)
    stated = {"length_unit": length, "velocity_unit": velocity, "y_axis": "up"}
    if velocity == "px":
        stated["velocity_unit"] = "px/frame"
    _agreed(name, stated, units)
    scale, interval = units.get("scale_mm_per_px"), units.get("interval")
    if units.get("image_rows") is not None:
        raise ValueError(f"{name}: {_ROWS}")
    if length == "px":
        scale = scale or assumed.get("scale_mm_per_px")
        if "interval" not in plane.attrs:
            interval = interval or assumed.get("interval")
        if "time" in plane.dims and plane["time"].attrs.get("units") != "s":
            rate = rate or assumed.get("rate")
    if scale is None and interval is None and rate is None:
        return plane
    if length != "px":
        raise ValueError(
            f"{name}: is in {length} and {velocity}; a scale or a clock would contradict it"
        )
    if scale is None:
        raise ValueError(f"{name}: is in px; give `scale_mm_per_px` too")
    if rate is not None and "time" not in plane.dims:
        raise ValueError(f"{name}: {_SINGLE}")
    try:
        return calibrate_plane(plane, Calibration(scale), interval, rate)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def open_vectors(path: str | Path) -> xr.Dataset:
    """Open vectors of one file: a plane series .h5 lazily, or another that states its units.

    Parameters
    ----------
    path
        .h5, .nc, or a file that `read_vectors` takes without options.

    Returns
    -------
    xarray.Dataset
        A plane or series.

    Raises
    ------
    ValueError, FileNotFoundError
        One sentence with the file and the remedy.

    Examples
    --------
    >>> field = piv.correlate("docs/tutorials/frames", window=24, output="vectors.h5")
    >>> with piv.open_vectors("vectors.h5") as series:
    ...     series.sizes["time"]
    5
    """
    path = Path(path)
    if not path.is_file():
        kind = "is a folder; give a file" if path.is_dir() else "no such file"
        raise FileNotFoundError(f"{path}: {kind}")
    if path.suffix.lower() in _PLANES:
        return read_plane(path)
    if path.suffix.lower() not in _READ:
        raise ValueError(
            f"{path}: no file of vectors; piv convert makes one of other programs' files, piv "
            "correlate of images"
        )
    return read_vectors(path)
