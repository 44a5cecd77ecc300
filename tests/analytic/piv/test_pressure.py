"""Pressure from vectors against exact flows, with noise; loads on a moving body."""

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr
from scipy.ndimage import gaussian_filter
from scipy.special import exp1

import piv
from piv.__main__ import main
from piv.formats.plane_series import NO_PICTURE, make_plane, read_plane, write_plane
from piv.momentum.pressure import Balance, _errors, _two_variances, border_of, scatter

RHO = 998.2  # kg/m³
GRID = np.arange(-0.04, 0.0401, 1e-3)  # m
TIMES = np.arange(9) * 4e-3  # s
MIDDLE = 4
# m, m, 1/s: the cylinder moves 0.5 mm a field
RADIUS, AMPLITUDE, OMEGA = (0.01, 0.01, 2 * np.pi * 2.0)
ABOUT = (0.0, 0.02)  # m


WINDOW = 1  # grid steps: of one, errors are independent


def noisy(u, v, ok, noise: float, seed: int, **more) -> xr.Dataset:
    """A series with normal errors of size `noise` (m/s), which neighbours in a window share."""
    rng = np.random.default_rng(seed)
    errors = [rng.standard_normal(f.shape) for f in (u, v)]
    if WINDOW > 1:
        width = (0, WINDOW / np.sqrt(8), WINDOW / np.sqrt(8))
        errors = [(e := gaussian_filter(f, width, mode="wrap")) / e.std() for f in errors]
    u, v = (np.where(ok, f + noise * e, np.nan) for f, e in zip((u, v), errors, strict=True))
    std = np.full(u.shape, noise)
    made = make_plane(GRID, GRID, u, v, time=TIMES, valid=ok, u_std=std, v_std=std, **more)
    return made.assign_attrs(settings=f'{{"window": {8 * WINDOW}}}', scale_mm_per_px=0.125)


def vortex(seed: int) -> tuple[xr.Dataset, np.ndarray]:
    """A Lamb-Oseen vortex of 80 cm²/s that drifts at 0.1 m/s, 1 % noise; its pressure (Pa)."""
    strength, core, drift = 8e-3, 5e-3, (0.1, 0.03)
    x, y = np.meshgrid(GRID, GRID)
    u, v, p = [], [], []
    for time in TIMES - TIMES[MIDDLE]:
        dx, dy = x - drift[0] * time, y - drift[1] * time
        r2 = np.maximum(dx**2 + dy**2, 1e-12)
        size = core**2 + 4 * 1.004e-6 * time
        turn = strength / (2 * np.pi * r2) * (1 - np.exp(-r2 / size))
        u.append(drift[0] - turn * dy)
        v.append(drift[1] + turn * dx)
        # p(r) = -rho ∫_r^∞ v²/s ds
        q = r2 / size
        depth = (1 - np.exp(-q)) ** 2 / q + 2 * exp1(q) - 2 * exp1(2 * q)
        p.append(-RHO * strength**2 / (8 * np.pi**2 * size) * depth)
    noise = 0.01 * 0.638 * strength / (2 * np.pi * core)  # of the largest turning velocity
    u, v, p = map(np.array, (u, v, p))
    return noisy(u, v, np.ones(u.shape, bool), noise, seed), p[MIDDLE]


