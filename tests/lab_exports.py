"""Vectors as every program exports them, each with its dpiv.toml."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.io import savemat

from piv.foreign.write import write_vectors

Place = tuple[float, float]  # mm
SCALE, INTERVAL, ROWS = 0.25e-3, 0.002, 520
TOML = """format = "dpiv"
format_version = 3
title = "exported"
kind = "vectors"
files = "{files}"
frame_rate_hz = 100.0
start = {{ at_s = 0.05, std_s = 0.001 }}
sheet_thickness_mm = 1.5
finger_geometry = "measured"
camera = "none"
scale = {{ scale_mm_per_px = 0.25, std_percent = 0.5 }}
axes = {{ y = "{y}", root_mm = [{root[0]!r}, {root[1]!r}], root_std_mm = 0.3, turn_std_deg = 0.5 }}
piv = {{ window = 24, spacing = 8, interval_s = 0.002 }}
vectors = {{ std_px = 0.05{vectors} }}
"""


def _pivlab(plane):
    """x, y, u, v and vector type (0: masked) of each instant as PIVlab has them: px, y down."""
    x, y = np.meshgrid(plane["x"].values / SCALE, (ROWS - 1) - plane["y"].values[::-1] / SCALE)
    for k in range(plane.sizes["time"]):
        u, v = (np.nan_to_num(plane[n].values[k][::-1]) * INTERVAL / SCALE for n in ("u", "v"))
        yield x, y, u, -v, plane["valid"].values[k][::-1].astype(float)


def pivlab_mat(plane, folder: Path) -> None:
    """A session of PIVlab, one cell per instant."""
    names = ("x", "y", "u_original", "v_original", "typevector_original")
    cells = {name: np.empty((plane.sizes["time"], 1), object) for name in names}
    for k, instant in enumerate(_pivlab(plane)):
        for name, values in zip(names, instant, strict=True):
            cells[name][k, 0] = values
    savemat(folder / "s.mat", cells | {"units": "[px] respectively [px/frame]"})


def davis(plane, folder: Path) -> None:
    """DaVis buffers in mm and m/s, rows running down."""
    lv = pytest.importorskip("lvpyio", reason="the DaVis reader, an extra, is not installed")
    x, y = plane["x"].values * 1e3, plane["y"].values * 1e3
    step = x[1] - x[0]
    for k in range(plane.sizes["time"]):
        values = np.zeros((y.size, x.size), dtype=lv.vec2c)
        values["u"], down = (np.nan_to_num(plane[n].values[k][::-1]) for n in ("u", "v"))
        values["v"] = -down  # DaVis counts v along its rows
        absent = plane["valid"].values[k][::-1] == 0
        buffer = lv.arrays_to_buffer([np.ma.array(values, mask=absent)])
        frame = buffer[0]
        frame.scales.x = lv.Scale(step / 8, x[0] - step / 2, "mm", "x")
        frame.scales.y = lv.Scale(-step / 8, y[-1] + step / 2, "mm", "y")
        frame.scales.i = lv.Scale(1.0, 0.0, "m/s", "velocity")
        frame.grid = lv.Grid(8, 8, 1)
        lv.write_buffer(buffer, str(folder / f"B{k:05d}.vc7"))


def pivlab_text(plane, folder: Path) -> None:
    """PIVlab's ASCII export, one file per instant."""
    for k, instant in enumerate(_pivlab(plane)):
        rows = np.column_stack([a.T.ravel() for a in instant])
        titles = "x [px],y [px],u [px/frame],v [px/frame],Vector type [-]"
        head = f"PIVlab, ASCII chart output\nFRAME: {k + 1}, filenames: A & B\n{titles}"
        style = {"fmt": "%.9g", "delimiter": ",", "comments": ""}
        np.savetxt(folder / f"PIVlab_{k + 1}.txt", rows, header=head, **style)


def microvec(plane, folder: Path) -> None:
    """Tecplot zones as MicroVec writes them: mm and m/s in the names, CHC where measured."""
    xx, yy = np.meshgrid(plane["x"].values * 1e3, plane["y"].values * 1e3)
    for k in range(plane.sizes["time"]):
        u, v = (np.nan_to_num(plane[n].values[k]) for n in ("u", "v"))
        valid = plane["valid"].values[k].astype(float)
        rows = np.column_stack([a.ravel() for a in (xx, yy, u, v, valid)])
        head = 'TITLE="MicroVec"\nVARIABLES="X(mm)","Y(mm)","U(m/s)","V(m/s)","CHC"\n'
        head += f"ZONE I={plane.sizes['x']}, J={plane.sizes['y']}, F=POINT"
        np.savetxt(folder / f"v{k}.dat", rows, fmt="%.9g", header=head, comments="")


def uncalibrated(plane, folder: Path) -> None:
    """A series as `piv correlate --rate` writes it without a calibration: px, px per frame, s."""
    out = plane.assign({n: plane[n] * INTERVAL / SCALE for n in ("u", "v")})
    out = out.assign_coords(x=plane["x"] / SCALE, y=plane["y"] / SCALE)
    for name in ("x", "y", "u", "v"):
        out[name].attrs["units"] = "px"
    out["time"].attrs["units"] = "s"
    write_vectors(out, folder / "v.h5")


# files, y, what else [vectors] must say; who writes them (None: this project)
KINDS = {
    "openpiv": ("v*.txt", "up", 'kind = "openpiv", length_unit = "m", velocity_unit = "m/s"', None),
    "tecplot": ("v*.dat", "up", "", None),
    "microvec": ("v*.dat", "up", "", microvec),
    "pivlab mat": ("s.mat", "down", f"image_rows = {ROWS}", pivlab_mat),
    "pivlab text": ("PIVlab_*.txt", "down", f"image_rows = {ROWS}", pivlab_text),
    "davis": ("*.vc7", "up", "", davis),
    "plane": ("v.h5", "up", "", None),
    "plane in px": ("v.h5", "up", "", uncalibrated),
    "csv": ("v.csv", "up", "", None),
}


def exported(plane: xr.Dataset, kind: str, folder: Path, root: Place = (20.0, 15.0)) -> Path:
    """A folder of vectors of a kind with its dpiv.toml; `root` (mm) in the plane's axes."""
    files, y, vectors, write = KINDS[kind]
    folder.mkdir(parents=True, exist_ok=True)
    if write is None:
        write_vectors(plane, folder / files.replace("*", ""))
    else:
        write(plane, folder)
    if y == "down":  # counted from the top row of the picture
        root = root[0], (ROWS - 1) * SCALE * 1e3 - root[1]
    return stated(folder, files, y, vectors, root)


def stated(
    folder: Path, files: str, y: str = "up", vectors: str = "", root: Place = (20.0, 15.0)
) -> Path:
    """The folder with a dpiv.toml."""
    more = f", {vectors}" if vectors else ""
    (folder / "dpiv.toml").write_text(TOML.format(files=files, y=y, vectors=more, root=root))
    return folder
