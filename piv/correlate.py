"""Displacement of a pair of particle images: FFT passes, then Newton steps on deformed images."""

from __future__ import annotations

import cv2
import numpy as np
import xarray as xr

from piv import fft_pass, outliers, refine
from piv.interpolate import PAD, bspline_table, dense_field, warp

VALID, OUTLIER, MASKED, SECOND_PEAK, REPLACED = range(5)
PRESETS = {
    "fast": {"half": 2, "full": 2},
    "balanced": {"half": 3, "full": 3},
    "accurate": {"half": 4, "full": 6},
}


def spline_kernel(lowpass: float = 0.35, taps: int = 13) -> np.ndarray:
    """1-D filter that turns samples into cubic B-spline coefficients of the image smoothed by `lowpass` px."""
    f = np.fft.fftfreq(256)
    response = np.exp(-2 * (np.pi * lowpass * f) ** 2) / ((2 + np.cos(2 * np.pi * f)) / 3)
    kernel = np.fft.fftshift(np.fft.ifft(response).real)[128 - taps // 2 : 128 + taps // 2 + 1]
    return (kernel / kernel.sum()).astype(np.float32)


def _highpass(image: np.ndarray, seen: np.ndarray | None, size: int = 15) -> np.ndarray:
    blur = lambda a: cv2.blur(cv2.blur(a, (size, size)), (size, size))  # noqa: E731
    image = image.astype(np.float32)
    if seen is None:
        return image - blur(image)
    w = seen.astype(np.float32)
    out = image - blur(image * w) / np.maximum(blur(w), 1e-6)
    out[~seen] = 0
    return out


class _Level:
    """One resolution: spline coefficients of both images and where they may be used."""

    def __init__(self, images, seen, factor: int):
        self.factor = factor
        self.shape = images[0].shape
        kernel = spline_kernel()
        self.coefficients = []
        self.usable = []
        for image, ok in zip(images, seen, strict=True):
            c = cv2.sepFilter2D(image, cv2.CV_32F, kernel, kernel, borderType=cv2.BORDER_REFLECT_101)
            self.coefficients.append(cv2.copyMakeBorder(c, PAD, PAD, PAD, PAD, cv2.BORDER_CONSTANT, value=0))
            u = np.ones(self.shape, np.uint8) if ok is None else ok.astype(np.uint8)
            u = cv2.copyMakeBorder(u, PAD, PAD, PAD, PAD, cv2.BORDER_CONSTANT, value=0)
            self.usable.append(cv2.erode(u, np.ones((9, 9), np.uint8)).astype(np.float32))
        self.a = np.empty(self.shape, np.float32)
        self.b = np.empty(self.shape, np.float32)
        self.weight = np.empty(self.shape, np.float32)
        self.dx = np.empty(self.shape, np.float32)
        self.dy = np.empty(self.shape, np.float32)

    def refine(self, x, y, dx, dy, sigma, limit):
        """One Newton step at the nodes (x, y) of the full image; displacement in full pixels."""
        f = self.factor
        rows, columns = self.shape
        nx, ny = (x + 0.5) / f - 0.5, (y + 0.5) / f - 0.5
        px, py = np.arange(columns), np.arange(rows)
        first_x, wx = bspline_table(px, nx[0], nx[1] - nx[0], nx.size)
        first_y, wy = bspline_table(py, ny[0], ny[1] - ny[0], ny.size)
        for knots, out in ((dx, self.dx), (dy, self.dy)):
            dense_field(np.pad(knots, 2, mode="edge").astype(np.float32) / f, first_y, wy, first_x, wx, out)
        warp(self.coefficients[0], self.usable[0], self.dx, self.dy, -0.5, self.a, self.weight, False)
        warp(self.coefficients[1], self.usable[1], self.dx, self.dy, 0.5, self.b, self.weight, True)
        cells = np.empty((refine.MOMENTS, rows // refine.CELL, columns // refine.CELL), np.float32)
        refine.cell_moments(self.a, self.b, self.weight, cells)
        fx, gx = refine.window_weights(nx, cells.shape[2], sigma / f)
        fy, gy = refine.window_weights(ny, cells.shape[1], sigma / f)
        sums = np.empty((refine.MOMENTS, ny.size, nx.size), np.float32)
        refine.window_sums(cells, fy, gy, fx, gx, sums)
        sx, sy, corr = (np.empty((ny.size, nx.size), np.float32) for _ in range(3))
        refine.newton_step(sums, np.float32(limit), sx, sy, corr)
        full = gy.sum(axis=1)[:, None] * gx.sum(axis=1)[None, :] * refine.CELL**2
        self.cells, self.sums = cells, sums
        # the value of the smoothed predictor at the nodes is what the step adds to
        bx, ax = bspline_table(nx, nx[0], nx[1] - nx[0], nx.size)
        by, ay = bspline_table(ny, ny[0], ny[1] - ny[0], ny.size)
        base = []
        for knots in (dx, dy):
            out = np.empty((ny.size, nx.size), np.float32)
            dense_field(np.pad(knots, 2, mode="edge").astype(np.float32), by, ay, bx, ax, out)
            base.append(out)
        return base[0] + sx * f, base[1] + sy * f, corr, sums[8] / full


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
    images = [_highpass(i, s) for i, s in zip((a, b), seen, strict=True)]
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
    low = _Level(half, half_seen, 2)
    for _ in range(settings["half"]):
        dx, dy, corr, share = low.refine(x, y, dx, dy, sigma * 1.2, 1.0)
        r, mu, mv = outliers.normalised_median(dx, dy, share > 0.3, epsilon=0.5)
        dx, dy = outliers.fill_absent(dx, dy, ~(r > 3) & (share > 0.3))
    high = _Level(images, seen, 1)
    for k in range(settings["full"]):
        dx, dy, corr, share = high.refine(x, y, dx, dy, sigma, 1.0)
        r, mu, mv = outliers.normalised_median(dx, dy, share > 0.5, epsilon=epsilon, radius=2)
        bad = r > threshold
        if k < settings["full"] - 1:
            dx, dy = outliers.fill_absent(dx, dy, ~bad & (share > 0.5))
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
            "u_std": (dims, std[up]), "v_std": (dims, std[up]), "correlation": (dims, corr[up]),
        },
        coords={"x": x, "y": (rows - 1 - y)[up]},
    )  # fmt: skip
