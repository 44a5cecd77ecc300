"""Standard uncertainties of a region's measures: by the grid, by absent vectors, by errors."""

from __future__ import annotations

import cv2
import numpy as np
from numpy import ndarray
from scipy.special import ndtr

from piv.vortices.field_noise import field_noise
from piv.vortices.region_measures import (
    CIRCLE,
    DISC,
    Criteria,
    Measures,
    Patch,
    Plane,
    circulation_of,
    excess_of,
    measures_of,
    smoothed_criteria,
)

WINDOW_STD = 12**0.5  # width of a window over the standard deviation of its points
REPLICAS = 12  # of the vectors' errors: their standard deviation is known to a fifth
# relative standard deviations of the measures on a grid (x and y: over the radius), factors of the
# square of the grid step over the radius, of a circulation over its circle's; and what the end of
# the smoothing's weights makes. These and OF_REPLICAS: docs/evidence/piv/vortex_errors.py
OF_GRID = np.array([0.022, 0.022, 0.056, 0.05, 0.01, 0.056])
OF_WEIGHTS = 4e-5
# what windows and their smoothing err alike over a vortex: of a circulation, and of a radius the
# factor of the square of the errors' length over it
OF_PIV, OF_WINDOWS = 0.0012, 0.0085
# Smoothing that the plane's border cuts makes vorticity beside it too large. The relative errors
# are the cut share of a region's smoothing to this power. That holds to a third in Lamb-Oseen
# vortices of 0.3 to 3 smoothing lengths, whose centres are 2 to 8 of them from a border.
OF_BORDER = 0.7
# errors of PIV over those of the replicas: x, y, circulation, radius, peak, circle
OF_REPLICAS = np.array([0.66, 0.66, 0.82, 1.0, 1.55, 0.82])


def of_grid(patch: Patch, p: Plane, scale: float, m: Measures, own: list[ndarray]) -> ndarray:
    """Standard uncertainties of a region's measures by the grid and by what is hidden.

    Where its `own` points end at absent vectors that are not at a wall, what lies within half a
    window beyond is unknown; so is what lies at absent vectors that were bridged, and what the
    smoothing would take from beyond the plane's border.
    """
    c, box = patch.c, patch.box
    step = max(p.step)
    sizes = np.abs([m.radius, m.radius, m.circulation, m.radius, m.peak_vorticity, m.circle])
    lengths = np.full(6, m.radius)
    lengths[[2, 5]] = DISC * scale, CIRCLE * m.radius
    known = np.pad(c.known | p.wall[box], 1, mode="edge")
    hidden = c.known & ~(known[:-2, 1:-1] & known[2:, 1:-1] & known[1:-1, :-2] & known[1:-1, 2:])
    relative = np.hypot(OF_GRID * (step / lengths) ** 2, OF_WEIGHTS)
    for part, circulation, of in zip(own, sizes[[2, 5]], (slice(5), slice(5, 6)), strict=True):
        share = part * np.maximum(c.omega, 0.0) * step / circulation
        relative[of] = np.hypot(relative[of], share[hidden].sum() * p.correlated / 2)
        relative[of] = np.hypot(relative[of], share[c.known & ~p.valid[box]].sum() * step)
    cut = _cut_shares(patch, p, scale) ** OF_BORDER
    relative = np.hypot(relative, [*cut, *[cut.max()] * 4])
    if p.noise is not None:
        relative[[2, 5]] = np.hypot(relative[[2, 5]], OF_PIV)
        relative[3] = np.hypot(relative[3], OF_WINDOWS * (p.correlated / m.radius) ** 2)
    return relative * sizes


def _cut_shares(patch: Patch, p: Plane, scale: float) -> ndarray:
    """Shares (x, y) of the region's smoothing weights that lie beyond the plane's border."""
    inside = patch.mask * np.maximum(patch.c.omega, 0.0)
    shares = []
    for axis, step, part, sums in zip(
        (p.x, p.y), p.step, patch.box[::-1], (inside.sum(axis=0), inside.sum(axis=1)), strict=True
    ):
        ends = np.array([axis[0] - step / 2, axis[-1] + step / 2])[:, None]
        below, above = ndtr((ends - axis[part]) / scale)
        shares.append(np.average(1 - above + below, weights=sums))
    return np.array(shares)


def with_noise(p: Plane) -> Plane:
    """The plane; where it does not tell its noise, with that of the field itself."""
    if p.noise is not None:
        return p
    u_std, v_std, alike = field_noise(p.u, p.v)
    noise = np.full(p.u.shape, u_std), np.full(p.u.shape, v_std)
    return p._replace(noise=noise, correlated=max(p.correlated, alike * max(p.step)))


def of_vectors(
    patch: Patch, p: Plane, scale: float, m: Measures, own: list[ndarray]
) -> tuple[Measures, float]:
    """Standard uncertainties of a region's measures, and of its excess, by replicas of the vectors.

    p: with its noise (`with_noise`). The errors are alike over a window.
    """
    assert p.noise is not None
    _, mask, free, box, level, strained, _ = patch
    rng = np.random.default_rng(1)
    errors = [
        np.where(p.valid[box], std[box], 0.0)[..., None] * _alike(rng, p, std[box].shape)
        for std in p.noise
    ]
    replicas = smoothed_criteria(p, scale, box, (errors[0], errors[1]))
    sense = np.sign(m.circulation)
    values = []
    for k in range(REPLICAS):
        part = Criteria(sense * replicas.omega[..., k], replicas.q[..., k], replicas.known)
        least = level * max(float(part.omega[mask].max()), 0.0)
        inside = free & (part.omega > least) & ((part.q > 0) | strained)
        _, labels = cv2.connectedComponents(inside.astype(np.uint8), connectivity=4)
        most = int(np.argmax(np.bincount(labels[mask], minlength=2)[1:])) + 1
        if (labels == most).any():
            drawn = measures_of(patch._replace(c=part, mask=labels == most), p, sense)
            disc, circle = (circulation_of(part, q, p) for q in own)
            values.append(drawn._replace(circulation=disc, circle=circle))
    if len(values) < 2:  # it vanishes in the noise
        return Measures(*[np.inf] * 6), np.inf
    turning = replicas._replace(omega=sense * replicas.omega)
    doubt = float(excess_of(turning, mask, abs(m.peak_vorticity) * strained).std(ddof=1))
    return Measures(*(OF_REPLICAS * np.std(values, axis=0, ddof=1)).tolist()), doubt


def _alike(rng: np.random.Generator, p: Plane, shape: tuple[int, int]) -> ndarray:
    """Random numbers (y, x, REPLICAS) of unit variance, alike over `p.correlated`."""
    std = [max(p.correlated / (WINDOW_STD * step), 1e-3) for step in p.step]
    x, y = (cv2.getGaussianKernel(2 * int(4 * s) + 3, s) for s in std)
    noise = rng.standard_normal((*shape, REPLICAS))
    return cv2.sepFilter2D(noise, cv2.CV_64F, x, y) / np.sqrt((x**2).sum() * (y**2).sum())
