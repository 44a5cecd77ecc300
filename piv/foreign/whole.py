"""Files of other programs that hold every variable of a plane series: CSV, Tecplot, VTK, MATLAB.

What such a format has no place for (units, attributes, variables that are no fields) stands in it
as JSON: in the first line of a CSV, the last one of a Tecplot file, a comment of a VTK file, the
variable `plane_series` of a MATLAB file. Files with it are read back as they were.
"""

import base64
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import xarray as xr
from numpy import ndarray
from scipy.io import loadmat, savemat
from scipy.io.matlab import matfile_version

from piv.files.atomic import whole, write_text
from piv.files.child_process import read_in_child
from piv.files.errors import one_line
from piv.files.json_text import plain
from piv.formats.plane_series import SCHEMA, check_plane, fields_of

_MARK = "# plane-series "  # before the JSON in the last line of a Tecplot file
_TAIL = 1 << 16  # bytes of it that are looked through at first
NAME = "plane_series"  # the variable with the JSON in a MATLAB file


def _head(plane: xr.Dataset) -> dict[str, Any]:
    """What is not in the columns: attributes, units and types; other variables whole."""

    def about(name: str) -> dict[str, Any]:
        return {**plane[name].attrs, "dtype": str(plane[name].dtype)}

    names, series = fields_of(plane), "time" in plane["u"].dims
    columns = ["x", "y", *(["time"] if series else []), *names]
    further = {
        str(n): about(str(n))
        | {"dims": v.dims, "values": v.values, "coordinate": n in plane.coords}
        for n, v in plane.variables.items()
        if n not in columns
    }
    return {
        **SCHEMA.label,
        "series": series,
        "variables": {n: about(n) for n in columns},
        "further": further,
        "attributes": plane.attrs,
    }


def _text(head: dict[str, Any]) -> str:
    return json.dumps(head, default=plain)


def _plane(head: dict[str, Any], columns: dict[str, ndarray]) -> xr.Dataset:
    """The plane (series) of a head and its columns: axes, fields (time, y, x)."""
    series, about = head["series"], head["variables"]
    dims = ("time", "y", "x") if series else ("y", "x")
    plane = xr.Dataset(attrs=head["attributes"])
    for name, attrs in about.items():
        values = columns[name].astype(attrs.pop("dtype"))
        own = (name,) if name in ("x", "y", "time") else dims
        plane[name] = (own, values if series or len(own) == 1 else values[0], attrs)
    for name, attrs in head["further"].items():
        values = np.array(attrs.pop("values"), attrs.pop("dtype"))
        plane[name] = (
            attrs.pop("dims"),
            values,
            {k: v for k, v in attrs.items() if k != "coordinate"},
        )
        if attrs["coordinate"]:
            plane = plane.set_coords(name)
    check_plane(plane)
    return plane


def _instants(plane: xr.Dataset) -> Iterator[tuple[float, xr.Dataset]]:
    """Time and fields of every instant."""
    fields = plane[fields_of(plane)]
    if "time" not in fields.dims:
        yield float(plane.coords.get("time", 0.0)), fields
        return
    for k, time in enumerate(plane["time"].values):
        yield float(time), fields.isel(time=k)


def _table(fields: xr.Dataset) -> pd.DataFrame:
    xx, yy = np.meshgrid(fields["x"].values, fields["y"].values)
    values = {str(n): f.values.ravel() for n, f in fields.data_vars.items()}
    return pd.DataFrame({"x": xx.ravel(), "y": yy.ravel()} | values)


def write_csv(plane: xr.Dataset, path: Path) -> None:
    """`# {json}`, then time, x, y and every field; empty where absent."""
    with whole(path) as part, part.open("w", encoding="utf-8") as file:
        file.write(f"# {_text(_head(plane))}\n")
        for k, (time, fields) in enumerate(_instants(plane)):
            table = _table(fields)
            table.insert(0, "time", time)
            table.to_csv(file, index=False, header=k == 0)