def cylinder(seed: int) -> tuple[xr.Dataset, np.ndarray]:
    """An oscillating cylinder in a perfect fluid, 1 % noise, with outline; its pressure (Pa)."""
    x, y = np.meshgrid(GRID, GRID)
    angle = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    u, v, p, outline, speed = [], [], [], [], []
    for time in TIMES + 0.06:
        place, rate = AMPLITUDE * np.sin(OMEGA * time), AMPLITUDE * OMEGA * np.cos(OMEGA * time)
        dx, rise = x - place, -AMPLITUDE * OMEGA**2 * np.sin(OMEGA * time)
        r2 = dx**2 + y**2
        a = -rate * RADIUS**2 * (1 / r2 - 2 * dx**2 / r2**2)
        b = 2 * rate * RADIUS**2 * dx * y / r2**2
        p.append(-RHO * (-rise * RADIUS**2 * dx / r2 - rate * a + 0.5 * (a**2 + b**2)))
        u.append(a)
        v.append(b)
        outline.append([place, 0] + RADIUS * np.column_stack([np.cos(angle), np.sin(angle)]))
        speed.append(np.column_stack([np.full(240, rate), np.zeros(240)]))
    u, v, p = map(np.array, (u, v, p))
    ok = np.array([np.hypot(x - o.mean(axis=0)[0], y) > RADIUS for o in outline])
    more = {"outline": np.array(outline)[:, None], "outline_velocity": np.array(speed)[:, None]}
    exact = np.where(ok[MIDDLE], p[MIDDLE], np.nan)
    return noisy(u, v, ok, 0.01 * AMPLITUDE * OMEGA, seed, **more), exact


@pytest.mark.parametrize("flow", [vortex, cylinder])
def test_pressure_of_an_exact_flow_with_noise(flow: Callable) -> None:
    """Within 5 % of its standard deviation; the 95 % band covers. Seeds that served no tuning."""
    errors, covered = [], []
    for seed in (71, 72):
        series, exact = flow(seed)
        found = Balance(series, RHO, 0.0 if flow is cylinder else 1.004e-6, ABOUT).at(MIDDLE)
        off = found["p"] - exact
        edge = np.concatenate([off[[0, -1]].ravel(), off[:, [0, -1]].ravel()])
        off = off - np.nanmean(edge)
        known = np.isfinite(off)
        assert np.mean(known[np.isfinite(exact)]) > 0.98  # beside the body no vector need have one
        errors.append(np.sqrt(np.mean(off[known] ** 2)) / np.nanstd(exact))
        covered.append(np.mean(np.abs(off[known]) < 1.96 * found["p_std"][known]))
        # a share of p is systematic: 3.2 to 4.5 times the errors here
        assert np.sqrt(np.mean(found["p_std"][known] ** 2)) < 5 * errors[-1] * np.nanstd(exact)
    assert max(errors) < 0.05  # 2.8 and 2.7 % here; 5 % is what a user is promised
    assert np.mean(covered) > 0.88


@pytest.mark.parametrize("flow", [vortex, cylinder])
def test_errors_that_neighbours_share_at_a_high_rate(flow: Callable, monkeypatch) -> None:
    """At 1 kHz noise of 1 % is averaged over many fields: it was 95 % of p and more."""
    for name, value in (("WINDOW", 4), ("TIMES", np.arange(33) * 1e-3), ("MIDDLE", 16)):
        monkeypatch.setitem(globals(), name, value)
    for seed in (77, 78):
        series, exact = flow(seed)
        found = Balance(series, RHO, 0.0 if flow is cylinder else 1.004e-6, ABOUT).at(MIDDLE)
        off = found["p"] - exact
        off = off - np.nanmean(off[[0, -1]])
        # 12 %: 2.5 to 11 % in 12 flows drawn beside these
        assert np.nanstd(off) < 0.12 * np.nanstd(exact)
        known = np.isfinite(off)
        # 94 to 100 % here; 89 % was the least of those 12
        assert np.mean(np.abs(off[known]) < 1.96 * found["p_std"][known]) > 0.88


def test_loads_on_an_oscillating_cylinder() -> None:
    """Force: that of its added mass, rho pi R² per length (Lamb, Hydrodynamics, § 68)."""
    series, _ = cylinder(73)
    found = Balance(series, RHO, 0.0, ABOUT).at(MIDDLE)
    rise = -AMPLITUDE * OMEGA**2 * np.sin(OMEGA * (TIMES[MIDDLE] + 0.06))
    force = -RHO * np.pi * RADIUS**2 * rise
    # 1 % here; 8 %: slip makes the gradient at this wall another than that of a wall with a
    # boundary layer
    np.testing.assert_allclose(found["line_force"][0, 0], force, rtol=0.08)
    assert abs(found["line_force"][0, 1]) < 0.08 * force
    # its line of action is the axis, ABOUT lies 0.02 m above it
    np.testing.assert_allclose(found["line_moment"][0], 0.02 * found["line_force"][0, 0], rtol=0.08)
    # 3 %: of the exact pressure, extrapolated over half a grid step to the wall
    known = piv.line_loads(series.assign(p=(("time", "y", "x"), _exact(series))), ABOUT, RHO)
    np.testing.assert_allclose(known["line_force"].values[MIDDLE, 0, 0], force, rtol=0.03)


