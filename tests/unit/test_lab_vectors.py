"""Exported vectors of every kind come back through a dpiv.toml as the series that was exported."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.io import savemat

from piv.exchange import write_vectors
from piv.plane import make_plane
from postprocess.lab.compare import _stated_registration
from postprocess.lab.dpiv import read_dpiv
from postprocess.lab.sides import lab_vectors
from tests.lab_scene import finger_family

SCALE, INTERVAL, ROWS = 0.25e-3, 0.002, 200
TOML = """format = "dpiv"
format_version = 1
title = "exported"
kind = "vectors"
files = "{files}"
frame_rate_hz = 100.0
start = {{ at_s = 0.05, std_s = 0.001 }}
sheet_thickness_mm = 1.5
finger_geometry = "measured"
camera = "none"
scale = {{ mm_per_px = 0.25, std_percent = 0.5 }}
axes = {{ y = "{y}", root_mm = [20.0, 15.0], root_std_mm = 0.3 }}
piv = {{ window = 24, spacing = 8 }}
vectors = {{ {vectors} }}
"""


def series() -> xr.Dataset:
    """Three instants in metres, y up, one vector absent."""
    x, y = (8 + 8 * np.arange(14)) * SCALE, (7 + 8 * np.arange(10)) * SCALE
    rng = np.random.default_rng(5)
    u, v = rng.normal(0, 0.1, (2, 3, 10, 14))
    valid = np.ones(u.shape, bool)
    valid[1, 2, 3] = False
    u[1, 2, 3] = v[1, 2, 3] = np.nan
    return make_plane(x, y, u, v, time=np.arange(3) / 100.0, valid=valid)


def pivlab_mat(plane, path: Path) -> None:
    """A session of PIVlab: px, y down, one cell per instant."""
    names = ("x", "y", "u_original", "v_original", "typevector_original")
    cells = {name: np.empty((3, 1), object) for name in names}
    xx, yy = np.meshgrid(plane["x"].values / SCALE, (ROWS - 1) - plane["y"].values[::-1] / SCALE)
    for k in range(3):
        u, v = (np.nan_to_num(plane[n].values[k][::-1]) * INTERVAL / SCALE for n in ("u", "v"))
        kind = plane["valid"].values[k][::-1].astype(float)
        for name, values in zip(names, (xx, yy, u, -v, kind), strict=True):
            cells[name][k, 0] = values
    savemat(path, cells | {"units": "[px] respectively [px/frame]"})


def davis(plane, folder: Path) -> None:
    """DaVis buffers in mm and m/s, rows running down."""
    lv = pytest.importorskip("lvpyio")
    x, y = plane["x"].values * 1e3, plane["y"].values * 1e3
    step = x[1] - x[0]
    for k in range(3):
        values = np.zeros((y.size, x.size), dtype=lv.vec2c)
        values["u"], down = (np.nan_to_num(plane[n].values[k][::-1]) for n in ("u", "v"))
        values["v"] = -down  # DaVis counts v along its rows
        buffer = lv.arrays_to_buffer([np.ma.array(values, mask=plane["valid"].values[k][::-1] == 0)])
        frame = buffer[0]
        frame.scales.x = lv.Scale(step / 8, x[0] - step / 2, "mm", "x")
        frame.scales.y = lv.Scale(-step / 8, y[-1] + step / 2, "mm", "y")
        frame.scales.i = lv.Scale(1.0, 0.0, "m/s", "velocity")
        frame.grid = lv.Grid(8, 8, 1)
        lv.write_buffer(buffer, str(folder / f"B{k:05d}.vc7"))


KINDS = {
    "openpiv": ("v*.txt", "up", 'kind = "openpiv", length_unit = "m", velocity_unit = "m/s", std_px = 0.05'),
    "tecplot": ("v*.dat", "up", "std_px = 0.05"),
    "pivlab": ("s.mat", "down", f"interval_s = {INTERVAL}, image_rows = {ROWS}, std_px = 0.05"),
    "davis": ("*.vc7", "up", 'kind = "davis", std_px = 0.05'),
    "plane": ("v.h5", "up", "std_px = 0.05"),
    "csv": ("v.csv", "up", "std_px = 0.05"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_format_comes_back(tmp_path, kind):
    plane = series()
    files, y, vectors = KINDS[kind]
    if kind == "pivlab":
        pivlab_mat(plane, tmp_path / files)
    elif kind == "davis":
        davis(plane, tmp_path)
    else:
        write_vectors(plane, tmp_path / files.replace("*", ""))
    (tmp_path / "dpiv.toml").write_text(TOML.format(files=files, y=y, vectors=vectors))
    back = lab_vectors(read_dpiv(tmp_path))
    for name in ("u", "v"):
        np.testing.assert_allclose(back[name].values, plane[name].values, atol=2e-6, err_msg=kind)
    for name in ("x", "y"):
        np.testing.assert_allclose(back[name].values, plane[name].values, atol=1e-7)
    np.testing.assert_allclose(back["time"].values, [0.0, 0.01, 0.02])
    # 0.05 px of displacement over the interval of a pair, or of the frames where no other is stated
    assert float(back["u_std"].max()) == pytest.approx(
        0.05 * SCALE / (INTERVAL if kind == "pivlab" else 0.01)
    )


def test_uncertainty_is_asked_for(tmp_path):
    write_vectors(series(), tmp_path / "v.h5")
    (tmp_path / "dpiv.toml").write_text(TOML.format(files="v.h5", y="up", vectors='kind = "plane"'))
    with pytest.raises(ValueError, match=r"give vectors\.std_px"):
        lab_vectors(read_dpiv(tmp_path))


def test_units_that_a_file_does_not_state_are_asked_for(tmp_path):
    write_vectors(series(), tmp_path / "v.txt")
    (tmp_path / "dpiv.toml").write_text(TOML.format(files="v*.txt", y="up", vectors="std_px = 0.05"))
    with pytest.raises(ValueError, match=r"give vectors\.length_unit"):
        lab_vectors(read_dpiv(tmp_path))


@pytest.mark.parametrize("y, rows, up", [("up", None, 0.015), ("down", None, -0.015), ("down", 201, 0.035)])
def test_stated_pose_counts_y_as_the_file_does(tmp_path, y, rows, up):
    vectors = "std_px = 0.05" + (f", image_rows = {rows}" if rows else "")
    (tmp_path / "dpiv.toml").write_text(TOML.format(files="v.h5", y=y, vectors=vectors))
    registration = _stated_registration(read_dpiv(tmp_path), finger_family(tmp_path))
    assert registration.pose.at_px == pytest.approx((0.020, up))
    assert registration.law.delay == pytest.approx(-0.05)
    assert registration.law.std("delay") == pytest.approx(0.001)