def read_csv(path: Path) -> xr.Dataset:
    """A plane (series) from `write_csv`."""
    try:
        with path.open(encoding="utf-8") as file:
            head = json.loads(file.readline().lstrip("# "))
        table = pd.read_csv(path, skiprows=1)
        x, y, time = (np.unique(table[n]) for n in ("x", "y", "time"))
        table = table.sort_values(["time", "y", "x"])
        shape = (time.size, y.size, x.size)
        columns = {n: table[n].to_numpy().reshape(shape) for n in table if n not in "xy"}
        return _plane(head, columns | {"x": x, "y": y, "time": time})
    except FileNotFoundError:
        raise FileNotFoundError(f"{path}: no such file") from None
    except Exception as error:  # of damaged text the libraries raise many kinds
        raise ValueError(
            f"{path}: not a CSV of vectors as this program writes ({one_line(error)}); make"
            " vectors.h5 of other programs' by piv convert"
        ) from error


def write_tecplot(plane: xr.Dataset, path: Path) -> None:
    """A zone per instant, POINT packing, with STRANDID and SOLUTIONTIME.

    Tecplot knows no absent number: 0 stands for it, and the column ABSENT is the sum of 2^k over
    the fields k, from 0 on, that are absent.
    """
    fields = fields_of(plane)
    named = {"u": "U", "v": "V", "valid": "CHC"}
    first = sorted(fields, key=lambda n: list(named).index(n) if n in named else len(named))
    units = {n: str(plane[n].attrs.get("units", "")) for n in ("x", "y", *first)}
    titles = [
        named.get(n, n.upper() if n in "xy" else n) + (f" ({units[n]})" if n != "valid" else "")
        for n in ("x", "y", *first)
    ]
    with whole(path) as part, part.open("w", encoding="utf-8") as file:
        file.write('TITLE = "plane, y up"\nVARIABLES = ')
        file.write(", ".join(f'"{t}"' for t in [*titles, "ABSENT"]) + "\n")
        for time, instant in _instants(plane):
            table = _table(instant)[["x", "y", *first]]
            absent = table[first].isna().to_numpy() @ 2 ** np.arange(len(first))
            rows = np.column_stack([table.fillna(0.0).to_numpy(float), absent])
            file.write(
                f"ZONE STRANDID=1, SOLUTIONTIME={time:.12g}, I={plane.sizes['x']}, "
                f"J={plane.sizes['y']}, F=POINT\n"
            )
            np.savetxt(file, rows, fmt="%.9g")
        file.write(_MARK + _text(_head(plane) | {"fields": first}) + "\n")


def _tecplot_head(path: Path) -> dict[str, Any] | None:
    """The JSON of a Tecplot file that this program wrote; None of another."""
    with path.open("rb") as file:
        size = file.seek(0, 2)
        reach = _TAIL
        while True:
            file.seek(max(0, size - reach))
            tail = file.read().rstrip(b"\n")
            start = tail.rfind(b"\n")
            if start >= 0 or reach >= size:
                break
            reach *= 8
    last = tail[start + 1 :].decode("utf-8", "replace")
    return json.loads(last[len(_MARK) :]) if last.startswith(_MARK) else None


def _read_tecplot(path: Path, head: dict[str, Any]) -> xr.Dataset:
    times, zones, names = [], [], head.pop("fields")
    with path.open(encoding="utf-8") as file:
        for line in file:
            if line.startswith("ZONE"):
                found = re.search(r"SOLUTIONTIME=(\S+), I=(\d+), J=(\d+)", line)
                if found is None:
                    raise ValueError("a zone states neither time nor size")
                count = int(found[2]) * int(found[3])
                rows = np.loadtxt(file, max_rows=count, ndmin=2)
                times.append(float(found[1]))
                zones.append(rows.reshape(int(found[3]), int(found[2]), -1))
    data = np.stack(zones)
    absent = data[..., -1].astype(np.int64)
    columns = {
        n: np.where(absent >> k & 1, np.nan, data[..., 2 + k]) if absent.any() else data[..., 2 + k]
        for k, n in enumerate(names)
    }
    axes = {"x": data[0, 0, :, 0], "y": data[0, :, 0, 1], "time": np.array(times)}
    return _plane(head, columns | axes)