def test_a_body_that_leaves_the_view_has_no_loads() -> None:
    """Its pressure is known on the part that is seen, its force and moment are not."""
    series = cylinder(75)[0].isel(x=slice(0, 40), time=slice(3, 6))  # x up to the body's middle
    found = Balance(series, RHO, 0.0, ABOUT).at(1)
    seen = np.isfinite(found["p_outline"][0])
    assert 0 < seen.sum() < seen.size
    assert np.isnan(found["line_moment"]).all()


@pytest.mark.parametrize("seen", [[2], [0, 1, 3, 4]])
def test_an_instant_without_vectors_or_without_neighbours_is_named(seen: list[int]) -> None:
    """At the middle of five fields: alone, and absent while the others are there."""
    series = vortex(79)[0].isel(time=slice(0, 5))
    series = series.where(series["time"].isin(series["time"][seen]))
    with pytest.raises(ValueError, match=r"no pressure at 0\.008 s: too few usable vectors"):
        Balance(series.assign(valid=series["valid"].fillna(0)), RHO, 0.0, ABOUT).at(2)


def _exact(series: xr.Dataset) -> np.ndarray:
    """The exact pressure of the middle instant in the place of all."""
    return np.broadcast_to(cylinder(0)[1], series["u"].shape)


def test_a_uniform_acceleration_also_at_the_ends() -> None:
    """A uniform acceleration: p falls by a straight line, exactly, also at the first instant."""
    u = np.broadcast_to(0.3 + 2.0 * TIMES[:, None, None], (9, 81, 81))
    series = make_plane(GRID, GRID, u, 0 * u, time=TIMES)
    for k in (0, 8):
        p = Balance(series, RHO, 0.0, ABOUT).at(k)["p"]
        # rounding of splu with the weak spring of the free constant
        np.testing.assert_allclose(np.diff(p, axis=1), -RHO * 2.0 * 1e-3, rtol=1e-4)


def test_an_acceleration_that_sets_in_is_not_smoothed() -> None:
    """Noise may be averaged over time only as far as the pressure of the whole view allows it."""
    growth, noise = 0.012, 2e-3  # s, m/s: noise in a slope over 3 fields is a fifth of the slope
    u = 2.0 * (TIMES + growth * np.exp(-TIMES / growth))[:, None, None] + np.zeros((9, 81, 81))
    series = noisy(u, 0 * u, np.ones(u.shape, bool), noise, 76)
    for k in (2, 4):
        p = Balance(series, RHO, 0.0, ABOUT).at(k)["p"]
        slope = float(np.mean(p[:, -1] - p[:, 0]) / np.ptp(GRID))
        # 3 and 2 %, which central differences miss; 7 % with the noise of single vectors
        exact = -RHO * 2.0 * (1 - np.exp(-TIMES[k] / growth))
        assert slope == pytest.approx(exact, rel=0.04)


def test_the_command_writes_what_the_function_gives(tmp_path, capsys) -> None:
    """One file with vectors, pressure, loads, and what they are relative to."""
    series = piv.derived(cylinder(74)[0].isel(time=slice(3, 6)), ("vorticity",))
    write_plane(series, tmp_path / "x.h5")
    output = ["-o", str(tmp_path / "p.h5"), "--about", "0", "0.02"]
    assert main(["pressure", str(tmp_path / "x.h5"), *output]) == 0
    assert "does not cross the light sheet" in capsys.readouterr().out
    with read_plane(tmp_path / "p.h5") as written:
        assert list(written.attrs["moment_about"]) == [0.0, 0.02]
        assert "acceleration" in written.attrs["pressure_boundary"]
        own = piv.pressure(series, about=(0.0, 0.02))
        assert set(written.variables) == set(own.variables)
        assert written["p"].attrs["units"] == own["p"].attrs["units"] == "Pa"
        for name, values in own.items():
            np.testing.assert_array_equal(written[name], values, err_msg=str(name))


