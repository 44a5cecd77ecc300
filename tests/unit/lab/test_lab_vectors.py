"""Vectors come back through a dpiv.toml in metres, with what it states of them."""

import numpy as np
import pytest
import xarray as xr

from piv.formats.plane_series import make_plane
from postprocess.lab.dpiv_toml import read_dpiv
from postprocess.lab.recorded import lab_vectors
from postprocess.lab.register import stated_registration
from tests.lab_scene import finger_kinematics, state_vectors

SCALE, INTERVAL = 0.25e-3, 0.002


def series() -> xr.Dataset:
    """Three instants in metres, y up, one vector absent."""
    x, y = (8 + 8 * np.arange(14)) * SCALE, (7 + 8 * np.arange(10)) * SCALE
    rng = np.random.default_rng(5)
    u, v = rng.normal(0, 0.1, (2, 3, 10, 14))
    valid = np.ones(u.shape, bool)
    valid[1, 2, 3] = False
    u[1, 2, 3] = v[1, 2, 3] = np.nan
    return make_plane(x, y, u, v, time=np.arange(3) / 100.0, valid=valid)


def in_px(plane: xr.Dataset) -> xr.Dataset:
    """As `piv correlate --rate` writes it without a calibration: px, px per frame, s."""
    out = plane.assign({n: plane[n] * INTERVAL / SCALE for n in ("u", "v")})
    out = out.assign_coords(x=plane["x"] / SCALE, y=plane["y"] / SCALE)
    for name, unit in dict.fromkeys(("x", "y", "u", "v"), "px").items() | {("time", "s")}:
        out[name].attrs["units"] = unit
    return out


@pytest.mark.parametrize(
    "written, files",
    [(series, '"v.h5"'), (lambda: in_px(series()), '["v.h5"]')],
    ids=["m", "px, a list of one file"],
)
def test_vectors_come_back_in_metres(tmp_path, written, files):
    plane, back = series(), lab_vectors(read_dpiv(state_vectors(written(), tmp_path, files=files)))
    for name in ("u", "v"):
        np.testing.assert_allclose(back[name].values, plane[name].values, atol=2e-6)
    for name in ("x", "y"):
        np.testing.assert_allclose(back[name].values, plane[name].values, atol=1e-7)
    np.testing.assert_allclose(back["time"].values, [0.0, 0.01, 0.02])
    # 0.05 px of displacement over the time between the exposures
    assert float(back["u_std"].max()) == pytest.approx(0.05 * SCALE / INTERVAL)


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("frame_rate_hz = 100", "frame_rate_hz = 500", r"is 500, but .* 100 fields per second"),
        ('y = "up"', 'y = "down"', 'state y = "up"'),
        ("vectors = { std_px = 0.05 }", "", r"give vectors\.std_px"),
        ('"v.h5"', '"dpiv.toml"', "is no series of vectors; "),
        ('"v.h5"', '"w.h5"', r"w\.h5: is missing"),
        ('"v.h5"', '["v.h5", "w.h5"]', "vectors are one file"),
        ('"v.h5"', '"v*.dat"', r"piv convert FILES -o vectors\.h5"),
    ],
)
def test_what_is_missing_or_contradicts_the_file_is_refused(tmp_path, old, new, message):
    path = state_vectors(series(), tmp_path) / "dpiv.toml"
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(ValueError, match=message):
        lab_vectors(read_dpiv(tmp_path))


def test_stated_pose_and_clock(tmp_path):
    dpiv = read_dpiv(state_vectors(series(), tmp_path))
    registration = stated_registration(dpiv, finger_kinematics(tmp_path))
    assert registration.pose.at_px == pytest.approx((0.020, 0.015))
    assert registration.law.delay == pytest.approx(-0.05)
    assert registration.law.std("delay") == pytest.approx(0.001)
    assert np.sqrt(registration.covariance[2, 2]) == pytest.approx(np.radians(0.5))