def write_vti(plane: xr.Dataset, path: Path) -> list[Path]:
    """VTK image data, one file per instant, with a .pvd of their times where there are several.

    The vectors are `velocity`, 0 where absent; fields are arrays of their names.
    """
    instants = list(_instants(plane))
    width = max(4, len(str(len(instants) - 1)))
    several = "time" in plane.dims
    files = [
        path.with_name(f"{path.stem}_{k:0{width}d}.vti") if several else path
        for k in range(len(instants))
    ]
    timed = [n for n, v in plane.data_vars.items() if "time" in v.dims]
    for k, (file, (time, fields)) in enumerate(zip(files, instants, strict=True)):
        head = _head(plane.isel(time=k, drop=True) if several else plane) | {"timed": timed}
        if several:
            head["time"] = plane["time"].attrs
        write_text(file, _vti(fields, time, _text(head)))
    if several:
        sets = "".join(
            f'<DataSet timestep="{t!r}" file="{n.name}"/>\n'
            for n, (t, _) in zip(files, instants, strict=True)
        )
        files.append(path.with_suffix(".pvd"))
        write_text(
            files[-1],
            '<VTKFile type="Collection" version="0.1">\n<Collection>\n'
            f"{sets}</Collection>\n</VTKFile>\n",
        )
    return files


def _vti(fields: xr.Dataset, time: float, head: str) -> str:
    """VTK's XML image data, version 1.0: arrays as base64 behind their length in bytes."""
    x, y = fields["x"].values, fields["y"].values
    u, v = (np.nan_to_num(fields[n].values) for n in ("u", "v"))
    arrays = {"velocity": np.stack([u, v, np.zeros_like(u)], axis=-1)}
    arrays |= {str(n): f.values for n, f in fields.data_vars.items()}
    extent = f"0 {x.size - 1} 0 {y.size - 1} 0 0"
    geometry = f'Origin="{x[0]!s} {y[0]!s} 0" Spacing="{x[1] - x[0]!s} {y[1] - y[0]!s} 1"'
    comment = head.replace("--", "-\\u002d")  # which XML does not allow in a comment
    return (
        '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f"<!--{comment}-->\n"
        f'<ImageData WholeExtent="{extent}" {geometry}>\n'
        '<FieldData><DataArray type="Float64" Name="TimeValue" NumberOfTuples="1" format="ascii">'
        f"{time!r}</DataArray></FieldData>\n"
        f'<Piece Extent="{extent}">\n<PointData Vectors="velocity">\n'
        + "".join(_vti_array(name, values) for name, values in arrays.items())
        + "</PointData>\n</Piece>\n</ImageData>\n</VTKFile>\n"
    )


def _vti_array(name: str, values: ndarray) -> str:
    kind = "UInt8" if values.dtype.itemsize == 1 else "Float64"
    content = values.astype("u1" if kind == "UInt8" else "<f8").tobytes()
    text = base64.b64encode(len(content).to_bytes(8, "little") + content).decode()
    return (
        f'<DataArray type="{kind}" Name="{name}" '
        f'NumberOfComponents="{3 if values.ndim == 3 else 1}" '
        f'format="binary">{text}</DataArray>\n'
    )


def _read_vti(path: Path) -> xr.Dataset:
    """A plane from a .vti, or a series from the .pvd, of `write_vti`."""
    try:
        if path.suffix.lower() == ".pvd":
            sets = [s.attrib for s in ElementTree.parse(path).iter("DataSet")]
            parts = [_one_vti(path.parent / Path(s["file"]).name) for s in sets]
            head = parts[0][1]
            times = ("time", [float(s["timestep"]) for s in sets], head["time"])
            series = xr.concat(
                [plane for plane, _ in parts], "time", data_vars=head["timed"], join="exact"
            )
            return series.assign_coords(time=times)
        return _one_vti(path)[0]
    except FileNotFoundError as error:
        raise FileNotFoundError(f"{error.filename}: no such file") from None
    except Exception as error:  # of damaged files the parser raises many kinds
        raise ValueError(
            f"{path}: not a VTK file of vectors as this program writes ({one_line(error)})"
        ) from error


