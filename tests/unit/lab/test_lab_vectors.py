"""Vectors and pictures come back through a dpiv.toml, with what it states of them."""

import numpy as np
import pytest
import xarray as xr

from piv.formats.plane_series import make_plane
from piv.formats.recording import RecordingWriter
from postprocess.lab.dpiv_toml import read_dpiv
from postprocess.lab.recorded import LabRecording, lab_vectors
from postprocess.lab.register import stated_registration
from tests.lab_scene import PICTURES, finger_kinematics, state, state_vectors

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


COUNT, ROWS, COLUMNS, RATE = 6, 40, 50, 500.0


def frames() -> np.ndarray:
    """Noise of 8 bit."""
    return np.random.default_rng(4).integers(0, 255, (COUNT, ROWS, COLUMNS), np.uint8)


def recording(folder, data) -> str:
    attrs = {"frame_rate_hz": RATE, "bits": 8}
    with RecordingWriter(folder / "a.h5", (ROWS, COLUMNS), np.uint8, COUNT, attrs) as writer:
        for k, image in enumerate(data):
            writer.write(k, image)
        writer.finish()
    return "a.h5"


def opened(
    folder, files: str, rate: float = RATE, piv: str = '"1-2,2-3"', x: str = "right"
) -> LabRecording:
    more = {"axes": f'{{ y = "up", x = "{x}", root_px = [20.0, 4.0] }}'}
    more |= {"files": f'"{files}"', "frame_rate_hz": f"{rate}"}
    more |= {"piv": f"{{ window = 16, spacing = 8, pairing = {piv} }}"}
    return LabRecording(read_dpiv(state(folder, PICTURES | more)))


@pytest.mark.parametrize(
    "rate, piv, times",
    [
        (RATE, '"1-2,2-3"', np.arange(COUNT) / RATE),
        (50.0, '"1-2,3-4", interval_s = 0.002', [0.0, 0.002, 0.02, 0.022, 0.04, 0.042]),
    ],
)
def test_frames_and_times(tmp_path, rate, piv, times):
    data = frames()
    pictures = opened(tmp_path, recording(tmp_path, data), rate, piv)
    np.testing.assert_allclose(pictures.times, times)
    assert all(np.array_equal(pictures.frame(k), data[k]) for k in range(COUNT))


def test_a_rate_that_contradicts_the_camera_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"frame_rate_hz is 250, but .* states 500"):
        opened(tmp_path, recording(tmp_path, frames()), 250.0)


def test_mirrored_pictures_are_turned_back(tmp_path):
    data = frames()
    pictures = opened(tmp_path, recording(tmp_path, data), x="left")
    assert np.array_equal(pictures.frame(0), data[0][:, ::-1])
    assert pictures.turned((20.0, 4.0)) == (COLUMNS - 21.0, 4.0)
