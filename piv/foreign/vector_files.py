"""Reading vectors of other programs: OpenPIV, PIVlab, MicroVec/Tecplot, DaVis.

Every reader gives a `Vectors`: a regular grid with the units and the direction of y that the file
states, None where it states none. `piv.foreign.read.to_plane` asks for what is missing.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from piv.foreign.davis import read_buffer
from piv.foreign.pivlab import instants
from piv.foreign.pivpy import netcdf_layout

READERS = ("openpiv", "pivlab", "tecplot", "davis", "pivpy", "plane")


@dataclass
class Vectors:
    """One instant as in the file: rows ordered by ascending y of the file; `valid` 1 = measured."""

    x: ndarray  # (nx,)
    y: ndarray  # (ny,)
    u: ndarray  # (ny, nx)
    v: ndarray
    flag: ndarray  # (ny, nx) uint8: 0 valid, 1 outlier, 2 masked, 4 replaced
    length_unit: str | None = None  # "m", "mm", "px", ...
    velocity_unit: str | None = None  # "m/s", "mm/s", "px/frame", ...
    y_axis: str | None = None  # "up" or "down", of positions and of v alike
    time: float | None = None  # s


def guess_format(path: Path) -> str:
    """Name of the reader for a file by its suffix and head; ValueError where it is unknown."""
    suffix = path.suffix.lower()
    if suffix == ".h5":
        return "plane"
    if suffix == ".nc":
        return netcdf_layout(path)
    if suffix == ".mat":
        return "pivlab"
    if suffix in (".vc7", ".vec7"):
        return "davis"
    if suffix in (".dat", ".tec", ".plt", ".txt", ".csv"):
        head = _head(path)
        if re.search(r"^\s*(title\s*=.*\n\s*)?variables\s*=", head, re.IGNORECASE):
            return "tecplot"
        if "PIVlab" in head or "Vector type" in head:
            return "pivlab"
        if suffix == ".txt":
            return "openpiv"
    raise ValueError(
        f"{path}: unknown kind of vector file; name it with --from ({', '.join(READERS)})"
    )


def _head(path: Path, size: int = 4096) -> str:
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    return path.read_bytes()[:size].decode("utf-8", "replace")


Grid = tuple[ndarray, ndarray, ndarray, ndarray, ndarray]  # the first five of `Vectors`


def _grid(path: Path, x: Any, y: Any, u: Any, v: Any, flag: Any) -> Grid:
    """Scattered rows to a regular grid; points not in the file are masked (flag 2)."""
    x, y, u, v = (np.asarray(a, float).ravel() for a in (x, y, u, v))
    flag = np.asarray(flag).ravel().astype(np.uint8)
    if not np.isfinite(x).all() or not np.isfinite(y).all():
        raise ValueError(f"{path}: positions are not all finite numbers")
    axes = []
    for name, c in (("x", x), ("y", y)):
        values = np.unique(c)
        gaps = np.diff(values)
        if values.size < 2:
            raise ValueError(f"{path}: the vectors lie on one {name}; a plane needs at least two")
        step = float(np.median(gaps[gaps > 0.5 * gaps.max()]))
        n = round(float(values[-1] - values[0]) / step) + 1
        axis = np.linspace(values[0], values[-1], n)
        near = np.round((values - values[0]) / (axis[1] - axis[0])).astype(int)
        if n > 20 * values.size or np.abs(values - axis[near]).max() > 0.02 * step:
            raise ValueError(f"{path}: the {name} positions are not regularly spaced")
        axes.append((axis, np.round((c - values[0]) / (axis[1] - axis[0])).astype(int)))
    (xs, i), (ys, j) = axes
    if len(set(zip(j.tolist(), i.tolist(), strict=True))) < len(u):
        raise ValueError(
            f"{path}: several vectors have the same position; give one instant per file"
        )
    shape = (ys.size, xs.size)
    out_u, out_v, out_flag = (
        np.full(shape, np.nan),
        np.full(shape, np.nan),
        np.full(shape, 2, np.uint8),
    )
    out_u[j, i], out_v[j, i], out_flag[j, i] = u, v, flag
    out_flag[(out_flag == 0) & ~(np.isfinite(out_u) & np.isfinite(out_v))] = 1
    return xs, ys, out_u, out_v, out_flag


def _table(path: Path, skip: int, delimiter: str | None) -> ndarray:
    if path.stat().st_size == 0:
        raise ValueError(f"{path}: the file is empty")
    try:
        rows = np.genfromtxt(
            path, delimiter=delimiter, skip_header=skip, comments="#", ndmin=2, encoding="utf-8"
        )
    except ValueError as error:
        raise ValueError(
            f"{path}: lines differ in their number of columns ({str(error).splitlines()[0]})"
        ) from None
    if rows.size == 0 or rows.shape[1] < 4:
        raise ValueError(f"{path}: expected at least the four columns x, y, u, v")
    return rows


def read_openpiv(path: Path) -> Vectors:
    """`x y u v flags mask` (older: `x y u v mask`) of OpenPIV's `tools.save`; without units."""
    _head(path)
    rows = _table(path, 0, "," if "," in _head(path) else None)
    flag = np.zeros(len(rows), np.uint8)
    if rows.shape[1] >= 5:
        flag[rows[:, 4] != 0] = 1
    if rows.shape[1] >= 6:
        flag[rows[:, 5] != 0] = 2
    # what this project writes above the columns; OpenPIV itself states none of it
    stated = re.search(r"^# length (\S+); velocity (\S+); y (up|down)", _head(path), re.MULTILINE)
    units = stated.groups() if stated else (None, None, None)
    return Vectors(*_grid(path, rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3], flag), *units)