def _one_vti(path: Path) -> tuple[xr.Dataset, dict[str, Any]]:
    """Plane and head of one instant."""
    text = path.read_text(encoding="utf-8")
    comment = re.search(r"<!--(.*)-->", text)
    if comment is None:
        raise ValueError("it is not of this program")
    head = json.loads(comment[1])
    about = head["variables"]
    extent, origin, step = (
        [float(n) for n in re.findall(rf'{key}="([^"]*)"', text)[0].split()]
        for key in ("WholeExtent", "Origin", "Spacing")
    )
    shape = (1, int(extent[3]) + 1, int(extent[1]) + 1)
    columns = {n: origin[k] + step[k] * np.arange(shape[2 - k]) for k, n in enumerate(("x", "y"))}
    for array in ElementTree.fromstring(text).iter("DataArray"):
        if (name := array.attrib["Name"]) in about:
            content = base64.b64decode(array.text or "")[8:]
            kind = "u1" if array.attrib["type"] == "UInt8" else "<f8"
            columns[name] = np.frombuffer(content, kind).reshape(shape)
    return _plane(head, columns), head


def write_mat(plane: xr.Dataset, path: Path) -> None:
    """MATLAB 5: axes, fields (y, x) or (y, x, time), struct `units`, JSON `plane_series`."""
    values = {str(n): v.values for n, v in plane.variables.items()}
    for name in fields_of(plane):
        if "time" in plane[name].dims:
            values[name] = np.moveaxis(values[name], 0, -1)
    units = {n: str(plane[n].attrs["units"]) for n in values if plane[n].attrs.get("units")}
    head = _head(plane)
    for about in head["further"].values():
        about["shape"] = about.pop("values").shape
    try:
        with whole(path, suffix=True) as part:
            savemat(
                part,
                values | {"units": units, NAME: _text(head)},
                do_compression=True,
                long_field_names=True,
            )
    except (ValueError, OverflowError) as error:
        raise ValueError(
            f"{path}: too large for a MATLAB file of version 5 ({one_line(error)}); "
            "write .nc, which MATLAB reads by ncread"
        ) from error


def _is_own_mat(path: Path) -> bool:
    """Whether a .mat file is one of `write_mat`."""
    try:
        return matfile_version(path)[0] == 1 and read_in_child(_mat_head, str(path)) is not None
    except Exception:  # damaged: the reader of PIVlab's files says how
        return False


def _mat_head(path: str) -> str | None:
    found = loadmat(path, variable_names=[NAME])
    return str(found[NAME][0]) if NAME in found else None


def _mat_values(path: str) -> dict[str, Any]:
    return {n: v for n, v in loadmat(path).items() if not n.startswith("__")}


def _read_mat(path: Path) -> xr.Dataset:
    values = read_in_child(_mat_values, str(path))
    head = json.loads(str(values[NAME][0]))
    columns: dict[str, ndarray] = {}
    ny, nx = values["y"].size, values["x"].size
    for name in head["variables"]:
        if name in ("x", "y", "time"):
            columns[name] = values[name].ravel()
        else:  # MATLAB drops trailing dimensions of one
            columns[name] = np.moveaxis(values[name].reshape(ny, nx, -1), -1, 0)
    for name, about in head["further"].items():
        about["values"] = values[name].reshape(about.pop("shape"))
    return _plane(head, columns)


def read_whole(path: Path) -> xr.Dataset | None:
    """A file that this module wrote; None for other files. ValueError where it is damaged."""
    suffix = path.suffix.lower()
    if suffix in (".vti", ".pvd"):
        return _read_vti(path)
    if not path.is_file():
        return None
    try:
        if suffix == ".mat" and _is_own_mat(path):
            return _read_mat(path)
        if suffix == ".dat" and (head := _tecplot_head(path)):
            return _read_tecplot(path, head)
    except Exception as error:  # of damaged files the libraries raise many kinds
        raise ValueError(f"{path}: damaged ({one_line(error, 200)})") from error
    return None
