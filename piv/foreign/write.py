"""Plane series in the formats that other programs open."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from fileio.atomic import whole, write_text
from fileio.formats.plane_series import SCHEMA, check_plane, write_plane
from fileio.hdf5 import whole_netcdf
from piv.foreign.davis import write_buffer


def write_vectors(plane: xr.Dataset, path: str | Path) -> list[Path]:
    """Write by suffix: .h5, .nc (pivpy), .csv, .vti, .txt (OpenPIV), .dat (Tecplot), .vc7 (DaVis).

    The last four write one file per instant, numbered where there are several. Returns the files.
    """
    path = Path(path)
    check_plane(plane)
    suffix = path.suffix.lower()
    single = {".h5": write_plane, ".nc": _write_pivpy, ".csv": write_csv}
    if suffix in single:
        single[suffix](plane, path)
        return [path]
    many = {".vti": _vti, ".txt": _openpiv, ".dat": _tecplot, ".vc7": None}
    if suffix not in many:
        raise ValueError(f"{path}: cannot write {suffix!r}; known are {' '.join([*single, *many])}")
    frames = _instants(plane)
    width = max(4, len(str(len(frames) - 1)))
    names = [
        path if len(frames) == 1 else path.with_name(f"{path.stem}_{k:0{width}d}{suffix}")
        for k in range(len(frames))
    ]
    for name, (_, frame) in zip(names, frames, strict=True):
        to_text = many[suffix]
        if to_text is None:
            write_buffer(frame, name)
        else:
            write_text(name, to_text(frame))
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


def _write_pivpy(plane: xr.Dataset, path: Path) -> None:
    """netCDF-4 in the layout of pivpy: dimensions y, x, t; `chc` 1 = measured."""
    series = plane if "time" in plane.dims else plane.expand_dims(time=[0.0])
    keep = [n for n in ("u", "v", "valid", "u_std", "v_std", "flag") if n in series]
    out = series[keep].rename(time="t", valid="chc").transpose("y", "x", "t")
    interval = float(np.diff(out["t"].values[:2])[0]) if out.sizes["t"] > 1 else 0.0
    out["t"].attrs.setdefault("units", "frame" if units_of(plane)[0] == "px" else "s")
    out.attrs = plane.attrs | SCHEMA.label | {"delta_t": interval}
    whole_netcdf(out, path)


def _frame_table(plane: xr.Dataset) -> pd.DataFrame:
    names = [n for n in ("u", "v", "valid", "flag", "u_std", "v_std", "w", "p") if n in plane]
    xx, yy = np.meshgrid(plane["x"].values, plane["y"].values)
    return pd.DataFrame(
        {"x": xx.ravel(), "y": yy.ravel()} | {n: plane[n].values.ravel() for n in names}
    )


def write_csv(plane: xr.Dataset, path: Path) -> None:
    """`# {json}` with the units, then time, x, y, u, v, valid, ...; empty where absent."""
    length, velocity = units_of(plane)
    with whole(path) as part, part.open("w", encoding="utf-8") as file:
        head = {
            "format": SCHEMA.format,
            "length_unit": length,
            "velocity_unit": velocity,
            "time_unit": str(plane["time"].attrs.get("units", "s"))
            if "time" in plane.dims
            else "s",
            "series": "time" in plane.dims,
        }
        file.write("# " + json.dumps(head | {k: str(v) for k, v in plane.attrs.items()}) + "\n")
        for k, (time, frame) in enumerate(_instants(plane)):
            table = _frame_table(frame)
            table.insert(0, "time", time)
            table.to_csv(file, index=False, header=k == 0)


def _openpiv(plane: xr.Dataset) -> str:
    length, velocity = units_of(plane)
    t = _frame_table(plane)
    masked = (t["flag"] == 2) if "flag" in t else (t["valid"] == 0)
    rows = np.column_stack([t["x"], t["y"], t["u"], t["v"], (t["valid"] == 0) & ~masked, masked])
    text = io.StringIO()
    np.savetxt(
        text,
        rows,
        fmt="%.9g",
        delimiter="\t",
        header=f"length {length}; velocity {velocity}; y up\nx\ty\tu\tv\tflags\tmask",
    )
    return text.getvalue()


def _tecplot(plane: xr.Dataset) -> str:
    length, velocity = units_of(plane)
    t = _frame_table(plane)
    rows = t[["x", "y", "u", "v", "valid"]].fillna(0.0).to_numpy()
    names = [f"X ({length})", f"Y ({length})", f"U ({velocity})", f"V ({velocity})", "CHC"]
    head = (
        'TITLE = "plane, y up"\nVARIABLES = ' + ", ".join(f'"{n}"' for n in names) + "\n"
        f"ZONE I={plane.sizes['x']}, J={plane.sizes['y']}, F=POINT"
    )
    text = io.StringIO()
    np.savetxt(text, rows, fmt="%.9g", header=head, comments="")
    return text.getvalue()


def _vti(plane: xr.Dataset) -> str:
    """VTK's XML image data, version 1.0: arrays as base64 behind their length in bytes."""
    x, y = plane["x"].values, plane["y"].values
    absent = plane["valid"].values == 0
    u, v = (np.where(absent, 0.0, plane[n].values) for n in ("u", "v"))
    arrays = {"velocity": np.stack([u, v, np.zeros_like(u)], axis=-1)}
    arrays |= {
        n: plane[n].values for n in ("valid", "flag", "u_std", "v_std", "w", "p") if n in plane
    }
    extent = f"0 {x.size - 1} 0 {y.size - 1} 0 0"
    geometry = f'Origin="{x[0]!s} {y[0]!s} 0" Spacing="{x[1] - x[0]!s} {y[1] - y[0]!s} 1"'
    return (
        '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f'<ImageData WholeExtent="{extent}" {geometry}>\n<Piece Extent="{extent}">\n'
        '<PointData Vectors="velocity">\n'
        + "".join(_vti_array(name, values) for name, values in arrays.items())
        + "</PointData>\n</Piece>\n</ImageData>\n</VTKFile>\n"
    )


def _vti_array(name: str, values: np.ndarray) -> str:
    kind = "UInt8" if values.dtype.itemsize == 1 else "Float64"
    content = values.astype("u1" if kind == "UInt8" else "<f8").tobytes()
    text = base64.b64encode(len(content).to_bytes(8, "little") + content).decode()
    components = 3 if values.ndim == 3 else 1
    return (
        f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{components}" '
        f'format="binary">{text}</DataArray>\n'
    )


def _write_pvd(path: Path, names: Sequence[Path], times: Sequence[float]) -> Path:
    sets = "".join(
        f'<DataSet timestep="{t!r}" file="{n.name}"/>\n' for n, t in zip(names, times, strict=True)
    )
    write_text(
        path,
        '<VTKFile type="Collection" version="0.1">\n<Collection>\n'
        f"{sets}</Collection>\n</VTKFile>\n",
    )
    return path
