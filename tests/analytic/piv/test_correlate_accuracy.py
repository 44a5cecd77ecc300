"""Accuracy of the correlation on rendered particles whose displacement is exact."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from docs.evidence.piv.flows import lamb_oseen, sine
from docs.evidence.piv.flows import uniform as shift
from docs.evidence.piv.particles import render
from docs.evidence.stability import images
from piv.correlation.pair import correlate_pair
from piv.sequence.ensemble import correlate_ensemble
from piv.sequence.multiframe import correlate_frames

SHAPE = (320, 384)
MIDDLE = (191.5, 159.5)


def inner(ds):
    """Vectors whose window is whole."""
    return ds.sel(x=slice(24, SHAPE[1] - 25), y=slice(24, SHAPE[0] - 25))


def rms(ds, flow):
    ds = inner(ds)
    u, v = flow(*np.meshgrid(ds["x"], ds["y"]))
    assert bool(ds["valid"].all())
    return float(np.sqrt(np.mean([(ds["u"].values - u) ** 2, (ds["v"].values - v) ** 2])))


def test_rows_of_pixels_rolled_up_give_positive_v():
    # without any renderer: a pattern moved up by three rows of the array
    image = gaussian_filter(np.random.default_rng(1).normal(size=SHAPE), 1.0, mode="wrap")
    ds = inner(correlate_pair(image, np.roll(image, -3, axis=0)))
    # whole pixels: only the smooth predictor's rest remains
    assert np.allclose(ds["v"], 3, atol=0.01)
    assert np.allclose(ds["u"], 0, atol=0.01)


def test_axes_are_pixel_positions_with_y_up():
    a, b = render(lambda x, y: (0.01 * (y - MIDDLE[1]), 0 * x), shape=SHAPE, seed=22)
    ds = inner(correlate_pair(a, b))
    # u grows with y: a flipped axis turns the sign, an axis off by half a pixel shifts u by 0.005
    # px
    slope, offset = np.polyfit(ds["y"].values - MIDDLE[1], ds["u"].mean("x").values, 1)
    assert slope == pytest.approx(0.01, abs=1e-4)
    assert abs(offset) < 0.003


@pytest.mark.parametrize("fraction", [0.25, 0.5, 0.75])
def test_no_peak_locking(fraction):
    a, b = render(shift(fraction, 1 - fraction), shape=SHAPE, seed=24)
    ds = inner(correlate_pair(a, b))
    assert abs(float(ds["u"].mean()) - fraction) < 0.005  # target of the benchmark
    assert abs(float(ds["v"].mean()) - 1 + fraction) < 0.005


def test_noisy_shift_is_near_the_bound_of_a_32_px_window():
    flow = shift(3.37, -1.71)
    a, b = render(flow, shape=SHAPE, seed=25, noise=0.05)
    assert rms(correlate_pair(a, b), flow) < 0.026  # 1.3 x the Cramér-Rao bound 0.020


def test_steep_vortex_core_is_neither_erased_nor_flagged():
    flow = lamb_oseen(20, 6, MIDDLE)
    a, b = render(flow, shape=SHAPE, seed=26, noise=0.05)
    ds = correlate_pair(a, b)
    r = np.hypot(ds["x"] - MIDDLE[0], ds["y"] - MIDDLE[1]).transpose("y", "x").values
    u, v = flow(*np.meshgrid(ds["x"], ds["y"]))
    core = r < 40
    assert (ds["flag"].values[core] == 0).all()
    error = np.hypot(ds["u"].values - u, ds["v"].values - v)[core]
    # 0.10 is the benchmark's target over seeds; one seed scatters by 30 %
    assert np.sqrt(np.mean(error**2) / 2) < 0.13


def test_waves_as_short_as_the_window_are_followed_or_flagged():
    flow = sine(32, 1)
    a, b = render(flow, shape=SHAPE, seed=51, noise=0.05)
    ds = inner(correlate_pair(a, b))
    u, v = flow(*np.meshgrid(ds["x"], ds["y"]))
    error = np.stack([ds["u"].values - u, ds["v"].values - v])
    std = np.stack([ds["u_std"].values, ds["v_std"].values])
    valid = ds["valid"].values > 0
    # in a 32 px window alone: 0.26 px RMS, 14 % of the vectors wrong by over 0.5 px and all of them
    # called valid
    assert np.sqrt(np.mean(error[:, valid] ** 2)) < 0.15
    # 0.001 is asked of 20,000 vectors, here are 1,500
    assert np.mean(np.hypot(*error)[valid] > 0.5) < 0.005
    assert valid.mean() > 0.9
    # 60-76 % asked; ±4 % of so few windows
    assert 0.55 < np.mean(np.abs(error) < std, where=valid) < 0.80


@pytest.mark.parametrize(
    "window, ppp, noise, seeds, least, most",
    [
        # 68 % is meant, 60-76 % asked; three small images hold about 150 independent windows: ±4 %
        (32, 0.04, 0.05, (27, 28, 29), 0.58, 0.80),
        # eight images scatter by ±0.8 % (2.2 % each), and without the count of cells it is 56 %
        (32, 0.01, 0.05, range(1701, 1709), 0.60, 0.76),
        # small windows: each row's own value is in docs/piv_benchmarks.md
        (16, 0.04, 0.05, (1731, 1732, 1733), 0.72, 0.87),  # the count of cells doubts too much
        (20, 0.04, 0.05, (1731, 1732, 1733), 0.68, 0.84),
        (24, 0.04, 0.05, (1731, 1732, 1733), 0.64, 0.80),
        (24, 0.01, 0.05, (1731, 1732, 1733), 0.58, 0.76),
        (24, 0.04, 0.0, (1731, 1732, 1733), 0.52, 0.68),  # clean: too sure
    ],
)
def test_uncertainty_covers_two_thirds_of_the_errors(window, ppp, noise, seeds, least, most):
    inside = []
    for seed in seeds:
        a, b = render(shift(1.3, 2.6), shape=SHAPE, seed=seed, noise=noise, ppp=ppp)
        ds = inner(correlate_pair(a, b, window=window, smoothing=False))
        inside.append((np.abs(ds["u"] - 1.3) < ds["u_std"]).values[ds["valid"].values > 0].mean())
    assert least < np.mean(inside) < most


def test_small_windows_with_hardly_a_particle_are_mostly_empty():
    """A window with one particle agrees with itself whatever lies between them."""
    flow = shift(1.3, 2.6)
    wrong, given, all_of_them = 0, 0, 0
    for seed in range(1741, 1751):
        a, b = render(flow, shape=SHAPE, seed=seed, noise=0.05, ppp=0.002)
        ds = inner(correlate_pair(a, b, window=24, smoothing=False))
        valid = ds["valid"].values > 0
        wrong += int((np.hypot(ds["u"] - 1.3, ds["v"] - 2.6).values[valid] > 0.5).sum())
        given += int(valid.sum())
        all_of_them += valid.size
    assert wrong < 0.01 * all_of_them  # without the count of cells a third of what is given


def test_large_displacement_and_out_of_plane_loss():
    flow = shift(17.4, -9.2)
    a, b = render(flow, shape=SHAPE, seed=30, noise=0.05, out_of_plane=0.25)
    ds = inner(correlate_pair(a, b))
    e = np.hypot(ds["u"].values - 17.4, ds["v"].values + 9.2)
    assert np.nanmean(e > 0.5) <= 0.001  # outliers left unflagged
    assert np.nanstd(e) < 0.1


def test_five_frames_halve_the_error_at_least():
    flow = shift(3.37, -1.71)
    frames = render(flow, shape=SHAPE, seed=31, noise=0.05, frames=(-2, -1, 0, 1, 2))
    pair = render(flow, shape=SHAPE, seed=31, noise=0.05)
    # a straight-line fit to five instants has 1/4.5 of the noise of two
    assert rms(correlate_frames(frames), flow) < 0.5 * rms(correlate_pair(*pair), flow)


def test_ensemble_of_sparse_images():
    flow = shift(2.3, 1.6)
    pairs = [render(flow, shape=SHAPE, seed=40 + k, ppp=0.005, noise=0.02) for k in range(8)]
    ds = correlate_ensemble(lambda i: (*pairs[i], None), len(pairs))
    alone = correlate_pair(*pairs[0])
    both = inner(alone), inner(ds)
    error = [np.sqrt(np.nanmean((d["u"] - 2.3) ** 2)) for d in both]
    # eight times the particles: the error falls by √8 = 2.8, with a margin for the sparse pair's
    # own outliers
    assert error[1] < 0.55 * error[0]


def test_steep_core_beside_a_moving_body():
    # as behind a finger's tip: a core of 20 px, 0.45 px/px steep, whose edge touches the mask of a
    # body that moves
    wall = 165.0
    flow = lamb_oseen(20, 6, (wall + 20, MIDDLE[1]))
    a, b = render(flow, shape=SHAPE, seed=28, noise=0.02)
    column = np.arange(SHAPE[1])
    masks = [np.broadcast_to(column < wall + side, SHAPE) for side in (-0.5, 0.5)]
    for image, mask in zip((a, b), masks, strict=True):
        image[mask] = 8
    ds = correlate_pair(a, b, mask=tuple(masks))
    x, y = np.meshgrid(ds["x"], ds["y"])
    u, v = flow(x, y)
    near = (np.hypot(x - wall - 20, y - MIDDLE[1]) < 60) & (x > wall)
    error = np.hypot(ds["u"].values - u, ds["v"].values - v)[near & (ds["valid"].values > 0)]
    assert (ds["valid"].values[near] > 0).mean() > 0.93  # the rest lies behind too much of the mask
    # px: a per cent or two of the swirl, asked of the tip vortex
    assert np.sqrt(np.mean(error**2) / 2) < 0.08
    # without another start, vectors at the wall were wrong by up to 5 px and called valid
    assert error.max() < 0.5


@pytest.mark.parametrize("preset", ["fast", "balanced", "accurate"])
def test_pictures_of_other_particles_give_no_field(preset):
    a, b = (render(shift(0, 0), shape=SHAPE, noise=0.05, seed=seed)[0] for seed in (22, 23))
    # 5 %: as many may be called valid by chance; 10 to 16 % were before vectors that stand alone
    # were looked for
    assert float(correlate_pair(a, b, preset=preset)["valid"].mean()) < 0.05


@pytest.mark.parametrize(
    "axis, value, preset",
    [
        ("seeding (ppp)", "0.001", "accurate"),  # 15 % of what was called valid was wrong
        ("exposure (peak over full scale)", "0.02", "accurate"),  # all of it
        ("diameter (px)", "0.5", "balanced"),  # 24 %
        ("special", "no particles, noise", "fast"),
        ("special", "all mask", "fast"),
        ("seeding (ppp)", "0.01", "balanced"),  # and one that must keep its vectors
    ],
)
def test_pictures_at_the_extremes_give_no_plausible_wrong_answer(axis, value, preset):
    case = next(c for c in images.cases() if (c.axis, c.value) == (axis, value))
    row = images.run_case(case, preset)
    # at most 5 % of the valid off by over half a pixel
    ends = {"completed", "all flagged"} | ({"refused"} if axis == "special" else set())
    assert row["ended"] in ends, row
    if value == "0.01":
        assert row["valid"] > 0.98


def test_what_is_not_known_well_enough_is_kept_but_not_valid():
    a, b = render(shift(2.3, 1.6), shape=SHAPE, seed=52, noise=0.2)
    all_of_them, sure = (correlate_pair(a, b, max_std=s) for s in (10.0, 0.1))
    std = np.maximum(all_of_them["u_std"], all_of_them["v_std"]).values
    assert 0.2 < (sure["valid"] > 0).values.mean() < (all_of_them["valid"] > 0).values.mean()
    assert (std[sure["valid"].values > 0] <= 0.1).all()
    doubted = std > 0.1
    # those that stand alone among doubted neighbours are outliers
    assert np.isin(sure["flag"].values[doubted], (1, 5)).all()
    kept = sure["flag"].values == 5
    assert kept[doubted & (all_of_them["valid"].values > 0)].mean() > 0.9
    assert np.isfinite(sure["u"].values[kept]).all()


@pytest.mark.parametrize("window", [32, 16])
def test_painted_areas_hold_no_vector(window):
    flow = shift(3.2, -1.7)
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]]
    painted = np.hypot(row - 160, column - 150) < 90
    painted |= np.abs(column - 320) < 15  # a band of the width of a window
    images = render(flow, shape=SHAPE, seed=61, noise=0.05)
    ds = correlate_pair(*(np.where(painted, 0, i).astype(i.dtype) for i in images), window=window)
    at = np.ix_(*(np.rint(p.values).astype(int) for p in (SHAPE[0] - 1 - ds["y"], ds["x"])))
    valid = ds["valid"].values > 0
    error = np.hypot(ds["u"].values - 3.2, ds["v"].values + 1.7)
    # asked: 0.1 % of the area; a third of it was valid and wrong, dragged along by the disc's own
    # edge
    assert not (valid & (error > 0.5))[painted[at]].any()
    # the edge's vectors beside it too: 0.033 px, and 0.062 px with windows of 16 px, where the disc
    # was not recognised
    assert np.sqrt(np.mean(error[valid] ** 2) / 2) < (0.022 if window == 32 else 0.04)


@pytest.mark.parametrize("diameter, most", [(1.6, 0.006), (1.2, 0.015)])
def test_bias_of_particles_below_two_pixels_is_small_and_covered(diameter, most):
    biases, covered = [], []
    for part in (0.2, 0.4, 0.75):
        flow = shift(2 + part, -1 + part)
        ds = correlate_pair(*render(flow, shape=SHAPE, seed=74, diameter=diameter))
        error = np.stack([ds["u"] - 2 - part, ds["v"] + 1 - part])
        biases += list(np.nanmean(error, axis=(1, 2)))
        covered.append(np.abs(error) < np.stack([ds["u_std"], ds["v_std"]]))
    # asked 0.005 and 0.012 px; 0.009 and 0.023 px where folded power is not counted as noise. One
    # picture's mean errs by 0.001 px
    assert np.abs(biases).max() < most
    assert 0.55 < np.mean(covered) < 0.85  # asked 0.60 to 0.76; 0.42 to 0.50 before