def read_tecplot(path: Path) -> Iterator[Vectors]:
    """Tecplot ASCII zones, POINT packing, as of MicroVec; units from names like "X (mm)".

    Columns: x, y and u, v (also vx, vy). A column `chc`, `isvalid` or `valid` > 0 marks measured
    vectors. A zone is an instant; its SOLUTIONTIME is taken as s.
    """
    text = _head(path, 1 << 30)
    names_text = re.search(
        r"variables\s*=\s*(.*?)(?=\n\s*(?:zone|[-+\d.]))", text, re.IGNORECASE | re.DOTALL
    )
    if names_text is None:
        raise ValueError(f"{path}: no line VARIABLES = ... as Tecplot files have")
    names = [a or b for a, b in re.findall(r'"([^"]*)"|([^\s,"]+)', names_text.group(1))]
    if re.search(r"(datapacking|\bf)\s*=\s*block", text, re.IGNORECASE):
        raise ValueError(f"{path}: BLOCK packing; write the file with POINT packing")
    upward = re.search(
        r'title\s*=\s*"[^"]*, y (up|down)"', text[: names_text.start()], re.IGNORECASE
    )
    zones = re.split(r"^\s*zone\b", text[names_text.end() :], flags=re.IGNORECASE | re.MULTILINE)
    for zone in zones[1:] or zones:
        time = re.search(r"solutiontime\s*=\s*([-+.\deE]+)", zone, re.IGNORECASE)
        yield replace(
            _tecplot_zone(path, zone, names),
            y_axis=upward.group(1) if upward else None,
            time=float(time.group(1)) if time else None,
        )


def _tecplot_zone(path: Path, text: str, names: list[str]) -> Vectors:
    lines = [ln for ln in text.splitlines() if re.match(r"\s*[-+]?(\d|\.\d|nan)", ln, re.I)]
    try:
        rows = np.array([ln.replace(",", " ").split() for ln in lines], float)
    except ValueError:
        raise ValueError(
            f"{path}: lines differ in their number of columns, or hold other than numbers"
        ) from None
    if rows.ndim != 2 or rows.shape[1] != len(names):
        raise ValueError(f"{path}: {len(names)} variables but rows of shape {rows.shape}")
    short = [re.split(r"[\s(\[/]", n.strip().lower())[0] for n in names]
    wanted = {"x": ("x",), "y": ("y",), "u": ("u", "vx"), "v": ("v", "vy")}
    column = {}
    for key, options in wanted.items():
        known = [short.index(o) for o in options if o in short]
        if not known:
            raise ValueError(
                f"{path}: no column {' or '.join(options)} among {', '.join(names)}; "
                "name it so in the line VARIABLES"
            )
        column[key] = known[0]
    flag = np.zeros(len(rows), np.uint8)
    for name in ("chc", "isvalid", "valid"):
        if name in short:
            flag[rows[:, short.index(name)] <= 0] = 1
    x, y, u, v = (rows[:, column[k]] for k in "xyuv")
    grid = _grid(path, x, y, u, v, flag)
    return Vectors(*grid, _unit(names[column["x"]]), _unit(names[column["u"]]))


