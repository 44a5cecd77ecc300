"""Plane series in the files that other programs open: netCDF, CSV, VTK, MATLAB."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.io import savemat

from piv.files.atomic import whole, write_text
from piv.files.errors import one_line
from piv.formats.plane_series import check_plane, fields_of, write_plane


def write_vectors(plane: xr.Dataset, path: str | Path) -> list[Path]:
    """Write a plane or series by suffix: .h5 or .nc (the same), .csv, .mat, .vti.

    Every format holds every field. A series as .vti is one file per instant, numbered, and a .pvd
    of their times.

    Parameters
    ----------
    plane
        A plane or series.
    path
        The file.

    Returns
    -------
    list of pathlib.Path
        The files.

    Raises
    ------
    ValueError
        For another suffix, or a plane that is not whole.

    Examples
    --------
    >>> plane = piv.make_plane(np.arange(4.0), np.arange(3.0), np.ones((3, 4)), np.zeros((3, 4)))
    >>> piv.write_vectors(plane, "plane.csv")
    [PosixPath('plane.csv')]
    """
    path = Path(path)
    check_plane(plane)
    suffix = path.suffix.lower()
    if suffix not in _WRITERS:
        raise ValueError(f"{path}: cannot write {suffix!r}; known are {' '.join(_WRITERS)}")
    return _WRITERS[suffix](plane, path) or [path]


def _instants(plane: xr.Dataset) -> Iterator[tuple[float, xr.Dataset]]:
    """Time and fields of every instant."""
    fields = plane[fields_of(plane)]
    if "time" not in fields.dims:
        yield float(plane.coords.get("time", 0.0)), fields
        return
    for k, time in enumerate(plane["time"].values):
        yield float(time), fields.isel(time=k)


def _write_csv(plane: xr.Dataset, path: Path) -> None:
    """Time, x, y and every field; empty where absent. A first line # has the units."""
    units = {n: plane[n].attrs.get("units", "1") for n in ("x", "y", *fields_of(plane))}
    with whole(path) as part, part.open("w", encoding="utf-8") as file:
        file.write(f"# y up; {'; '.join(f'{n} in {unit}' for n, unit in units.items())}\n")
        for k, (time, fields) in enumerate(_instants(plane)):
            table = fields.drop_vars("time", errors="ignore").to_dataframe(["y", "x"]).reset_index()
            table = table[["x", "y", *fields.data_vars]]
            table.insert(0, "time", time)
            table.to_csv(file, index=False, header=k == 0)


def _write_vti(plane: xr.Dataset, path: Path) -> list[Path]:
    """VTK image data with the vectors as `velocity`, 0 where absent."""
    try:
        import pyvista
    except ImportError:
        raise ValueError(
            f"{path}: VTK files need the package pyvista: pip install pyvista"
        ) from None
    x, y = plane["x"].values, plane["y"].values
    several = "time" in plane.dims
    files, sets = [], ""
    for k, (time, fields) in enumerate(_instants(plane)):
        files.append(path.with_name(f"{path.stem}_{k:04d}.vti") if several else path)
        grid = pyvista.ImageData(
            dimensions=(x.size, y.size, 1), origin=(x[0], y[0], 0),
            spacing=(x[1] - x[0], y[1] - y[0], 1),
        )  # fmt: skip
        u, v = (np.nan_to_num(fields[n].values.ravel()) for n in ("u", "v"))
        grid.point_data["velocity"] = np.stack([u, v, np.zeros_like(u)], axis=-1)
        for name, field in fields.data_vars.items():
            grid.point_data[str(name)] = field.values.ravel()
        grid.field_data["TimeValue"] = [time]
        with whole(files[-1], suffix=True) as part:
            grid.save(part)
        sets += f'<DataSet timestep="{time!r}" file="{files[-1].name}"/>\n'
    if several:
        files.append(path.with_suffix(".pvd"))
        collection = f"<Collection>\n{sets}</Collection>"
        write_text(
            files[-1], f'<VTKFile type="Collection" version="0.1">\n{collection}\n</VTKFile>\n'
        )
    return files


def _write_mat(plane: xr.Dataset, path: Path) -> None:
    """MATLAB 5: axes, fields (y, x) or (y, x, time), struct `units`."""
    values = {str(n): v.values for n, v in plane.variables.items()}
    for name in fields_of(plane):
        if "time" in plane[name].dims:
            values[name] = np.moveaxis(values[name], 0, -1)
    units = {n: str(plane[n].attrs["units"]) for n in values if plane[n].attrs.get("units")}
    try:
        with whole(path, suffix=True) as part:
            savemat(part, values | {"units": units}, do_compression=True, long_field_names=True)
    except (ValueError, OverflowError) as error:
        raise ValueError(
            f"{path}: too large for a MATLAB file of version 5 ({one_line(error)}); "
            "write .nc, which MATLAB reads by ncread"
        ) from error


_WRITERS = {
    ".h5": write_plane, ".nc": write_plane, ".csv": _write_csv, ".mat": _write_mat,
    ".vti": _write_vti,
}  # fmt: skip
