"""A small particle-image renderer of the tests: exact pixel integration, mid-point truth."""

import math

import numpy as np
from numba import njit


@njit(cache=True)
def _splat(image, x, y, peak, sigma):
    rows, columns = image.shape
    scale = 1.0 / (math.sqrt(2.0) * sigma)
    reach = math.ceil(4.5 * sigma) + 1
    norm = math.pi * sigma * sigma / 2
    for k in range(x.size):
        cx, cy = round(x[k]), round(y[k])
        for r in range(max(cy - reach, 0), min(cy + reach + 1, rows)):
            gy = math.erf((r + 0.5 - y[k]) * scale) - math.erf((r - 0.5 - y[k]) * scale)
            for c in range(max(cx - reach, 0), min(cx + reach + 1, columns)):
                gx = math.erf((c + 0.5 - x[k]) * scale) - math.erf((c - 0.5 - x[k]) * scale)
                image[r, c] += peak[k] * norm * gx * gy


def render(
    displacement,
    *,
    shape=(1024, 1280),
    seed=0,
    ppp=0.04,
    diameter=2.5,
    noise=0.0,
    out_of_plane=0.0,
    peak=205.0,
    background=5.0,
    frames=(-0.5, 0.5),
    path=None,
    sheet=12.0,
):
    """8-bit images at instants `frames` of particles with displacement(x, y) -> (dx, dy[, dz]) px.

    Particles move along straight lines through their middle position, or along path(x, y, t) -> (x,
    y), x right and y up from the centre of the bottom row. `noise` is Gaussian, as a fraction of
    255; `out_of_plane` is a shift between the frames as a fraction of the light sheet's e⁻²
    thickness, which is `sheet` px for a displacement that has a dz of its own.
    """
    rng = np.random.default_rng(seed)
    rows, columns = shape
    margin = 40
    half = 1.0  # particles are seeded over twice the e⁻² thickness of the sheet
    count = rng.poisson(ppp * (rows + 2 * margin) * (columns + 2 * margin) * 2 * half)
    x = rng.uniform(-margin, columns + margin, count)
    y = rng.uniform(-margin, rows + margin, count)
    z = rng.uniform(-half, half, count)
    dx, dy, *dz = displacement(x, y) if path is None else (None, None)
    if dz:
        out_of_plane = out_of_plane + dz[0] / sheet
    images = []
    for t in frames:
        brightness = peak * np.exp(-8 * (z + t * out_of_plane) ** 2)
        seen = brightness > 0.05
        image = np.full(shape, background)
        px, py = (x + t * dx, y + t * dy) if path is None else path(x, y, t)
        _splat(image, px[seen], (rows - 1 - py)[seen], brightness[seen], diameter / 4)
        image += 255 * noise * rng.standard_normal(shape)
        images.append(np.clip(np.rint(image), 0, 255).astype(np.uint8))
    return images
