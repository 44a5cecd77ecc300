"""piv score: measures of vectors whose errors are known."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from piv.__main__ import main
from piv.formats.plane_series import make_plane, write_plane
from piv.synthetic.score import score
from piv.vortices.lamb_oseen_fit import lamb_oseen

PX, INTERVAL = 1e-4, 1e-3  # m, s
ROWS, COLUMNS = 256, 320
CORE, PEAK = 24.0, 4.0  # px
BODY = 60.0  # px: width of a body at the left


def flow(x, y, turned=1.0):
    """Vortex in a drift, px, at places in px."""
    u, v = lamb_oseen(x, y, 170.0, 120.0, turned * 2 * np.pi * CORE * PEAK / 0.6382, CORE)
    return u + 1.5, v


def truth(count=3):
    """Three instants on a grid of 4 px, whose vortex grows by a tenth in each."""
    x, y = np.arange(0, COLUMNS, 4.0), np.arange(0, ROWS, 4.0)
    at = np.meshgrid(x, y)
    u, v = np.stack([flow(*at, 1 + 0.1 * k) for k in range(count)], axis=1) * PX / INTERVAL
    water = np.broadcast_to(at[0] > BODY, u.shape)
    time = INTERVAL * (0.5 + np.arange(count))
    plane = make_plane(PX * x, PX * y, u, v, time=time, valid=water)
    about = {"scale_mm_per_px": 1e3 * PX, "interval": INTERVAL, "image_rows": ROWS}
    return plane.assign_attrs(about)


def measured(bias=0.0, noise=0.0, gain=1.0, count=3):
    """Vectors every 8 px, not at the truth's places, with stated uncertainties of 0.05 px."""
    x, y = np.arange(15.5, COLUMNS - 12, 8.0), np.arange(15.5, ROWS - 12, 8.0)
    at = np.meshgrid(x, y)
    u, v = np.stack([flow(*at, gain * (1 + 0.1 * k)) for k in range(count)], axis=1)
    rng = np.random.default_rng(5)
    u, v = (q + noise * rng.normal(size=q.shape) for q in (u + bias, v))
    std = {f"{n}_std": np.full(u.shape, 0.05 * PX / INTERVAL) for n in "uv"}
    water = np.broadcast_to(at[0] > BODY, u.shape)
    per, time = PX / INTERVAL, INTERVAL * (0.5 + np.arange(count))
    return make_plane(PX * x, PX * y, u * per, v * per, time=time, valid=water, **std)


def test_exact_vectors_have_no_error():
    found = score(measured(), truth())
    # cubic interpolation of a vortex of six grid steps errs by 0.002 px
    assert found["RMS error, px"] < 0.003
    assert found["vectors given, %"] == found["vortices found, %"] == 100
    assert found["vortices that are none"] == 0
    # over the vortex' radius of 3 mm; a hundredth of a grid step
    assert found["RMS distance of vortex centres, mm"] < 0.01
    assert found["RMS error of their circulation, %"] < 0.1
    assert "RMS error of pressure, % of its RMS" not in found


def test_bias_noise_bars_and_circulation_are_told():
    found = score(measured(bias=0.2, noise=0.05, gain=1.1), truth())
    # 0.4 px more of the vortex turns into no bias, since its sums vanish over the picture
    assert found["bias of u, px"] == pytest.approx(0.2, abs=0.02)
    assert abs(found["bias of v, px"]) < 0.02
    assert found["RMS error of their circulation, %"] == pytest.approx(10, abs=1)
    quiet = score(measured(noise=0.05), truth())
    # of 3,000 vectors, with three standard deviations of the sample's
    assert quiet["RMS error, px"] == pytest.approx(0.05, abs=0.002)
    assert quiet["within 1 std, %"] == pytest.approx(68.3, abs=2.5)
    assert quiet["within 2 std, %"] == pytest.approx(95.4, abs=1.2)


