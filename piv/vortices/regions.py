"""Vortices as regions of a plane: where it rotates more than it strains, at a stated scale."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
from numpy import ndarray
from scipy import ndimage

from piv.compiled import compiled
from piv.vortices.criteria import q_criterion, vorticity
from piv.vortices.settings import VortexSettings
from piv.vortices.smooth import Smoother

DISC = 3.0  # radius of the circle of a circulation, smoothing lengths: half a tip's width
# radius, in smoothing lengths: a line vortex has 1.58, half of one beside a wall 1.1
SMALLEST = 0.75
FLAT = 0.75  # of the largest vorticity: a region whose edge has more is part of a background
# of the lower of two maxima: with less between them they are two vortices. The main tracks of three
# flows are the same from 0.4 to 0.8; below 0.6 a roll at a finger's corner comes and goes (no
# command repeats it)
SADDLE = 0.6
STEINER = np.pi / 12  # cells by which an edge one cell wide adds to the area of a closed curve
# A vortex that is strained more than it turns: its largest vorticity over the plane's, and the
# longest region over its width at SADDLE of that
STRAINED_PEAK, ROUND = 0.25, 2.0
# A vortex against shear, in which strain equals rotation: least share of the rotation beyond strain
# (strain is then below three quarters of rotation), and that over the standard deviation that the
# vectors' errors give it. Shear in noise reaches 4.7, the recorded vortices have 9 and more
ROTATES, CERTAIN = 0.45, 5.0
WINDOW_STD = 12**0.5  # width of a window over the standard deviation of its points
REPLICAS = 12  # of the vectors' errors: their standard deviation is known to a fifth
# relative standard deviations of the measures on a grid (x and y: over the radius), factors of the
# square of the grid step over the radius, of a circulation over its circle's; and what the end of
# the smoothing's weights makes. These and OF_REPLICAS: docs/evidence/piv/vortex_errors.py
OF_GRID = np.array([0.022, 0.022, 0.056, 0.05, 0.01])
OF_WEIGHTS = 4e-5
# what windows and their smoothing err alike over a vortex: of a circulation, and of a radius the
# factor of the square of the errors' length over it
OF_PIV, OF_WINDOWS = 0.0012, 0.0085
# errors of PIV over those of the replicas: x, y, circulation, radius, peak
OF_REPLICAS = np.array([0.66, 0.66, 0.82, 1.0, 1.55])
_CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.uint8)
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
    """Centroid of a region's vorticity, circulation round that, size and peak of the region.

    The circulation is of the vorticity of one sense within DISC of the centroid that is nearer to
    it than to another vortex of that sense, in their radii.
    """

    x: float
    y: float
    circulation: float
    radius: float
    peak_vorticity: float


class Region(NamedTuple):
    """A vortex, its `measures` and their standard uncertainties; `random`: by the vectors alone."""

    measures: Measures
    std: Measures
    random: Measures


class _Criteria(NamedTuple):
    """Smoothed vorticity and Q of a part of the plane, 0 where unknown, and where known."""

    omega: ndarray
    q: ndarray
    known: ndarray


class _Patch(NamedTuple):
    """A region within its box: criteria, its points, those of no other region, and the box.

    `level`: of its largest vorticity, that it ends at. `strained`: more than it turns. `turns`:
    by more than a layer of parallel shear.
    """

    c: _Criteria
    mask: ndarray
    free: ndarray
    box: tuple[slice, ...]
    level: float
    strained: bool
    turns: bool


def find_regions(p: Plane, scale: float, s: VortexSettings) -> list[Region]:
    """Vortices of a plane, strongest first, at a smoothing length `scale`.

    A region is connected points of one sense with Q > 0 around a maximum of the vorticity, with at
    least `s.least_part` of that. Where strain exceeds rotation at a maximum, farther than `scale`
    from walls, it is a round region with at least SADDLE of it. Left out is what is smaller than
    `scale`, longer than `s.max_elongation` times its width, has its centroid farther outside than
    `scale`, or does not stand out of a background, and what does not exceed `s.significance`
    standard uncertainties.
    """
    whole = _criteria(p, scale, np.s_[:, :])
    found = []
    for sense in (1.0, -1.0):
        turning = _Criteria(sense * whole.omega, whole.q, whole.known)
        patches = _vortices(turning, p, scale, s)
        found += [(_measures(patch, p, sense), patch) for patch in patches]
    # layers are left out after that: beside them the strongest vortex may be noise
    strongest = max((abs(m.circulation) for m, _ in found), default=0.0)
    least = s.min_part * strongest if s.min_circulation is None else s.min_circulation
    found = [f for f in found if abs(f[0].circulation) >= least and f[1].turns]
    measures = [m for m, _ in found]
    regions = []
    for m, patch in found:
        own = _own(p, patch.box, m, measures, DISC * scale)
        m = m._replace(circulation=np.sign(m.circulation) * _circulation(patch.c, own, p))
        noise, doubt = _of_vectors(patch, p, scale, m, own)
        excess = float(_excess(patch.c, patch.mask, abs(m.peak_vorticity) * patch.strained))
        if abs(m.circulation) >= s.significance * noise.circulation and excess >= CERTAIN * doubt:
            std = np.hypot(_of_grid(patch, p, scale, m, own), noise)
            regions.append(Region(m, Measures(*std.tolist()), noise))
    return sorted(regions, key=lambda r: -abs(r.measures.circulation))


def _own(
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


def _circulation(c: _Criteria, own: ndarray, p: Plane) -> float:
    """Vorticity of the vortex's sense on its `own` points, without its sign."""
    return float((own * np.maximum(c.omega, 0.0)).sum() * p.step[0] * p.step[1])


