"""Exported vectors of every kind come back through a dpiv.toml as the series that was exported."""

import numpy as np
import pytest
import xarray as xr

from fileio.formats.plane_series import make_plane
from piv.foreign.write import write_vectors
from postprocess.lab.data.dpiv_toml import read_dpiv
from postprocess.lab.data.vectors import lab_vectors
from postprocess.lab.registration.step import stated_registration
from tests.lab_exports import INTERVAL, KINDS, SCALE, exported, stated
from tests.lab_scene import finger_kinematics


def series() -> xr.Dataset:
    """Three instants in metres, y up, one vector absent."""
    x, y = (8 + 8 * np.arange(14)) * SCALE, (7 + 8 * np.arange(10)) * SCALE
    rng = np.random.default_rng(5)
    u, v = rng.normal(0, 0.1, (2, 3, 10, 14))
    valid = np.ones(u.shape, bool)
    valid[1, 2, 3] = False
    u[1, 2, 3] = v[1, 2, 3] = np.nan
    return make_plane(x, y, u, v, time=np.arange(3) / 100.0, valid=valid)


@pytest.mark.parametrize("kind", KINDS)
def test_every_format_comes_back(tmp_path, kind):
    plane = series()
    back = lab_vectors(read_dpiv(exported(plane, kind, tmp_path)))
    for name in ("u", "v"):
        np.testing.assert_allclose(back[name].values, plane[name].values, atol=2e-6, err_msg=kind)
    for name in ("x", "y"):
        np.testing.assert_allclose(back[name].values, plane[name].values, atol=1e-7)
    np.testing.assert_allclose(back["time"].values, [0.0, 0.01, 0.02])
    # 0.05 px of displacement over the time between the exposures
    assert float(back["u_std"].max()) == pytest.approx(0.05 * SCALE / INTERVAL)


def test_uncertainty_is_asked_for(tmp_path):
    write_vectors(series(), tmp_path / "v.h5")
    path = stated(tmp_path, "v.h5") / "dpiv.toml"
    path.write_text(path.read_text().replace("std_px = 0.05", ""))
    with pytest.raises(ValueError, match=r"give vectors\.std_px"):
        lab_vectors(read_dpiv(tmp_path))


def test_units_that_a_file_does_not_state_are_asked_for(tmp_path):
    write_vectors(series(), tmp_path / "v.txt")
    for path in tmp_path.glob("v*.txt"):  # as OpenPIV writes them: without the line of units
        path.write_text(path.read_text().partition("\n")[2])
    with pytest.raises(ValueError, match=r"give vectors\.length_unit"):
        lab_vectors(read_dpiv(stated(tmp_path, "v*.txt")))


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("frame_rate_hz = 100.0", "frame_rate_hz = 500.0", r"is 500, but .* 100 fields per second"),
        ('y = "up"', 'y = "down"', 'state axes.y = "up"'),
    ],
)
def test_what_contradicts_the_file_is_refused(tmp_path, old, new, message):
    write_vectors(series(), tmp_path / "v.h5")
    path = stated(tmp_path, "v.h5") / "dpiv.toml"
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(ValueError, match=message):
        lab_vectors(read_dpiv(tmp_path))


@pytest.mark.parametrize(
    "y, rows, up", [("up", None, 0.015), ("down", None, -0.015), ("down", 201, 0.035)]
)
def test_stated_pose_counts_y_as_the_file_does(tmp_path, y, rows, up):
    stated(tmp_path, "v.h5", y, f"image_rows = {rows}" if rows else "")
    registration = stated_registration(read_dpiv(tmp_path), finger_kinematics(tmp_path))
    assert registration.pose.at_px == pytest.approx((0.020, up))
    assert registration.law.delay == pytest.approx(-0.05)
    assert registration.law.std("delay") == pytest.approx(0.001)
    assert np.sqrt(registration.covariance[2, 2]) == pytest.approx(np.radians(0.5))
