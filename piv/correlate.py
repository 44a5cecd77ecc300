"""Displacement of a pair of particle images: FFT passes, then Newton steps on deformed images."""

from __future__ import annotations

import cv2
import numpy as np
import xarray as xr

from piv import fft_pass, outliers, prefilter
from piv.deform import Level

VALID, OUTLIER, MASKED, SECOND_PEAK, REPLACED = range(5)
PRESETS = {
    "fast": {"half": 2, "full": 2},
    "balanced": {"half": 3, "full": 3},
    "accurate": {"half": 4, "full": 6},
}


REF = (0,)
SM = None
LOG = None


def _grid(length: int, spacing: float) -> np.ndarray:
    n = int(length // spacing)
    return (length - 1 - (n - 1) * spacing) / 2 + spacing * np.arange(n)


def _resample(x, y, field, new_x, new_y):
    """Bilinear values of a grid at new coordinates, held constant outside."""
    jx = np.clip(np.interp(new_x, x, np.arange(x.size)), 0, x.size - 1)
    jy = np.clip(np.interp(new_y, y, np.arange(y.size)), 0, y.size - 1)
    x0 = np.minimum(jx.astype(int), max(x.size - 2, 0))
    y0 = np.minimum(jy.astype(int), max(y.size - 2, 0))
    x1, y1 = np.minimum(x0 + 1, x.size - 1), np.minimum(y0 + 1, y.size - 1)
    tx, ty = (jx - x0)[None, :], (jy - y0)[:, None]
    f = field
    top = f[np.ix_(y0, x0)] * (1 - tx) + f[np.ix_(y0, x1)] * tx
    low = f[np.ix_(y1, x0)] * (1 - tx) + f[np.ix_(y1, x1)] * tx
    return (top * (1 - ty) + low * ty).astype(np.float32)


def correlate_pair(
    a,
    b,
    *,
    window: float = 32,
    spacing: int = 8,
    preset: str = "balanced",
    mask=None,
    epsilon: float = 0.2,
    threshold: float = 3.0,
) -> xr.Dataset:
    """Displacement of the particles from image `a` to image `b` on a regular grid, in pixels."""
    a, b = np.asarray(a), np.asarray(b)
    if a.ndim != 2 or b.ndim != 2:
        raise ValueError(f"images must be 2-D grey values, got shapes {a.shape} and {b.shape}; convert colour images first")
    if a.shape != b.shape:
        raise ValueError(f"the two images must have the same shape, got {a.shape} and {b.shape}")
    if preset not in PRESETS:
        raise ValueError(f"preset must be one of {', '.join(PRESETS)}, got {preset!r}")
    rows, columns = a.shape
    seen = [None, None]
    if mask is not None:
        seen = [~np.asarray(mask, bool)] * 2
    images = [prefilter.remove_background(i, s) for i, s in zip((a, b), seen, strict=True)]
    scale = np.sqrt(np.mean(images[0] ** 2) + np.mean(images[1] ** 2))
    images = [i / scale for i in images]
    half = [cv2.resize(i, (columns // 2, rows // 2), interpolation=cv2.INTER_AREA) for i in images]
    half_seen = [
        None if s is None else cv2.resize(s.astype(np.uint8), (columns // 2, rows // 2), interpolation=cv2.INTER_AREA) > 0
        for s in seen
    ]
    # FFT passes at half resolution
    px, py, dx, dy = None, None, None, None
    for size in (64, 32):
        gx, gy = _grid(columns // 2, size // 2), _grid(rows // 2, size // 2)
        gx, gy = np.rint(gx).astype(np.int64), np.rint(gy).astype(np.int64)
        if dx is None:
            sx, sy = np.zeros((gy.size, gx.size)), np.zeros((gy.size, gx.size))
        else:
            sx, sy = _resample(px, py, dx, gx, gy), _resample(px, py, dy, gx, gy)
        cx, cy = np.meshgrid(gx, gy)
        reach = 3 * size // 8 if dx is None else size // 4
        out = fft_pass.correlate_windows(half[0], half[1], cx.ravel(), cy.ravel(), sx.ravel(), sy.ravel(), size, reach)
        dx, dy = out["dx"].reshape(cx.shape), out["dy"].reshape(cx.shape)
        r, mu, mv = outliers.normalised_median(dx, dy, np.ones(dx.shape, bool), epsilon=0.3)
        good = ~(r > 3)
        dx, dy = outliers.fill_absent(dx, dy, good)
        px, py = gx, gy
    x, y = _grid(columns, spacing), _grid(rows, spacing)
    dx = 2 * _resample(2 * px + 0.5, 2 * py + 0.5, dx, x, y)
    dy = 2 * _resample(2 * px + 0.5, 2 * py + 0.5, dy, x, y)
    settings = PRESETS[preset]
    sigma = window / np.sqrt(4 * np.pi)
    kernel = prefilter.kernel(prefilter.default_response(prefilter.radial_frequency()))
    low = Level(half, half_seen, 2, kernel, x, y)
    for _ in range(settings["half"]):
        low.warp(dx, dy)
        m = low.measure(dx, dy, sigma * 1.2, 1.0)
        r, _, _ = outliers.normalised_median(m.dx, m.dy, m.share > 0.3, epsilon=0.5)
        dx, dy = outliers.fill_absent(m.dx, m.dy, ~(r > 3) & (m.share > 0.3))
    high = Level(images, seen, 1, kernel, x, y)
    response = prefilter.default_response(prefilter.radial_frequency())
    for k in range(settings["full"]):
        high.warp(dx, dy)
        m = high.measure(dx, dy, sigma, 1.0)
        r, _, _ = outliers.normalised_median(m.dx, m.dy, m.share > 0.5, epsilon=epsilon, radius=2)
        bad = r > threshold
        if k < settings["full"] - 1:
            dx, dy = outliers.fill_absent(m.dx, m.dy, ~bad & (m.share > 0.5))
        if k in REF:
            f, S, N = prefilter.measure_spectra(high.a, high.b, high.weight)
            now = np.interp(f, prefilter.radial_frequency()[0], response[0])**2
            ok = f < 0.5
            global LOG
            LOG = f, S, N
            response = prefilter.optimal_response(f[ok], (S/now)[ok], (N/now)[ok])
            high.set_kernel(prefilter.kernel(response))
    from piv.deform import smooth
    from piv.uncertainty import correlation_statistics
    vx, vy = correlation_statistics(high, m, m.dx - smooth(dx), m.dy - smooth(dy), sigma)
    corr, share = m.correlation, m.share
    dx, dy = m.dx, m.dy
    if SM:
        from piv.smooth import adaptive, noise_shares
        e, l, gain = noise_shares(SM[0], sigma / spacing, 4)
        vx, vy = vx * gain * SM[2], vy * gain * SM[2]
        known = ~bad & (share > 0.5)
        dx, dy, vx, vy = adaptive(dx, dy, vx, vy, known, (e, l), sigma=SM[0], strictness=SM[1])
    if SM and SM[3]:
        e, l, gain = noise_shares(SM[3], sigma / spacing, 4)
        dx, dy, vx, vy = adaptive(dx, dy, vx, vy, known, (e, l), sigma=SM[3], strictness=SM[1])
    flag = np.zeros(dx.shape, np.uint8)
    flag[bad] = OUTLIER
    flag[share < 0.5] = MASKED
    ok = flag == VALID
    u, v = np.where(ok, dx, np.nan), np.where(ok, -dy, np.nan)
    dims = ("y", "x")
    std = np.where(ok, 0.05, np.nan)
    up = slice(None, None, -1)
    return xr.Dataset(
        {
            "u": (dims, u[up]), "v": (dims, v[up]), "valid": (dims, ok[up].astype(np.uint8)), "flag": (dims, flag[up]),
            "u_std": (dims, np.sqrt(vx)[up]), "v_std": (dims, np.sqrt(vy)[up]), "correlation": (dims, corr[up]),
        },
        coords={"x": x, "y": (rows - 1 - y)[up]},
    )  # fmt: skip