@pytest.mark.parametrize(
    "change, word",
    [
        (lambda s: s.isel(time=slice(0, 2)), "3 fields"),
        (lambda s: s.assign_coords(x=s["x"].assign_attrs(units="px")), "calibrate"),
        (lambda s: s.assign(outline=s["outline"] + 1.0), "in the view"),
    ],
)
def test_what_cannot_have_a_pressure_is_refused(change: Callable, word: str) -> None:
    """In one sentence that says why."""
    with pytest.raises(ValueError, match=word):
        piv.pressure(change(cylinder(0)[0].isel(time=slice(0, 3))))


def test_sampled_errors_are_correlated_over_the_stated_length() -> None:
    """exp(-2 (d/length)²): 0.61 at half of the length, 0.14 at the length."""
    found = _errors(3, (40, 128, 128), 8.0)
    np.testing.assert_allclose(np.mean(found**2, axis=(1, 2)), 1.0, rtol=1e-5)
    for apart in (4, 8):
        correlation = np.mean(found[..., apart:] * found[..., :-apart])
        # 0.02: forty fields of 256 independent places each are known to 0.01
        assert abs(correlation - np.exp(-2 * (apart / 8.0) ** 2)) < 0.02


def without(series: xr.Dataset, k: int) -> xr.Dataset:
    """The series with the picture of instant `k` lost."""
    flag = np.zeros(series["u"].shape, np.uint8)
    flag[k] = NO_PICTURE
    there = xr.DataArray(flag == 0, dims=series["u"].dims)
    lost = {name: series[name].where(there) for name in ("u", "v")}
    more = {"valid": series["valid"] * there, "flag": (series["u"].dims, flag)}
    return series.assign(lost | more)


def test_the_scatter_about_an_absent_instant_is_that_of_others() -> None:
    """Of noise of 0.01 m/s; a field that is lost has no second difference."""
    still = np.zeros((len(TIMES), len(GRID), len(GRID)))
    series = noisy(still, still, np.ones(still.shape, bool), 0.01, 5)
    for k in (3, 4):  # 3 %: a median of 6,561 differences of three fields
        np.testing.assert_allclose(scatter(without(series, 3), k), 0.01, rtol=0.03)


def test_two_variances_in_a_mean_square_are_told_apart() -> None:
    rng = np.random.default_rng(4)
    parts = [1 + rng.random(20_000), rng.random(20_000)]
    for wanted in ([2.0, 3.0], [0.0, 3.0], [2.0, 0.0]):
        squares = sum(w * part for w, part in zip(wanted, parts, strict=True))
        np.testing.assert_allclose(_two_variances(squares, parts, parts), wanted, atol=1e-9)
    # of two parts that are alike the first has all
    np.testing.assert_allclose(_two_variances(3 * parts[0], [parts[0]] * 2, parts), [3.0, 0.0])
    # none is negative
    np.testing.assert_array_equal(_two_variances(parts[0] - parts[1], parts, parts)[1], 0.0)


def test_the_border_is_the_outermost_rows_and_columns_with_points() -> None:
    points = np.zeros((6, 7), bool)
    points[1:5, 2:6] = True
    inner = np.zeros_like(points)
    inner[2:4, 3:5] = True
    np.testing.assert_array_equal(border_of(points) & points, points & ~inner)


def test_an_absent_instant_has_no_loads_either() -> None:
    series, _ = cylinder(73)
    found = piv.pressure(without(series, MIDDLE), density=RHO, viscosity=0.0, about=ABOUT)
    for name in ("p", "p_outline", "line_force", "line_moment"):
        assert np.isnan(found[name].values[MIDDLE]).all(), name
        assert np.isfinite(found[name].values[MIDDLE - 2]).any(), name
