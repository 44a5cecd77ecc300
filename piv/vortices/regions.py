"""Candidate vortices: connected regions where Gamma2 and the swirling strength agree."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy import ndarray
from scipy import ndimage

from piv.compiled import compiled
from piv.vortices.criteria import Gradients, q_criterion, swirling_strength, vorticity
from piv.vortices.gamma2 import gamma2
from piv.vortices.settings import VortexSettings

# Of a Lamb-Oseen vortex, |Gamma2| > 2/pi, swirling strength > 0 and Q > 0 all bound r < 1.12 core
# radii, which holds 71.5 % of its circulation.
REGION_RADIUS = 1.12
REGION_PART = 0.715
LEAST_SEEN = 0.3  # share of a disc below which it is not made up for what is hidden
# the share changes slowly with the radius: each step leaves about a third of the error
RADIUS_STEPS = 8


class Plane(NamedTuple):
    """Vectors on their grid: axes, components (NaN where absent), validity, fit weights.

    `noise_known`: weights are inverse variances.
    """

    x: ndarray
    y: ndarray
    u: ndarray
    v: ndarray
    valid: ndarray
    weight_u: ndarray
    weight_v: ndarray
    xx: ndarray
    yy: ndarray
    noise_known: bool


class _Candidate(NamedTuple):
    """A first guess: centre, circulation and core radius.

    What bodies and border hide round the centre is left out of the circulation and made up for in
    the core radius.
    """

    x: float
    y: float
    circulation: float
    core_radius: float


def find_candidates(p: Plane, g: Gradients, s: VortexSettings) -> list[_Candidate]:
    """Candidates on a regular grid, strongest first.

    A region is connected points of one sense with |Gamma2| >= `s.gamma2`, swirling strength > 0 and
    Q > 0. Its centre is the mean position weighted with (|Gamma2| - s.gamma2) times the swirling
    strength. Regions of less than `s.min_points` points or longer than `s.max_elongation` times
    their width (shear layers) are left out.
    """
    x, y = p.x, p.y
    dx, dy = float(x[1] - x[0]), float(y[1] - y[0])
    size = gamma2(p.u, p.v, p.valid, dx, dy, s.stencil_radius or 2 * max(dx, dy))
    swirl, omega = swirling_strength(g), vorticity(g)
    inside = q_criterion(g) > 0
    candidates = []
    for sense in (1.0, -1.0):
        region = (
            (np.nan_to_num(sense * size) >= s.gamma2) & (np.nan_to_num(sense * swirl) > 0) & inside
        )
        labels, _ = ndimage.label(region, np.ones((3, 3)))
        for k, box in enumerate(ndimage.find_objects(labels), start=1):
            j, i = np.nonzero(labels[box] == k)
            if j.size < s.min_points:
                continue
            j, i = j + box[0].start, i + box[1].start
            weight = (sense * size[j, i] - s.gamma2 + 1e-3) * np.abs(swirl[j, i])
            if _elongation(x[i], y[j], dx, dy) > s.max_elongation:
                continue
            cx, cy = (float(np.average(q, weights=weight)) for q in (x[i], y[j]))
            radius = _whole_radius(x, y, p.valid, cx, cy, j.size)
            circulation = float(omega[j, i].sum() * dx * dy / REGION_PART)
            candidates.append(_Candidate(cx, cy, circulation, radius / REGION_RADIUS))
    return sorted(candidates, key=lambda c: -abs(c.circulation))


def _whole_radius(
    x: ndarray, y: ndarray, valid: ndarray, cx: float, cy: float, points: int
) -> float:
    """Radius of the disc round (cx, cy) with as many visible points as the region."""
    cell = float((x[1] - x[0]) * (y[1] - y[0]))
    radius = float(np.sqrt(points * cell / np.pi))
    seen = radius
    for _ in range(RADIUS_STEPS):
        share = min(1.0, max(LEAST_SEEN, seen_share(x, y, valid, cx, cy, seen)))
        seen = radius / float(np.sqrt(share))
    return seen


@compiled
def seen_share(x, y, valid, cx, cy, radius):
    """Part of the disc's grid points with a vector; points beyond the border are absent."""
    dx, dy = x[1] - x[0], y[1] - y[0]
    seen = disc = 0
    for j in range(math.ceil((cy - radius - y[0]) / dy), math.floor((cy + radius - y[0]) / dy) + 1):
        for i in range(
            math.ceil((cx - radius - x[0]) / dx), math.floor((cx + radius - x[0]) / dx) + 1
        ):
            if math.hypot(x[0] + i * dx - cx, y[0] + j * dy - cy) <= radius:
                disc += 1
                if 0 <= i < x.size and 0 <= j < y.size and valid[j, i]:
                    seen += 1
    return seen / max(1, disc)


def _elongation(x: ndarray, y: ndarray, dx: float, dy: float) -> float:
    """Ratio of the region's principal standard deviations, with points as cells."""
    cov = np.cov(np.array([x, y]), bias=True) + np.diag([dx * dx, dy * dy]) / 12
    small, large = np.linalg.eigvalsh(cov)
    return float(np.sqrt(large / small))
