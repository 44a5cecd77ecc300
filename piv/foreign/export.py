"""Files that other programs open, of a plane series: CSV, Tecplot, VTK, MATLAB."""

import base64
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from numpy import ndarray
from scipy.io import savemat

from piv.files.atomic import whole, write_text
from piv.files.errors import one_line
from piv.formats.plane_series import fields_of


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
    """Write time, x, y and every field; empty where absent. A first line # has the units."""
    units = {n: plane[n].attrs.get("units", "1") for n in ("x", "y", *fields_of(plane))}
    with whole(path) as part, part.open("w", encoding="utf-8") as file:
        file.write(f"# y up; {'; '.join(f'{n} in {unit}' for n, unit in units.items())}\n")
        for k, (time, fields) in enumerate(_instants(plane)):
            table = _table(fields)
            table.insert(0, "time", time)
            table.to_csv(file, index=False, header=k == 0)


def write_tecplot(plane: xr.Dataset, path: Path) -> None:
    """Write a zone per instant, POINT packing, with STRANDID and SOLUTIONTIME.

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


def write_vti(plane: xr.Dataset, path: Path) -> list[Path]:
    """Write VTK image data, one file per instant; where there are several, a .pvd of their times.

    The vectors are `velocity`, 0 where absent; fields are arrays of their names.
    """
    instants = list(_instants(plane))
    width = max(4, len(str(len(instants) - 1)))
    several = "time" in plane.dims
    files = [
        path.with_name(f"{path.stem}_{k:0{width}d}.vti") if several else path
        for k in range(len(instants))
    ]
    for file, (time, fields) in zip(files, instants, strict=True):
        write_text(file, _vti(fields, time))
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


def _vti(fields: xr.Dataset, time: float) -> str:
    """VTK's XML image data, version 1.0: arrays as base64 behind their length in bytes."""
    x, y = fields["x"].values, fields["y"].values
    u, v = (np.nan_to_num(fields[n].values) for n in ("u", "v"))
    arrays = {"velocity": np.stack([u, v, np.zeros_like(u)], axis=-1)}
    arrays |= {str(n): f.values for n, f in fields.data_vars.items()}
    extent = f"0 {x.size - 1} 0 {y.size - 1} 0 0"
    geometry = f'Origin="{x[0]!s} {y[0]!s} 0" Spacing="{x[1] - x[0]!s} {y[1] - y[0]!s} 1"'
    return (
        '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
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


def write_mat(plane: xr.Dataset, path: Path) -> None:
    """Write MATLAB 5: axes, fields (y, x) or (y, x, time), struct `units`."""
    values = {str(n): v.values for n, v in plane.variables.items()}
    for name in fields_of(plane):
        if "time" in plane[name].dims:
            values[name] = np.moveaxis(values[name], 0, -1)
    units = {n: str(plane[n].attrs["units"]) for n in values if plane[n].attrs.get("units")}
    try:
        with whole(path, suffix=True) as part:
            savemat(
                part,
                values | {"units": units},
                do_compression=True,
                long_field_names=True,
            )
    except (ValueError, OverflowError) as error:
        raise ValueError(
            f"{path}: too large for a MATLAB file of version 5 ({one_line(error)}); "
            "write .nc, which MATLAB reads by ncread"
        ) from error
