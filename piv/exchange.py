"""From other programs' vectors to plane series, and from plane series to what others open."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from piv.errors import one_line
from piv.images import natural_key
from piv.netcdf import open_netcdf, whole_netcdf
from piv.plane import FORMAT, check_plane, checked, make_plane, read_checked_plane, write_plane
from piv.vector_files import (
    Vectors,
    guess_format,
    read_davis,
    read_openpiv,
    read_pivlab,
    read_tecplot,
)
from piv.whole_file import whole, write_text

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}
VELOCITIES = {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "um/s": 1e-6, "µm/s": 1e-6}


def to_plane(
    found: Vectors,
    name: str,
    *,
    length_unit: str | None = None,
    velocity_unit: str | None = None,
    y_axis: str | None = None,
    scale_m_per_px: float | None = None,
    interval_s: float | None = None,
    image_rows: int | None = None,
) -> xr.Dataset:
    """A plane in m and m/s, y up, from vectors in the file's units; what the file does not state must be given.

    Lengths in px need `scale_m_per_px`; displacements (px/frame, or a length per frame) need `interval_s`; px
    with y down need `image_rows`, the height of the image, because 0 is to be its bottom row. ValueError names
    the missing option, and refuses an option that contradicts the file.
    """
    length = _told(name, "--length-unit", found.length_unit, length_unit, [*LENGTHS, "px"])
    speeds = [*VELOCITIES, "px/frame", *(f"{u}/frame" for u in LENGTHS)]
    velocity = _told(name, "--velocity-unit", found.velocity_unit, velocity_unit, [*speeds, "px/s"])
    direction = _told(name, "--y-axis", found.y_axis, y_axis, ["up", "down"])

    def factor(unit: str) -> float:
        if unit != "px":
            return LENGTHS[unit]
        if scale_m_per_px is None or not scale_m_per_px > 0:
            raise ValueError(f"{name}: the file is in px; give a positive --scale-mm-per-px or --calibration")
        return scale_m_per_px

    if velocity in VELOCITIES:
        speed = VELOCITIES[velocity]
    else:
        unit, per = velocity.split("/")
        if per == "frame" and (interval_s is None or not interval_s > 0):
            raise ValueError(f"{name}: displacements per frame; give the time between exposures, --interval")
        speed = factor(unit) / (interval_s if per == "frame" and interval_s else 1.0)
    x, y, u, v, flag = found.x * factor(length), found.y, found.u * speed, found.v * speed, found.flag
    if direction == "down":
        if length == "px":
            if image_rows is None:
                raise ValueError(
                    f"{name}: y is in px from the top; give the height of the image, --image-rows"
                )
            y = (image_rows - 1) - y
        else:
            y = -y
        y, u, v, flag = y[::-1], u[::-1], -v[::-1], flag[::-1]
    y = y * factor(length)
    valid = (flag == 0) | (flag == 4)
    valid &= np.isfinite(u) & np.isfinite(v)
    u, v = np.where(valid, u, np.nan), np.where(valid, v, np.nan)
    return make_plane(x, y, u, v, valid=valid, flag=np.ascontiguousarray(flag, np.uint8))


def _told(name: str, option: str, stated: str | None, given: str | None, known: Sequence[str]) -> str:
    if stated and given and stated != given:
        raise ValueError(f"{name}: {option} {given} contradicts the file, which states {stated}")
    value = stated or given
    if not value:
        raise ValueError(f"{name}: the file does not state it; give {option} ({', '.join(known)})")
    if value not in known:
        raise ValueError(f"{name}: unknown {option.lstrip('-')} {value!r}; known are {', '.join(known)}")
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

    `kind` overrides the guess from the name; `units` go to `to_plane`. A series needs `frame_rate_hz`.
    `zero_is_absent`: vectors of exactly (0, 0), which some programs write where they have none, become masked.
    """
    files = [Path(p) for p in paths]
    if not files:
        raise ValueError("no vector file given")
    kinds = {kind or guess_format(p) for p in files}
    if len(kinds) > 1:
        raise ValueError(f"vector files of several kinds: {', '.join(sorted(kinds))}")
    kind = kinds.pop()
    if kind in ("plane", "csv"):
        if len(files) > 1:
            raise ValueError(f"{files[0]}: give one {kind} file; it holds all instants itself")
        return _read_nc_or_plane(files[0]) if kind == "plane" else read_csv(files[0])
    readers: dict[str, Callable[[Path], Vectors]] = {
        "openpiv": read_openpiv,
        "tecplot": read_tecplot,
        "davis": read_davis,
    }
    if kind not in (*readers, "pivlab"):
        raise ValueError(
            f"unknown format {kind!r}; known are {', '.join([*readers, 'pivlab', 'csv', 'plane'])}"
        )
    files.sort(key=natural_key)
    if kind == "pivlab" and len(files) == 1:  # a .mat holds all instants of a session
        read = ((files[0], found) for found in read_pivlab(files[0], keep_replaced=keep_replaced))
    elif kind == "pivlab":
        read = ((path, next(read_pivlab(path, keep_replaced=keep_replaced))) for path in files)
    else:
        read = ((path, readers[kind](path)) for path in files)
    planes, names = [], []
    for path, found in read:
        if zero_is_absent:
            found.flag[(found.u == 0) & (found.v == 0)] = 2
        planes.append(to_plane(found, str(path), **units))  # type: ignore[arg-type]
        names.append(path)
    attrs = {"source": "lab", "imported_from": json.dumps([p.name for p in files])}
    if len(planes) == 1:
        return planes[0].assign_attrs(attrs)
    if frame_rate_hz is None or not frame_rate_hz > 0:
        raise ValueError(f"{len(planes)} instants are a series in time; give --frame-rate")
    first = planes[0]
    for path, plane in zip(names, planes, strict=True):
        for axis in ("x", "y"):
            if plane[axis].shape != first[axis].shape or not np.allclose(plane[axis], first[axis]):
                raise ValueError(f"{path}: its grid differs from that of {files[0].name}")
    stack = {n: np.stack([p[n].values for p in planes]) for n in ("u", "v", "valid", "flag")}
    time = np.arange(len(planes)) / frame_rate_hz
    return make_plane(first["x"].values, first["y"].values, time=time, **stack).assign_attrs(attrs)


