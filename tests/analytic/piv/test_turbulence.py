"""Planes of three-dimensional turbulence: smoothing, window sizes, uncertainty."""

from functools import cache

import numpy as np
import pytest

from docs.evidence.piv.flows import TurbulentPlane
from docs.evidence.piv.particles import render
from docs.evidence.piv.turbulence import derivatives
from piv.correlation.pair import correlate_pair
from piv.fields.derived import derived
from piv.formats.plane_series import usable

SHAPE = (512, 640)
EDGE = 24
SEED = 4101  # served no tuning


@cache
def plane() -> TurbulentPlane:
    return TurbulentPlane(1.0, SEED)


@cache
def pair(rms: float, noise: float):
    return render(
        lambda x, y: tuple(rms * d for d in plane()(x, y, 3)), shape=SHAPE, seed=SEED, noise=noise
    )


def errors(rms: float, noise: float, **options):
    """Errors (2, ny, nx), standard uncertainties and flags away from the edges."""
    ds = correlate_pair(*pair(rms, noise), **options)
    ds = ds.sel(x=slice(EDGE, SHAPE[1] - 1 - EDGE), y=slice(EDGE, SHAPE[0] - 1 - EDGE))
    u, v = plane()(*np.meshgrid(ds["x"], ds["y"]))
    e = np.stack([ds["u"].values - rms * u, ds["v"].values - rms * v])
    return e, np.stack([ds["u_std"].values, ds["v_std"].values]), ds["flag"].values


def size(e: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(e**2)))


def test_divergence_has_a_fifth_of_the_mean_square_of_vorticity():
    x, y = np.meshgrid(np.arange(0, 1900, 9.0), np.arange(0, 1500, 9.0))
    h = 0.5
    (ux, vx), (uy, vy) = (
        [
        (b - a) / (2 * h)
        for a, b in zip(
        plane()(x - i * h, y - j * h), plane()(x + i * h, y + j * h), strict=True
        )
        ]
        for i, j in ((1, 0), (0, 1))
    )  # fmt: skip
    # 0.2 exactly in the mean; one plane of 2000 px scatters by a few per cent
    assert np.mean((ux + vy) ** 2) / np.mean((vx - uy) ** 2) == pytest.approx(0.2, rel=0.1)


@pytest.mark.parametrize("rms, noise", [(0.8, 0.05), (0.3, 0.05), (0.8, 0.01), (0.3, 0.01)])
def test_smoothing_helps_and_the_uncertainty_holds(rms, noise):
    smooth, std, _ = errors(rms, noise)
    plain, _, _ = errors(rms, noise, smoothing=False)
    # 0.970, 0.973, 0.992 and 0.973 of it; without smoothing it would be 1
    assert size(smooth) < 0.995 * size(plain)
    cover = np.mean((np.abs(smooth) < std)[np.isfinite(smooth)])
    assert 0.58 < cover < 0.80  # 60 to 76 % of whole planes; one picture scatters by ±2 %


@pytest.mark.parametrize("window", [24, 32, 48])
def test_the_uncertainty_holds_in_strong_turbulence(window):
    e, std, _ = errors(2.5, 0.03, window=window)
    # 70 to 73 % with 32 px on whole planes of seeds 7001-7003, 67 to 72 % in the others' pictures;
    # what lies below the window was left out: 52 % with 24 px, 41 % with 48
    assert 0.6 < np.mean((np.abs(e) < std)[np.isfinite(e)]) < 0.80


def test_a_divergence_as_weak_as_the_noise_is_kept():
    ds = correlate_pair(*pair(0.3, 0.05))
    true = (0.3 * f for f in plane()(*np.meshgrid(ds["x"], ds["y"])))
    seen, exact = (derivatives(*f, 8) for f in ((ds["u"].values, ds["v"].values), true))
    near = np.s_[3:-3, 3:-3]
    pairs = ((a[near], b[near]) for a, b in zip(seen, exact, strict=True))
    divergence, vorticity = (np.sum(a * b) / np.sum(b**2) for a, b in pairs)
    # 0.80 of whole planes, of this one 0.75 or more; the filter of least error keeps 0.68 of it
    assert divergence > 0.75
    # of the true value: what smoothing takes from the one it takes from the other
    assert abs(divergence - vorticity) < 0.1


@pytest.mark.parametrize("noise, gain", [(0.05, 1.25), (0.01, 2.0)])
def test_smaller_windows_err_less(noise, gain):
    adapted, fixed = (size(errors(0.8, noise, least_window=side)[0]) for side in (12, 32))
    assert fixed > gain * adapted  # 1.4 and 2.2 on the seeds of tuning


def test_strong_turbulence_is_not_emptied():
    e, _, flag = errors(2.5, 0.01)
    # 25 to 32 % are absent with one window and without uncertain vectors
    assert np.mean(np.isnan(e[0])) < 0.05
    assert size(e) < 0.3  # 0.45 px is what peers reach
    # `max_std` is chosen for it: 2.5 % with 0.3 px of uncertainty allowed
    assert np.mean(np.hypot(*e)[flag == 0] > 0.5) < 0.02


@pytest.mark.parametrize("noise, flagged", [(0.01, 0.2), (0.05, 0.35)])
def test_what_is_computed_of_strong_turbulence_is_the_whole_flow(noise, flagged):
    ds = correlate_pair(*pair(2.5, noise))
    ok, sure = usable(ds), ds["valid"] != 0
    assert (ok & ~sure).mean() > flagged  # 24 and 41 %
    vorticity = derived(ds, ("vorticity",))["vorticity"]
    alone = derived(ds.drop_vars("flag"), ("vorticity",))["vorticity"]
    assert np.isfinite(vorticity).mean() > 0.9  # 95 and 97 %
    # 68 and 49 %: that far the holes are of uncertain vectors
    assert np.isfinite(alone).mean() < 0.75
    true = 2.5 * np.array(plane()(*np.meshgrid(ds["x"], ds["y"])))
    rms = np.sqrt(np.mean([ds[n].where(ok).values ** 2 for n in ("u", "v")], where=ok.values))
    # 0.1 and 0.3 %; 2 % too large without those that are uncertain
    assert rms == pytest.approx(np.sqrt(np.mean(true**2)), rel=0.01)
