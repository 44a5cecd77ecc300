"""Vortices as regions of a plane: where it rotates more than it strains, at a stated scale."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
from numpy import ndarray
from scipy import ndimage

from piv.compiled import compiled
from piv.vortices.region_errors import of_grid, of_vectors, with_noise
from piv.vortices.region_measures import (
    CIRCLE,
    DISC,
    SADDLE,
    Criteria,
    Measures,
    Patch,
    Plane,
    circulation_of,
    excess_of,
    measures_of,
    own_points,
    smoothed_criteria,
)
from piv.vortices.settings import VortexSettings

# radius, in smoothing lengths: a line vortex has 1.58, half of one beside a wall 1.1
SMALLEST = 0.75
FLAT = 0.75  # of the largest vorticity: a region whose edge has more is part of a background
# A vortex that is strained more than it turns: its largest vorticity over the plane's, and the
# longest region over its width at SADDLE of that
STRAINED_PEAK, ROUND = 0.25, 2.0
# A vortex against shear, in which strain equals rotation: least share of the rotation beyond strain
# (strain is then below three quarters of rotation), and that over the standard deviation that the
# vectors' errors give it. Shear in noise reaches 4.7, the recorded vortices have 9 and more
ROTATES, CERTAIN = 0.45, 5.0
_CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.uint8)


class Region(NamedTuple):
    """A vortex, its `measures` and their standard uncertainties; `random`: by the vectors alone."""

    measures: Measures
    std: Measures
    random: Measures


def find_regions(p: Plane, scale: float, s: VortexSettings) -> list[Region]:
    """Vortices of a plane, strongest first, at a smoothing length `scale`.

    A region is connected points of one sense with Q > 0 around a maximum of the vorticity, with at
    least `s.least_part` of that. Where strain exceeds rotation at a maximum, farther than `scale`
    from walls, it is a round region with at least SADDLE of it. Left out is what is smaller than
    `scale`, longer than `s.max_elongation` times its width, has its centroid farther outside than
    `scale`, or does not stand out of a background, and what does not exceed `s.significance`
    standard uncertainties.
    """
    whole = smoothed_criteria(p, scale, np.s_[:, :])
    found = []
    for sense in (1.0, -1.0):
        turning = Criteria(sense * whole.omega, whole.q, whole.known)
        patches = _vortices(turning, p, scale, s)
        found += [(measures_of(patch, p, sense), patch) for patch in patches]
    # layers are left out after that: beside them the strongest vortex may be noise
    strongest = max((abs(m.circulation) for m, _ in found), default=0.0)
    least = s.min_part * strongest if s.min_circulation is None else s.min_circulation
    found = [f for f in found if abs(f[0].circulation) >= least and f[1].turns]
    measures = [m for m, _ in found]
    regions, noisy = [], with_noise(p)
    for m, patch in found:
        reaches = DISC * scale, CIRCLE * m.radius
        own = [own_points(p, patch.box, m, measures, reach) for reach in reaches]
        disc, circle = (np.sign(m.circulation) * circulation_of(patch.c, part, p) for part in own)
        m = m._replace(circulation=disc, circle=circle)
        noise, doubt = of_vectors(patch, noisy, scale, m, own)
        if p.noise is None:  # then it only decides: no uncertainty is stated
            noise = Measures(*[0.0] * 6)
        excess = float(excess_of(patch.c, patch.mask, abs(m.peak_vorticity) * patch.strained))
        if abs(m.circulation) >= s.significance * noise.circulation and excess >= CERTAIN * doubt:
            std = np.hypot(of_grid(patch, p, scale, m, own), noise)
            regions.append(Region(m, Measures(*std.tolist()), noise))
    return sorted(regions, key=lambda r: -abs(r.measures.circulation))


def _vortices(c: Criteria, p: Plane, scale: float, s: VortexSettings) -> Iterator[Patch]:
    """Regions that are vortices or layers, in boxes that hold the circle of a circulation."""
    least = np.pi * (SMALLEST * scale) ** 2 / (p.step[0] * p.step[1])
    taken = np.zeros(c.omega.shape, bool)
    away = cv2.distanceTransform(c.known.astype(np.uint8), cv2.DIST_L2, 5) > scale / max(p.step)
    lowest = STRAINED_PEAK * np.abs(c.omega).max()
    round_ = c._replace(q=np.where(away & (c.omega > SADDLE * lowest), 1.0, -1.0))
    for strained, part, level, longest, peak in (
        (False, c, s.least_part, s.max_elongation, 0.0),
        (True, round_, max(SADDLE, s.least_part), min(ROUND, s.max_elongation), lowest),
    ):
        basins, peaks = _basins(part.omega, (part.q > 0) & (part.omega > 0), SADDLE)
        sizes = np.bincount(basins.ravel())
        for k, box in enumerate(ndimage.find_objects(basins), start=1):
            if box is None or sizes[k] < least or peaks[k] < peak:
                continue
            edges = list(zip(box, basins.shape, strict=True))
            if strained and any(b.start == 0 or b.stop == n for b, n in edges):
                continue  # a layer that the plane's border cuts may look round
            by = 2 + int(max(DISC * scale / min(p.step), CIRCLE * np.sqrt(sizes[k] / np.pi)))
            box = tuple(slice(max(0, b.start - by), min(n, b.stop + by)) for b, n in edges)
            near, local = basins[box], Criteria(*(q[box] for q in part))
            mask = (near == k) & (local.omega >= level * peaks[k])
            if np.count_nonzero(mask) < least or (mask & taken[box]).any():
                continue
            if _stands_out(local, mask, p.step, scale, longest):
                turns = strained or bool(excess_of(local, mask, 0.0) >= ROTATES)
                taken[box] |= (near == k) & turns
                yield Patch(local, mask, (near == k) | (near == 0), box, level, strained, turns)


@compiled
def _basins(f, inside, saddle):
    """Number of the maximum of `f` (y, x) that each point `inside` belongs to, and the maxima.

    Numbers count from 1, 0 is outside. Points are taken in descending order; each joins its highest
    neighbour. Two maxima become one where they meet at no less than `saddle` times the lower.
    """
    rows, columns = f.shape
    at = np.flatnonzero(inside)
    at = at[np.argsort(-f.ravel()[at])]
    number = np.zeros(f.shape, np.int64)
    higher = np.zeros(at.size + 1, np.int64)
    peaks = np.zeros(at.size + 1)
    count = 0
    for point in at:
        j, i = point // columns, point % columns
        own, best = 0, 0.0
        for y, x in ((j - 1, i), (j + 1, i), (j, i - 1), (j, i + 1)):
            if not (0 <= y < rows and 0 <= x < columns) or number[y, x] == 0:
                continue
            other = number[y, x]
            while higher[other]:
                other = higher[other]
            low, high = (own, other) if peaks[other] > peaks[own] else (other, own)
            if low not in (0, high) and f[j, i] >= saddle * peaks[low]:
                higher[low] = high
                own, best = high, max(best, f[y, x])
            elif f[y, x] > best:
                own, best = other, f[y, x]
        if own == 0:
            count += 1
            own = count
            peaks[own] = f[j, i]
        number[j, i] = own
    for point in at:
        j, i = point // columns, point % columns
        while higher[number[j, i]]:
            number[j, i] = higher[number[j, i]]
    return number, peaks[: count + 1]


def _stands_out(
    c: Criteria, mask: ndarray, step: tuple[float, float], scale: float, longest: float
) -> bool:
    """Whether a region has the edge, centroid and length of a vortex: see `find_regions`."""
    j, i = np.nonzero(mask)
    weight = c.omega[mask]
    edge = (cv2.dilate(mask.astype(np.uint8), _CROSS) > 0) & ~mask & c.known
    if c.omega[edge].sum() > FLAT * weight.max() * np.count_nonzero(edge):
        return False
    row, column = (np.average(k, weights=weight) for k in (j, i))
    if np.hypot((i - column) * step[0], (j - row) * step[1]).min() > scale:
        return False
    spread = np.cov(np.array([i * step[0], j * step[1]]), aweights=weight, bias=True)
    small, large = np.linalg.eigvalsh(spread + np.diag(step) ** 2 / 12)
    return bool(large <= longest**2 * small)
