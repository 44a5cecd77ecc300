"""Candidate vortices: connected regions where Gamma2 and the swirling strength agree."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from piv.criteria import Gradients, gamma2, q_criterion, swirling_strength, vorticity

# Of a Lamb-Oseen vortex, |Gamma2| > 2/pi, swirling strength > 0 and Q > 0 all bound r < 1.12 core radii, which holds
# 71.5 % of its circulation.
REGION_RADIUS = 1.12
REGION_PART = 0.715


class Candidate(NamedTuple):
    """A first guess: centre, circulation, core radius, and the number of grid points of its region."""

    x: float
    y: float
    circulation: float
    core_radius: float
    points: int


def find_candidates(
    x: np.ndarray,
    y: np.ndarray,
    u: np.ndarray,
    v: np.ndarray,
    valid: np.ndarray,
    g: Gradients,
    *,
    stencil_radius: float,
    threshold: float,
    min_points: int,
    max_elongation: float,
) -> list[Candidate]:
    """Candidates on a regular grid, strongest first.

    A region is connected points of one sense with |Gamma2| >= `threshold`, swirling strength > 0 and Q > 0. Its centre is
    the mean position weighted with (|Gamma2| - threshold) times the swirling strength. Regions of less than `min_points`
    points or longer than `max_elongation` times their width (shear layers) are left out.
    """
    dx, dy = float(x[1] - x[0]), float(y[1] - y[0])
    size = gamma2(u, v, valid, dx, dy, stencil_radius)
    swirl, omega = swirling_strength(g), vorticity(g)
    inside = q_criterion(g) > 0
    found = []
    for sense in (1.0, -1.0):
        region = (np.nan_to_num(sense * size) >= threshold) & (np.nan_to_num(sense * swirl) > 0) & inside
        labels, _n = ndimage.label(region, np.ones((3, 3)))
        for k, box in enumerate(ndimage.find_objects(labels), start=1):
            j, i = np.nonzero(labels[box] == k)
            if j.size < min_points:
                continue
            j, i = j + box[0].start, i + box[1].start
            weight = (sense * size[j, i] - threshold + 1e-3) * np.abs(swirl[j, i])
            if _elongation(x[i], y[j], dx, dy) > max_elongation:
                continue
            area = j.size * dx * dy
            found.append(
                Candidate(
                    float(np.average(x[i], weights=weight)),
                    float(np.average(y[j], weights=weight)),
                    float(omega[j, i].sum() * dx * dy / REGION_PART),
                    float(np.sqrt(area / np.pi) / REGION_RADIUS),
                    int(j.size),
                )
            )
    return sorted(found, key=lambda c: -abs(c.circulation))


def _elongation(x: np.ndarray, y: np.ndarray, dx: float, dy: float) -> float:
    """Ratio of the region's principal standard deviations, each point being a cell of its own size."""
    cov = np.cov(np.array([x, y]), bias=True) + np.diag([dx * dx, dy * dy]) / 12
    small, large = np.linalg.eigvalsh(cov)
    return float(np.sqrt(large / small))