def _unit(name: str) -> str | None:
    match = re.search(r"[\[(]\s*([^\])]*?)\s*[\])]", name)
    return _spelled(match.group(1)) if match else None


_SPELLINGS = {
    "pxs": "px",
    "px/fr": "px/frame",
    "px/dt": "px/frame",
    "m s-1": "m/s",
    "mm s-1": "mm/s",
}


def _spelled(unit: str) -> str:
    unit = unit.strip().lower().replace("pixel", "px").replace("pix", "px")
    return _SPELLINGS.get(unit, unit)


def read_pivlab(path: Path, *, keep_replaced: bool = False) -> Iterator[Vectors]:
    """Every instant of a PIVlab export: of a .mat file, or the one of an ASCII export.

    Vector type 1 is measured, 0 masked, 2 rejected and interpolated: absent unless `keep_replaced`.
    In px the y axis points down (PIVlab's image axes); after a calibration in PIVlab the file does
    not say.
    """
    if path.suffix.lower() == ".mat":
        session = [(data, _two_units(text)) for data, text in instants(path)]
    else:
        session = [_pivlab_ascii(path)]
    for (x, y, u, v, kind), units in session:
        flag = np.select([kind == 1, kind == 0], [0, 2], 4 if keep_replaced else 1)
        length, velocity = (_spelled(unit) for unit in units) if units else (None, None)
        yield Vectors(
            *_grid(path, x, y, u, v, flag), length, velocity, "down" if length == "px" else None
        )


def _pivlab_ascii(path: Path) -> tuple[tuple[ndarray, ...], tuple[str, str] | None]:
    lines = _head(path, 1 << 16).splitlines()
    start = next(
        (k for k, ln in enumerate(lines) if re.match(r"\s*[-+]?\d|\s*nan", ln, re.I)), None
    )
    if start is None:
        raise ValueError(f"{path}: no rows of numbers")
    sample = lines[start]
    delimiter = next((d for d in (",", "\t", ";") if d in sample), None)
    rows = _table(path, start, delimiter)
    titles = lines[start - 1] if start else ""
    units = re.findall(r"[\[(]([^\])]*)[\])]", titles)
    kind = (
        rows[:, 4]
        if rows.shape[1] >= 5 and "ype" in titles
        else np.where(np.isfinite(rows[:, 2]), 1, 0)
    )
    return (*rows[:, :4].T, kind), (units[0], units[2]) if len(units) >= 4 else None


def _two_units(text: str) -> tuple[str, str] | None:
    units = re.findall(r"\[([^\]]*)\]", text)
    return (units[0], units[1]) if len(units) >= 2 else None


def read_davis(path: Path) -> Vectors:
    """A DaVis vector buffer (.vc7) through lvpyio, scaled; disabled and masked vectors are absent.

    Positions are grid index x grid x slope + offset (DaVis) and v is positive in the direction of
    the axis that DaVis scaled; rows run from the top, so y is "up" where that scale's slope is
    negative, as after a calibration, else "down".
    """
    _head(path, 16)
    buffer = read_buffer(path)
    absent = buffer["absent"]
    (slope_x, offset_x, unit_x), (slope_y, offset_y, _) = buffer["x"], buffer["y"]
    rows, columns = absent.shape
    x = (np.arange(columns) + 0.5) * buffer["grid"][0] * slope_x + offset_x
    y = (np.arange(rows) + 0.5) * buffer["grid"][1] * slope_y + offset_y
    u, v = (np.where(absent, np.nan, buffer[n]) for n in ("u", "v"))
    flag = np.where(absent, 2, 0)
    # DaVis counts from the edge of the first pixel, we from its centre
    if _spelled(unit_x) == "px":
        x, y = x - 0.5, y - 0.5
    xx, yy = np.meshgrid(x, y)
    length, velocity = _spelled(unit_x), _spelled(buffer["i"][2])
    if velocity == "px":
        velocity = "px/frame"
    direction = "down" if slope_y > 0 else "up"
    return Vectors(*_grid(path, xx, yy, u, v, flag), length or None, velocity or None, direction)
