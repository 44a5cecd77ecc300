"""Seeding particles in a slab around the light sheet and carrying them with a plane field."""

import math
import os
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numba
import numpy as np
from numpy import ndarray

from piv.compiled import compiled
from piv.synthetic.plane_spline import PlaneField, extremes, sample_point

# numba's threads sleep while they wait, and take no core from a stage beside. It holds for the
# whole process, and has no effect where libgomp, which reads it once, was loaded before.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
TILES = (64, 128)  # across and up: a tile's part of the field fits the first cache
MARGIN = 1.5  # times how far the flow goes from frame to frame: where fresh particles are drawn
PRECISION = 1e-4  # of the displacement: 0.0006 px of 6 px


@dataclass(frozen=True)
class Box:
    """The seeded volume, m: x and y limits and the half width in z."""

    x0: float
    x1: float
    y0: float
    y1: float
    half_width: float

    def volume(self, margin: float = 0.0, margin_z: float = 0.0) -> float:
        """Volume, m^3, grown by the margins on every side."""
        across, up = self.x1 - self.x0 + 2 * margin, self.y1 - self.y0 + 2 * margin
        return across * up * 2 * (self.half_width + margin_z)

    def holds(self, p: ndarray) -> ndarray:
        """Which particles (rows x, y, z, ...) lie inside."""
        x, y, z = p[:3]
        inside = (x >= self.x0) & (x < self.x1) & (y >= self.y0) & (y < self.y1)
        return inside & (np.abs(z) <= self.half_width)


def seed_particles(
    box: Box,
    per_volume: float,
    diameter: float,
    diameter_std: float,
    rng: np.random.Generator,
    margin: float = 0.0,
    margin_z: float = 0.0,
) -> ndarray:
    """Uniform particles, rows x, y, z (m) and image diameter (as `diameter`); Poisson in number.

    Diameters are normal, cut at three standard deviations and at a quarter of the mean.
    """
    n = rng.poisson(per_volume * box.volume(margin, margin_z))
    p = np.empty((4, n))
    p[0] = rng.uniform(box.x0 - margin, box.x1 + margin, n)
    p[1] = rng.uniform(box.y0 - margin, box.y1 + margin, n)
    p[2] = rng.uniform(-1, 1, n) * (box.half_width + margin_z)
    p[3] = np.maximum(
        diameter + diameter_std * np.clip(rng.standard_normal(n), -3, 3), diameter / 4
    )
    return p


def by_tiles(p: ndarray, box: Box) -> ndarray:
    """The particles in the order of TILES parts of the box: the field is read four times faster."""
    column, row = (
        np.clip((values - low) * (count / (high - low)), 0, count - 1).astype(np.uint16)
        for values, low, high, count in zip(
            p, (box.x0, box.y0), (box.x1, box.y1), TILES, strict=False
        )
    )
    return np.take(p, np.argsort(row * np.uint16(TILES[0]) + column, kind="stable"), axis=1)


def advance(field: PlaneField, p: ndarray, start: float, end: float, substeps: int = 2) -> ndarray:
    """Particles (rows x, y, z, ...) carried from `start` to `end` (s): RK4, (u, v, w + dwdz z)."""
    return _carry(field, p, _stages(field, start, end, substeps))


Stage = tuple[ndarray, ndarray, ndarray, float]


def _stages(field: PlaneField, start: float, end: float, substeps: int) -> list[Stage]:
    """The field at the beginning, middle and end of every substep, and the substep's length."""
    h = (end - start) / substeps
    nodes = [field.at(_between(start, end, k / (2 * substeps))) for k in range(2 * substeps + 1)]
    return [(nodes[2 * k], nodes[2 * k + 1], nodes[2 * k + 2], h) for k in range(substeps)]


def _between(start: float, end: float, part: float) -> float:
    """The instant at `part` of the interval, always the same number, so that caches hit."""
    return end if part == 1 else start + part * (end - start)


def _carry(field: PlaneField, p: ndarray, stages: list[Stage]) -> ndarray:
    out = p.copy()
    for c0, c1, c2, h in stages:
        _rk4(c0, c1, c2, out, h, field.x[0], field.y[0], field.dx, field.dy)
    return out