def test_absent_vectors_and_those_beside_a_wall_have_rows_of_their_own():
    vectors = measured()
    beside = (vectors["x"].values > BODY * PX) & (vectors["x"].values < (BODY + 14) * PX)
    vectors["u"][:, :, beside] += 0.3 * PX / INTERVAL
    vectors["valid"][:, :4] = 0
    found = score(vectors, truth())
    rows = vectors.sizes["y"]
    assert found["vectors given, %"] == pytest.approx(100 * (rows - 4) / rows)
    assert found["given beside walls, %"] == pytest.approx(100 * (rows - 4) / rows)
    # per component: u alone is wrong
    assert found["RMS error beside walls, px"] == pytest.approx(0.3 / np.sqrt(2), rel=0.02)
    vectors["valid"][:] = 0
    assert score(vectors, truth())["vortices found, %"] == 0


def test_pressure_of_an_accelerated_stream_is_compared():
    count, slope, density = 5, 2.0, 998.2  # m/s²
    exact = truth(count)
    time = exact["time"].values[:, None, None]
    u = slope * time + 0 * exact["u"].values
    p = np.broadcast_to(-density * slope * exact["x"].values, u.shape)
    exact = make_plane(
        exact["x"].values, exact["y"].values, u, 0 * u, time=exact["time"].values, p=p.copy()
    )
    found = score(exact.drop_vars("p"), exact)
    # linear in time and space: the balance's formulas are exact for it
    assert found["RMS error of pressure, % of its RMS"] < 0.1
    assert np.isnan(found["vortices found, %"])


def test_instants_that_do_not_match_are_refused_and_single_ones_found_by_time():
    assert score(measured().isel(time=[1]), truth())["RMS error, px"] < 0.003
    late = measured().isel(time=slice(0, 2))
    with pytest.raises(ValueError, match="2 instants of vectors against 3 of the truth"):
        score(late.assign_coords(time=late["time"] + 0.4 * INTERVAL), truth())
    fast = measured()
    with pytest.raises(ValueError, match="2000 fields per second, the truth 1000"):
        score(fast.assign_coords(time=fast["time"] / 2), truth())


def test_the_command_scores_vectors_of_other_programs(tmp_path, capsys):
    """OpenPIV's text in px; scale, clock and the picture's height are the truth's."""
    write_plane(truth(), tmp_path / "truth.h5")
    vectors = measured(bias=0.2)
    px = {n: vectors[n] * INTERVAL / PX for n in ("u", "v", "u_std", "v_std")}
    vectors = vectors.assign(px).assign_coords({n: vectors[n] / PX for n in "xy"})
    for name in ("x", "y", "u", "v"):
        vectors[name].attrs["units"] = "px"
    at = np.meshgrid(vectors["x"], vectors["y"][::-1])
    files = [tmp_path / f"vectors_{k}.txt" for k in range(3)]
    for k, file in enumerate(files):
        columns = [*at, *(vectors[n][k, ::-1] for n in "uv"), 1 - vectors["valid"][k, ::-1]]
        columns.insert(4, 0 * at[0])
        text = np.column_stack([np.ravel(c) for c in columns])
        np.savetxt(file, text, delimiter="\t", header="x\ty\tu\tv\tflags\tmask")
    table = tmp_path / "score.csv"
    options = ["--truth", str(tmp_path / "truth.h5"), "-o", str(table)]
    units = ["--length-unit", "px", "--velocity-unit", "px/frame", "--y-axis", "up"]
    assert main(["score", *map(str, files), *options, *units]) == 0
    found = pd.read_csv(table, index_col="measure")["value"]
    assert found["bias of u, px"] == pytest.approx(0.2, abs=1e-3)
    assert found["vectors given, %"] == 100
    assert "bias of u, px" in capsys.readouterr().out
    write_plane(vectors.assign_coords(time=np.arange(3.0)), tmp_path / "ours.h5")
    assert main(["score", str(tmp_path / "ours.h5"), *options]) == 0
    assert pd.read_csv(table, index_col="measure")["value"]["bias of u, px"] == pytest.approx(
        0.2, abs=1e-3
    )
    bare = xr.Dataset.copy(truth())
    bare.attrs = {}
    write_plane(bare, tmp_path / "truth.h5")
    assert main(["score", str(tmp_path / "ours.h5"), *options]) == 2
    assert "is in px; give --scale-mm-per-px too" in capsys.readouterr().err
