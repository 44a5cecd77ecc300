"""Particle images: Gaussian spots integrated over pixels, sheet light, body, sensor noise."""

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy import float32, ndarray

from piv.compiled import compiled
from piv.images.masks import inside_polygon

SLAB_HALF_WIDTH = 1.25  # in sheet thicknesses: light has fallen to exp(-12.5) there


def sheet_light(z: ndarray, thickness: float) -> ndarray:
    """Relative light at distance `z` from the middle of a Gaussian sheet, exp(-8 z^2/thickness^2).

    `thickness` (same unit as z) is the full width at 1/e^2 of the peak.
    """
    return np.exp(-8.0 * (np.asarray(z) / thickness) ** 2)


@compiled
def add_particles(image, column, row, amplitude, diameter):
    """Add Gaussian particle images to `image` (rows, columns; float), in place.

    `column`, `row`: centres in px (0 = centre of the first pixel); `amplitude`: peak of the
    unintegrated Gaussian amplitude*exp(-8 r^2/diameter^2); `diameter`: full width at 1/e^2 (px).
    Each pixel holds the exact mean over its area (product of two erf differences); a spot is cut
    where it has fallen below 1e-5 grey levels.
    """
    rows, columns = image.shape
    wx = np.empty(256)
    for k in range(column.size):
        if amplitude[k] <= 1e-5:
            continue
        sigma = diameter[k] / 4.0
        radius = sigma * math.sqrt(2.0 * math.log(amplitude[k] * 1e5)) + 0.5
        x, y = column[k], row[k]
        i0, i1 = max(0, math.ceil(x - radius)), min(columns - 1, math.floor(x + radius))
        j0, j1 = max(0, math.ceil(y - radius)), min(rows - 1, math.floor(y + radius))
        if i1 < i0 or j1 < j0 or i1 - i0 >= 256:
            continue
        s = 1.0 / (math.sqrt(2.0) * sigma)
        last = math.erf((i0 - 0.5 - x) * s)
        for i in range(i0, i1 + 1):
            edge = math.erf((i + 0.5 - x) * s)
            wx[i - i0] = edge - last
            last = edge
        factor = amplitude[k] * math.pi * sigma * sigma / 2.0
        last = math.erf((j0 - 0.5 - y) * s)
        for j in range(j0, j1 + 1):
            edge = math.erf((j + 0.5 - y) * s)
            wy = factor * (edge - last)
            last = edge
            for i in range(i0, i1 + 1):
                image[j, i] += wy * wx[i - i0]


@compiled
def in_mask(mask, column, row):
    """Points (px, row 0 at the top) on a set pixel of `mask`; False outside the picture."""
    rows, columns = mask.shape
    out = np.zeros(column.size, np.bool_)
    for n in range(column.size):
        j, i = np.rint(row[n]), np.rint(column[n])
        if 0 <= j < rows and 0 <= i < columns:
            out[n] = mask[int(j), int(i)] != 0
    return out


@dataclass(frozen=True)
class Body:
    """A body in a picture: `mask` (rows, columns; uint8), outlines (column, row; px)."""

    mask: ndarray
    polygons: tuple[ndarray, ...] = ()

    @cached_property
    def edge(self) -> ndarray:
        """Pixels beside which the mask changes."""
        ring = np.ones((3, 3), np.uint8)
        return cv2.dilate(self.mask, ring) != cv2.erode(self.mask, ring)

    def holds(self, column: ndarray, row: ndarray) -> ndarray:
        """Points (px, row 0 at the top) in the body, to a fraction of a pixel with outlines."""
        inside = in_mask(self.mask, column, row)
        if self.polygons:
            near = np.flatnonzero(in_mask(self.edge, column, row))
            inside[near] = False
            for polygon in self.polygons:
                inside[near] |= inside_polygon(polygon, column[near, None], row[near])[:, 0]
        return inside


def shadow_of(mask: ndarray) -> ndarray:
    """Pixels (bool) above the lowest body pixel of their column: a sheet from below is hidden."""
    body = np.asarray(mask).astype(bool)
    return np.cumsum(body[::-1], axis=0)[::-1].astype(bool) & ~body


def expose(
    light: ndarray,
    rng: np.random.Generator,
    bits: int = 8,
    background: float = 0.0,
    read_noise: float = 0.0,
    electrons_per_level: float = 0.0,
) -> ndarray:
    """Grey levels (uint8/uint16) that a sensor reads for `light` (without background).

    `background`, `read_noise` (standard deviation) in grey levels. Shot noise has the variance
    (light + background)/electrons_per_level; 0 = none. It is drawn from the normal limit of
    Poisson's law, good above ~20 electrons per pixel. Values are rounded and saturate at 2**bits -
    1.
    """
    level = light.astype(float32) + float32(background)
    if read_noise > 0 or electrons_per_level > 0:
        noise = rng.standard_normal(level.shape, dtype=float32)
        if electrons_per_level > 0:
            noise *= np.sqrt(level / float32(electrons_per_level) + float32(read_noise**2))
        else:
            noise *= float32(read_noise)
        level += noise
    level += float32(0.5)
    np.clip(level, 0, 2**bits - 1, out=level)
    return level.astype(np.uint8 if bits <= 8 else np.uint16)