def _vortices(c: _Criteria, p: Plane, scale: float, s: VortexSettings) -> Iterator[_Patch]:
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
            by = 2 + int(DISC * scale / min(p.step))
            box = tuple(slice(max(0, b.start - by), min(n, b.stop + by)) for b, n in edges)
            near, local = basins[box], _Criteria(*(q[box] for q in part))
            mask = (near == k) & (local.omega >= level * peaks[k])
            if np.count_nonzero(mask) < least or (mask & taken[box]).any():
                continue
            if _stands_out(local, mask, p.step, scale, longest):
                turns = strained or bool(_excess(local, mask, 0.0) >= ROTATES)
                taken[box] |= (near == k) & turns
                yield _Patch(local, mask, (near == k) | (near == 0), box, level, strained, turns)


def _excess(c: _Criteria, mask: ndarray, strained_peak: float) -> ndarray:
    """What tells a region from shear, of one field or of each of its replicas (y, x, n).

    1 less the strain's mean square over the vorticity's: of a round vortex 1, of parallel shear 0.
    Of a strained vortex, whose `strained_peak` is given, how far the vorticity falls to its edge.
    """
    omega = c.omega[mask]
    if strained_peak:
        return omega.max(axis=0) / strained_peak - SADDLE
    return 4 * c.q[mask].sum(axis=0) / (omega**2).sum(axis=0)


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


def _criteria(p: Plane, scale: float, box, noise: tuple[ndarray, ndarray] | None = None):
    """Smoothed vorticity and Q within a box; with `noise` (y, x, n) added to the vectors."""
    u, v, valid = p.u[box], p.v[box], p.valid[box]
    if noise is not None:
        u, v = (q[..., None] + e for q, e in zip((u, v), noise, strict=True))
    smoother = Smoother(valid, p.lost[box], *p.step, scale)
    g = smoother.gradients(u, v)
    return _Criteria(np.nan_to_num(vorticity(g)), np.nan_to_num(q_criterion(g)), smoother.ok)