def _read_nc_or_plane(path: Path) -> xr.Dataset:
    if path.suffix.lower() != ".nc":
        return read_checked_plane(path)
    data = open_netcdf(path, "netCDF-4 file")
    if data.attrs.get("format") == FORMAT and "t" in data.dims:
        back = data.rename(t="time").transpose("time", "y", "x").rename(chc="valid")
        back.set_close(data.close)
        return checked(back, path)
    return read_checked_plane(path)


def write_vectors(plane: xr.Dataset, path: str | Path) -> list[Path]:
    """Write by suffix: .h5 (plane series), .nc (pivpy's layout), .csv, .vti (+ .pvd), .txt (OpenPIV), .dat (Tecplot).

    The last three write one file per instant, numbered where there are several. Returns the files.
    """
    path = Path(path)
    check_plane(plane)
    suffix = path.suffix.lower()
    single = {".h5": write_plane, ".nc": write_pivpy, ".csv": write_csv}
    if suffix in single:
        single[suffix](plane, path)
        return [path]
    many = {".vti": _vti, ".txt": _openpiv, ".dat": _tecplot}
    if suffix not in many:
        raise ValueError(f"{path}: cannot write {suffix!r}; known are {' '.join([*single, *many])}")
    frames = _instants(plane)
    width = max(4, len(str(len(frames) - 1)))
    names = [
        path if len(frames) == 1 else path.with_name(f"{path.stem}_{k:0{width}d}{suffix}")
        for k in range(len(frames))
    ]
    for name, (_, frame) in zip(names, frames, strict=True):
        write_text(name, many[suffix](frame))
    if suffix == ".vti" and len(frames) > 1:
        names.append(_write_pvd(path.with_suffix(".pvd"), names, [t for t, _ in frames]))
    return names


def _instants(plane: xr.Dataset) -> list[tuple[float, xr.Dataset]]:
    if "time" not in plane.dims:
        return [(0.0, plane)]
    return [(float(t), plane.isel(time=k)) for k, t in enumerate(plane["time"].values)]


def units_of(plane: xr.Dataset) -> tuple[str, str]:
    """(unit of length, unit of velocity) that a plane states."""
    return str(plane["x"].attrs.get("units", "m")), str(plane["u"].attrs.get("units", "m/s"))


