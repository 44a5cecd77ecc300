"""Measures of a region of a plane: smoothed vorticity and Q, centroid, circulations, size, peak."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy import ndarray

from piv.compiled import compiled
from piv.vortices.criteria import q_criterion, vorticity
from piv.vortices.smooth import Smoother

DISC = 3.0  # radius of the disc of a circulation, smoothing lengths: half a tip's width
# radius of the circle of a circulation that does not depend on the smoothing, in radii of the
# region: it holds 0.993 of a Lamb-Oseen vortex at any scale
CIRCLE = 2.0
# of the lower of two maxima: with less between them they are two vortices. The main tracks of three
# flows are the same from 0.4 to 0.8; below 0.6 a roll at a finger's corner comes and goes (no
# command repeats it)
SADDLE = 0.6
STEINER = np.pi / 12  # cells by which an edge one cell wide adds to the area of a closed curve
_SQUARE = np.ones((3, 3), np.uint8)


class Plane(NamedTuple):
    """Vectors on their grid: axes, components (NaN where absent), validity, fit weights.

    `lost`: rejected, but in the water; `wall`: left out, in bodies and beside their walls. `noise`:
    standard uncertainties of u and v, None where not known. `correlated`: distance over which their
    errors are alike.
    """

    x: ndarray
    y: ndarray
    u: ndarray
    v: ndarray
    valid: ndarray
    lost: ndarray
    wall: ndarray
    noise: tuple[ndarray, ndarray] | None
    correlated: float
    weight_u: ndarray
    weight_v: ndarray

    @property
    def step(self) -> tuple[float, float]:
        """Grid steps in x and y."""
        return float(self.x[1] - self.x[0]), float(self.y[1] - self.y[0])


class Measures(NamedTuple):
    """Centroid of a region's vorticity, circulations round that, size and peak of the region.

    The circulations are of the vorticity of one sense that is nearer to the centroid than to
    another vortex of that sense, in their radii: within DISC, and within a `circle` of CIRCLE.
    """

    x: float
    y: float
    circulation: float
    radius: float
    peak_vorticity: float
    circle: float


class Criteria(NamedTuple):
    """Smoothed vorticity and Q of a part of the plane, 0 where unknown, and where known."""

    omega: ndarray
    q: ndarray
    known: ndarray


class Patch(NamedTuple):
    """A region within its box: criteria, its points, those of no other region, and the box.

    `level`: of its largest vorticity, that it ends at. `strained`: more than it turns. `turns`:
    by more than a layer of parallel shear.
    """

    c: Criteria
    mask: ndarray
    free: ndarray
    box: tuple[slice, ...]
    level: float
    strained: bool
    turns: bool


def smoothed_criteria(p: Plane, scale: float, box, noise: tuple[ndarray, ndarray] | None = None):
    """Smoothed vorticity and Q within a box; with `noise` (y, x, n) added to the vectors."""
    u, v, valid = p.u[box], p.v[box], p.valid[box]
    if noise is not None:
        u, v = (q[..., None] + e for q, e in zip((u, v), noise, strict=True))
    smoother = Smoother(valid, p.lost[box], *p.step, scale)
    g = smoother.gradients(u, v)
    return Criteria(np.nan_to_num(vorticity(g)), np.nan_to_num(q_criterion(g)), smoother.ok)


def own_points(
    p: Plane, box: tuple[slice, ...], m: Measures, others: list[Measures], reach: float
) -> ndarray:
    """Part of each point of a box that is the vortex's: within `reach`, nearer to it than others.

    Distances to vortices of one sense are in their radii.
    """
    x, y = p.x[box[1]], p.y[box[0]][:, None]
    away = np.hypot(x - m.x, y - m.y)
    own = np.clip(0.5 + (reach - away) / max(p.step), 0.0, 1.0)
    for other in others:
        if other is not m and other.circulation * m.circulation > 0:
            own = own * (away * other.radius <= np.hypot(x - other.x, y - other.y) * m.radius)
    return own


def circulation_of(c: Criteria, own: ndarray, p: Plane) -> float:
    """Vorticity of the vortex's sense on its `own` points, without its sign."""
    return float((own * np.maximum(c.omega, 0.0)).sum() * p.step[0] * p.step[1])


def excess_of(c: Criteria, mask: ndarray, strained_peak: float) -> ndarray:
    """What tells a region from shear, of one field or of each of its replicas (y, x, n).

    1 less the strain's mean square over the vorticity's: of a round vortex 1, of parallel shear 0.
    Of a strained vortex, whose `strained_peak` is given, how far the vorticity falls to its edge.
    """
    omega = c.omega[mask]
    if strained_peak:
        return omega.max(axis=0) / strained_peak - SADDLE
    return 4 * c.q[mask].sum(axis=0) / (omega**2).sum(axis=0)


def measures_of(patch: Patch, p: Plane, sense: float) -> Measures:
    """Integrals over a region; a cell on its edge counts by the part that lies within."""
    c, mask, free, box, level, strained, _ = patch
    peak = float(c.omega[mask].max())
    near = cv2.dilate(mask.astype(np.uint8), _SQUARE) > 0
    within = _depth(c.omega - level * peak)
    if not strained:
        within = np.minimum(within, _depth(c.q))
    cover = np.clip(0.5 + within, 0.0, 1.0) * (near & free & c.known)
    amount = cover * np.maximum(c.omega, 0.0)
    total, cell = float(amount.sum()), p.step[0] * p.step[1]
    x, y = p.x[box[1]], p.y[box[0]]
    return Measures(
        float(amount.sum(axis=0) @ x / total),
        float(amount.sum(axis=1) @ y / total),
        sense * total * cell,
        float(np.sqrt((cover.sum() - STEINER) * cell / np.pi)),
        sense * _peak(c.omega, mask),
        sense * total * cell,
    )


@compiled
def _depth(f):
    """Distance to the line f = 0 in cells, positive where f is, to second order."""
    rows, columns = f.shape
    depth = np.empty(f.shape)
    flat = (1e-12 * np.abs(f).max() + 1e-70) ** 2
    for j in range(rows):
        above, below = max(j - 1, 0), min(j + 1, rows - 1)
        for i in range(columns):
            left, right = max(i - 1, 0), min(i + 1, columns - 1)
            down = (f[below, i] - f[above, i]) / (below - above)
            across = (f[j, right] - f[j, left]) / (right - left)
            twist = f[below, right] - f[below, left] - f[above, right] + f[above, left]
            bend = (
                across**2 * (f[j, right] - 2 * f[j, i] + f[j, left])
                + down**2 * (f[below, i] - 2 * f[j, i] + f[above, i])
                + across * down * twist / 2
            )
            square = max(down**2 + across**2, flat)
            curved = f[j, i] * bend / (2 * square**2)
            depth[j, i] = f[j, i] / math.sqrt(square) * (1 + min(max(curved, -0.5), 0.5))
    return depth


def _peak(omega: ndarray, mask: ndarray) -> float:
    """Largest vorticity of a region, between grid points by a parabola in x and y."""
    j, i = np.unravel_index(np.argmax(np.where(mask, omega, -np.inf)), omega.shape)
    value = float(omega[j, i])
    for line, k in ((omega[:, i], j), (omega[j], i)):
        if 0 < k < line.size - 1:
            slope, bend = (line[k + 1] - line[k - 1]) / 2, line[k + 1] - 2 * line[k] + line[k - 1]
            if bend < 0 and abs(slope) <= -bend:
                value -= float(slope**2 / (2 * bend))
    return value
