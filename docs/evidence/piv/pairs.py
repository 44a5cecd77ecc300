"""Pairs of pictures from a displacement function, by the renderer of the product."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy import ndarray

from piv.synthetic.particle_images import (
    SLAB_HALF_WIDTH,
    add_particles,
    expose,
    in_mask,
    sheet_light,
)
from piv.synthetic.particles import Box, seed_particles

Displacement = Callable[[ndarray, ndarray], tuple[Any, ...]]


def render_pair(
    displacement: Displacement,
    shape: tuple[int, int] = (1024, 1280),
    *,
    density_ppp: float = 0.04,
    diameter_px: float = 2.5,
    noise: float = 0.0,
    peak: float = 0.8,
    background: float = 0.0,
    sheet_thickness_px: float = 12.0,
    mask: ndarray | None = None,
    seed: int = 0,
) -> tuple[ndarray, ndarray]:
    """Two pictures (row 0 at the top) of particles displaced by `displacement`.

    `displacement(x_px, y_px)` gives (dx, dy) or (dx, dy, dz) in px, x right, y up from the centre
    of the bottom row; a particle drawn at (x, y, z) is at (x, y, z) -/+ d/2 in the first/second
    picture, so the function itself is the exact mid-point truth. `noise`: standard deviation of
    read noise as a part of the grey scale (0.05 = 5 %); `background` in grey levels; `mask` (row 0
    at the top, 1 = body) holds no particles and stays black.
    """
    rows, columns = shape
    rng = np.random.default_rng(seed)
    full = 255
    corners = np.meshgrid(np.linspace(0, columns - 1, 65), np.linspace(0, rows - 1, 65))
    largest = max(float(np.abs(d).max()) for d in displacement(*corners)[:2])
    margin = largest + 4 * diameter_px
    low, right, top = -0.5 - margin, columns - 0.5 + margin, rows - 0.5 + margin
    box = Box(low, right, low, top, SLAB_HALF_WIDTH * sheet_thickness_px)
    p = seed_particles(box, density_ppp / sheet_thickness_px, diameter_px, 0.0, rng)
    d = np.zeros((3, p.shape[1]))
    for k, component in enumerate(displacement(p[0], p[1])):
        d[k] = component
    body = None if mask is None else np.asarray(mask).astype(bool)
    pictures = []
    for side in (-0.5, 0.5):
        x, y, z = p[:3] + side * d
        light = peak * full * sheet_light(z, sheet_thickness_px) * (p[3] / diameter_px) ** 2
        if body is not None:
            light = np.where(in_mask(body, x, rows - 1 - y), 0.0, light)
        image = np.zeros(shape, np.float32)
        add_particles(image, x, rows - 1 - y, light, p[3])
        if body is not None:
            image[body] = 0
        pictures.append(expose(image, rng, 8, background, noise * full))
    return pictures[0], pictures[1]