@numba.njit(cache=True, parallel=True)
def _rk4(c0, c1, c2, p, h, x0, y0, dx, dy):
    for n in numba.prange(p.shape[1]):
        x, y, z = p[0, n], p[1, n], p[2, n]
        kx = ky = kz = sx = sy = sz = 0.0
        for stage in range(4):
            f = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
            c = c0 if stage == 0 else (c2 if stage == 3 else c1)
            zs = z + f * h * kz
            u, v, w, dwdz = sample_point(c, (x + f * h * kx - x0) / dx, (y + f * h * ky - y0) / dy)
            kx, ky, kz = u, v, w + dwdz * zs
            g = 1.0 if stage in (0, 3) else 2.0
            sx, sy, sz = sx + g * kx, sy + g * ky, sz + g * kz
        p[0, n], p[1, n], p[2, n] = x + h * sx / 6, y + h * sy / 6, z + h * sz / 6


class Motion(NamedTuple):
    """Upper bounds of the displacement (m) in and across the plane, and its RK4 steps."""

    along: float
    across: float
    substeps: int


def motion(field: PlaneField, start: float, end: float, half_width: float) -> Motion:
    """`Motion` from `start` to `end`, from the field's spline coefficients half-way.

    So many that RK4 errs by PRECISION of the displacement, in n steps over which the flow turns by
    s (slope times interval) and particles pass by q radians of its waves: s⁴/(120 n⁴) where the
    flow turns, s q³/(2880 n⁴), as of Simpson's rule, where they are carried through its waves. More
    than one step a cell (and two in all) is never made.
    """
    coefficients = field.at(_between(start, end, 0.5))
    u, v, w, dwdz, slope, curvature = extremes(coefficients, 1 / field.dx, 1 / field.dy)
    time = end - start
    along = math.hypot(u, v) * time
    turn, passed = slope * time, along * curvature / max(slope, 1e-300)
    needed = (max(turn**4 / 120, turn * passed**3 / 2880) / PRECISION) ** 0.25
    most = max(2, math.ceil(along / min(field.dx, field.dy)))
    return Motion(along, (w + dwdz * half_width) * time, min(max(1, math.ceil(needed)), most))


def arriving(
    field: PlaneField, p: ndarray, box: Box, start: float, end: float, along: float, slack: float
) -> ndarray:
    """Particles (rows x, y, z, ...) that the flow round about may carry into the box.

    `along`: how far any goes from `start` to `end`, m; `slack`, m, is granted in the plane besides.
    """
    # of the path, and of a spline at its ends
    nodes = math.ceil(MARGIN * along / min(field.dx, field.dy)) + 3
    bound = cv2.dilate(
        np.abs(field.at(_between(start, end, 0.5))), np.ones((2 * nodes + 1,) * 2, np.uint8)
    )
    limits = np.array([box.x0, box.x1, box.y0, box.y1, box.half_width])
    origin_and_step = np.array([field.x[0], field.y[0], field.dx, field.dy])
    return _arriving(bound * (MARGIN * (end - start)), p, limits, origin_and_step, slack)


@compiled
def _arriving(bound, p, limits, origin_and_step, slack: float):
    out = np.empty(p.shape[1], np.bool_)
    ny, nx, _ = bound.shape
    x0, y0, dx, dy = origin_and_step
    for n in range(p.shape[1]):
        x, y, z = p[0, n], p[1, n], p[2, n]
        i = min(max(int((x - x0) / dx + 1.5), 0), nx - 1)
        j = min(max(int((y - y0) / dy + 1.5), 0), ny - 1)
        u, v, w, dwdz = bound[j, i]
        out[n] = (
            max(limits[0] - x, x - limits[1]) <= u + slack
            and max(limits[2] - y, y - limits[3]) <= v + slack
            and abs(z) - limits[4] <= w + dwdz * limits[4]
        )
    return out


def exact_displacement(
    field: PlaneField, x: ndarray, y: ndarray, start: float, end: float, substeps: int = 2
) -> tuple[ndarray, ndarray]:
    """Displacement (m) on the sheet of particles whose paths have (x, y) as the ends' middle.

    Solved by fixed-point iteration of the same integration as the particles'; residual below 1e-4
    of the displacement.
    """
    centre = np.array([np.ravel(x), np.ravel(y)])
    d = (end - start) * field.sample(field.at(_between(start, end, 0.5)), x, y)[:2]
    stages = _stages(field, start, end, substeps)
    for _ in range(6):
        p = np.zeros((3, centre.shape[1]))
        p[:2] = centre - d / 2
        new = _carry(field, p, stages)[:2] - p[:2]
        change = np.abs(new - d).max()
        d = new
        if change < 1e-4 * np.abs(d).max():
            break
    return d[0].reshape(np.shape(x)), d[1].reshape(np.shape(y))