def _stands_out(
    c: _Criteria, mask: ndarray, step: tuple[float, float], scale: float, longest: float
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


def _measures(patch: _Patch, p: Plane, sense: float) -> Measures:
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


def _of_grid(patch: _Patch, p: Plane, scale: float, m: Measures, own: ndarray) -> ndarray:
    """Standard uncertainties of a region's measures by the grid and by what is hidden.

    Where its `own` points end at absent vectors that are not at a wall, what lies within half a
    window beyond is unknown; so is what lies at absent vectors that were bridged.
    """
    c, box = patch.c, patch.box
    step = max(p.step)
    sizes = np.array([m.radius, m.radius, abs(m.circulation), m.radius, abs(m.peak_vorticity)])
    lengths = np.array([m.radius, m.radius, DISC * scale, m.radius, m.radius])
    known = np.pad(c.known | p.wall[box], 1, mode="edge")
    hidden = c.known & ~(known[:-2, 1:-1] & known[2:, 1:-1] & known[1:-1, :-2] & known[1:-1, 2:])
    share = own * np.maximum(c.omega, 0.0) * step / abs(m.circulation)
    unseen = np.hypot(
        share[hidden].sum() * p.correlated / 2, share[c.known & ~p.valid[box]].sum() * step
    )
    relative = np.hypot(np.hypot(OF_GRID * (step / lengths) ** 2, OF_WEIGHTS), unseen)
    if p.noise is not None:
        relative[2] = np.hypot(relative[2], OF_PIV)
        relative[3] = np.hypot(relative[3], OF_WINDOWS * (p.correlated / m.radius) ** 2)
    return relative * sizes


def _of_vectors(
    patch: _Patch, p: Plane, scale: float, m: Measures, own: ndarray
) -> tuple[Measures, float]:
    """Standard uncertainties of a region's measures, and of its excess, by replicas of the vectors.

    The errors are alike over a window; 0 where the plane does not tell them.
    """
    if p.noise is None:
        return Measures(*[0.0] * 5), 0.0
    _, mask, free, box, level, strained, _ = patch
    rng = np.random.default_rng(1)
    errors = [
        np.where(p.valid[box], std[box], 0.0)[..., None] * _alike(rng, p, std[box].shape)
        for std in p.noise
    ]
    replicas = _criteria(p, scale, box, (errors[0], errors[1]))
    sense = np.sign(m.circulation)
    values = []
    for k in range(REPLICAS):
        part = _Criteria(sense * replicas.omega[..., k], replicas.q[..., k], replicas.known)
        least = level * max(float(part.omega[mask].max()), 0.0)
        inside = free & (part.omega > least) & ((part.q > 0) | strained)
        _, labels = cv2.connectedComponents(inside.astype(np.uint8), connectivity=4)
        most = int(np.argmax(np.bincount(labels[mask], minlength=2)[1:])) + 1
        if (labels == most).any():
            drawn = _measures(patch._replace(c=part, mask=labels == most), p, sense)
            values.append(drawn._replace(circulation=_circulation(part, own, p)))
    if len(values) < 2:  # it vanishes in the noise
        return Measures(*[np.inf] * 5), np.inf
    turning = replicas._replace(omega=sense * replicas.omega)
    doubt = float(_excess(turning, mask, abs(m.peak_vorticity) * strained).std(ddof=1))
    return Measures(*(OF_REPLICAS * np.std(values, axis=0, ddof=1)).tolist()), doubt


def _alike(rng: np.random.Generator, p: Plane, shape: tuple[int, int]) -> ndarray:
    """Random numbers (y, x, REPLICAS) of unit variance, alike over `p.correlated`."""
    std = [max(p.correlated / (WINDOW_STD * step), 1e-3) for step in p.step]
    x, y = (cv2.getGaussianKernel(2 * int(4 * s) + 3, s) for s in std)
    noise = rng.standard_normal((*shape, REPLICAS))
    return cv2.sepFilter2D(noise, cv2.CV_64F, x, y) / np.sqrt((x**2).sum() * (y**2).sum())
