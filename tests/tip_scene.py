"""An analytic tip vortex beside a masked finger, with feeding and boundary layers."""

import numpy as np
import xarray as xr
from scipy import ndimage

from piv.formats.plane_series import make_plane
from piv.vortices.lamb_oseen_fit import lamb_oseen

HALF_WIDTH = 6e-3


def tip_scene(
    step: float,
    core: float,
    gap: float,
    *,
    circulation: float = 0.01,
    blur: float = 0.0,
    noise: float = 0.0,
    seed: int = 4,
) -> tuple[xr.Dataset, tuple[float, float]]:
    """Plane (m, m/s) of grid spacing `step`; the vortex is `gap` core radii off the finger.

    Feeding layer: 35 % of the circulation spread along a curve from the tip; boundary layer: -30 %
    along the side. `blur` (standard deviation, m) and correlated `noise` (m/s) make it PIV-like;
    vectors at the wall are then absent.
    """
    x, y = np.arange(-0.06, 0.06 + step / 2, step), np.arange(-0.05, 0.05 + step / 2, step)
    xx, yy = np.meshgrid(x, y)
    body = ((np.abs(xx) < HALF_WIDTH) & (yy > 0)) | (xx**2 + yy**2 < HALF_WIDTH**2)
    cx, cy = HALF_WIDTH + gap * core, 4e-3
    blobs = [(cx, cy, circulation, core)]
    for s in np.linspace(0, 1, 30):
        px = 0.3 * HALF_WIDTH + s * (cx + 0.5 * core - 0.3 * HALF_WIDTH)
        py = -HALF_WIDTH - 2e-3 * np.sin(np.pi * s) + s * (cy - 2 * core + HALF_WIDTH + 1e-3)
        blobs.append((px, py, 0.35 * circulation / 30, 1.5e-3))
    blobs += [
        (HALF_WIDTH + 1e-3, 0.03 * s, -0.3 * circulation / 40, 1.2e-3)
        for s in np.linspace(0, 1, 40)
    ]
    u, v = np.full(xx.shape, 0.05), np.full(xx.shape, -0.03)
    for blob in blobs:
        du, dv = lamb_oseen(xx, yy, *blob)
        u, v = u + du, v + dv
    ok = ~body
    if blur:
        part = ndimage.gaussian_filter(ok.astype(float), blur / step)
        u, v = (
            ndimage.gaussian_filter(np.where(ok, f, 0), blur / step) / np.maximum(part, 1e-9)
            for f in (u, v)
        )
        ok &= part > 0.5
    if noise:
        rng = np.random.default_rng(seed)
        for f in (u, v):
            e = ndimage.gaussian_filter(rng.normal(size=f.shape), 1.0)
            f += noise * e / e.std()
    return make_plane(x, y, np.where(ok, u, np.nan), np.where(ok, v, np.nan)), (cx, cy)


def young_scene(
    step: float,
    *,
    core: float = 2.4e-3,
    gap: float = 0.1,
    layer_part: float = 0.3,
    hidden: float = 0.0,
    noise: float = 0.0,
    seed: int = 0,
) -> tuple[xr.Dataset, float, float]:
    """Plane (m, m/s) of a vortex near the wall x = 0, its circulation with layer, its core radius.

    The centre is `gap` core radii off the wall, a tenth: the body hides nearly half of it; along
    the wall lies the layer that feeds it, `layer_part` of its circulation. `hidden` (m): vectors
    nearer to the wall are absent, as in PIV; `noise` (m/s), correlated as windows that overlap,
    twice as large at the wall; `seed` also shifts the grid.
    """
    circulation = 5e-3 * core / 2.4e-3
    shift = seed * 1e-4  # the grid lies anyhow to the vortex
    x, y = np.arange(-0.02, 0.012, step) + shift, np.arange(-0.02, 0.02, step) + shift
    xx, yy = np.meshgrid(x, y)
    u, v = np.full(xx.shape, 0.08), np.full(xx.shape, -0.02)
    layer = [(-1e-3, s, layer_part * circulation / 24, 1e-3) for s in np.linspace(-4e-3, 4e-3, 24)]
    for blob in [(-gap * core, 0.0, circulation, core), *layer]:
        du, dv = lamb_oseen(xx, yy, *blob)
        u, v = u + du, v + dv
    rng = np.random.default_rng(seed)
    for f in (u, v):
        e = ndimage.gaussian_filter(rng.normal(size=f.shape), 1.0)
        f += noise * (1 + np.exp(xx / 1.5e-3)) * e / e.std()
    ok = xx < -hidden
    return (
        make_plane(x, y, np.where(ok, u, np.nan), np.where(ok, v, np.nan)),
        (1 + layer_part) * circulation,
        core,
    )