def write_pivpy(plane: xr.Dataset, path: Path) -> None:
    """netCDF-4 in the layout of pivpy: dimensions y, x, t; `chc` 1 = measured."""
    series = plane if "time" in plane.dims else plane.expand_dims(time=[0.0])
    keep = [n for n in ("u", "v", "valid", "u_std", "v_std", "flag") if n in series]
    out = series[keep].rename(time="t", valid="chc").transpose("y", "x", "t")
    interval = float(np.diff(out["t"].values[:2])[0]) if out.sizes["t"] > 1 else 0.0
    out.attrs = plane.attrs | {"format": FORMAT, "format_version": 1, "delta_t": interval}
    out["t"].attrs["units"] = "s"
    whole_netcdf(out, path)


def _frame_table(plane: xr.Dataset) -> pd.DataFrame:
    names = [n for n in ("u", "v", "valid", "flag", "u_std", "v_std", "w", "p") if n in plane]
    xx, yy = np.meshgrid(plane["x"].values, plane["y"].values)
    return pd.DataFrame({"x": xx.ravel(), "y": yy.ravel()} | {n: plane[n].values.ravel() for n in names})


def write_csv(plane: xr.Dataset, path: Path) -> None:
    """`# {json}` with the units, then time, x, y, u, v, valid, ...; empty where absent."""
    length, velocity = units_of(plane)
    with whole(path) as part, part.open("w", encoding="utf-8") as file:
        head = {
            "format": FORMAT,
            "length_unit": length,
            "velocity_unit": velocity,
            "series": "time" in plane.dims,
        }
        file.write("# " + json.dumps(head | {k: str(v) for k, v in plane.attrs.items()}) + "\n")
        for k, (time, frame) in enumerate(_instants(plane)):
            table = _frame_table(frame)
            table.insert(0, "time", time)
            table.to_csv(file, index=False, header=k == 0)


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
        units = head["length_unit"], head["velocity_unit"]
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
    for n in ("x", "y"):
        plane[n].attrs["units"] = units[0]
    for n in ("u", "v", "u_std", "v_std"):
        if n in plane:
            plane[n].attrs["units"] = units[1]
    return plane


def _openpiv(plane: xr.Dataset) -> str:
    t = _frame_table(plane)
    masked = (t["flag"] == 2) if "flag" in t else (t["valid"] == 0)
    rows = np.column_stack([t["x"], t["y"], t["u"], t["v"], (t["valid"] == 0) & ~masked, masked])
    text = io.StringIO()
    np.savetxt(text, rows, fmt="%.9g", delimiter="\t", header="x\ty\tu\tv\tflags\tmask")
    return text.getvalue()


def _tecplot(plane: xr.Dataset) -> str:
    length, velocity = units_of(plane)
    t = _frame_table(plane)
    rows = t[["x", "y", "u", "v", "valid"]].fillna(0.0).to_numpy()
    names = [f"X ({length})", f"Y ({length})", f"U ({velocity})", f"V ({velocity})", "CHC"]
    head = (
        'TITLE = "plane"\nVARIABLES = ' + ", ".join(f'"{n}"' for n in names) + "\n"
        f"ZONE I={plane.sizes['x']}, J={plane.sizes['y']}, F=POINT"
    )
    text = io.StringIO()
    np.savetxt(text, rows, fmt="%.9g", header=head, comments="")
    return text.getvalue()


def _vti(plane: xr.Dataset) -> str:
    import pyvista as pv
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

    x, y = plane["x"].values, plane["y"].values
    grid = pv.ImageData(
        dimensions=(x.size, y.size, 1), spacing=(x[1] - x[0], y[1] - y[0], 1.0), origin=(x[0], y[0], 0.0)
    )
    absent = plane["valid"].values == 0
    u, v = (np.where(absent, 0.0, plane[n].values).ravel() for n in ("u", "v"))
    grid["velocity"] = np.column_stack([u, v, np.zeros_like(u)])
    for n in ("valid", "flag", "u_std", "v_std", "w", "p"):
        if n in plane:
            grid[n] = plane[n].values.ravel()
    writer = vtkXMLImageDataWriter()
    writer.SetInputData(grid)
    writer.SetDataModeToBinary()
    writer.WriteToOutputStringOn()  # into a file it would not say that the disk is full
    writer.Write()
    return str(writer.GetOutputString())


def _write_pvd(path: Path, names: Sequence[Path], times: Sequence[float]) -> Path:
    sets = "".join(
        f'<DataSet timestep="{t!r}" file="{n.name}"/>\n' for n, t in zip(names, times, strict=True)
    )
    write_text(
        path, f'<VTKFile type="Collection" version="0.1">\n<Collection>\n{sets}</Collection>\n</VTKFile>\n'
    )
    return path
