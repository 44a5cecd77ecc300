"""Outliers on a regular grid: normalised median (Westerweel & Scarano 2005), lone vectors."""

from functools import lru_cache

import cv2
import numpy as np
from numpy import float32

from piv.compiled import compiled, fast

SUPPORT = 0.5  # share of the neighbours that must have passed
RARE = 0.2  # share of vectors: where fewer have passed, doubtful correlations are chance
# of the neighbours, where vectors are rare: a seeded part has it along its edge
LEAST_SUPPORT = 0.25
SUPPORT_ROUNDS = 4  # each takes away what the one before has left alone
BLOCK = 256  # vectors whose neighbours are sorted together, in the first cache
ABSENT = float32(
    1e30
)  # px: stands for a neighbour that may not be used, half of them below and half above the others


@lru_cache
def _median_network(count: int) -> np.ndarray:
    """Pairs (n, 2) whose exchange in this order sorts the middle two of `count` values.

    Batcher's merge exchange (Knuth, The Art of Computer Programming 3, algorithm 5.2.2M) without
    the pairs that the middle does not need.
    """
    pairs: list[tuple[int, int]] = []
    top = 1 << (count - 1).bit_length() - 1
    p = top
    while p:
        q, r, d = top, 0, p
        while True:
            pairs += [(i, i + d) for i in range(count - d) if i & p == r]
            if q == p:
                break
            q, r, d = q // 2, p, q - p
        p //= 2
    needed, kept = {count // 2 - 1, count // 2}, []
    for pair in reversed(pairs):
        if needed & set(pair):
            needed |= set(pair)
            kept.append(pair)
    return np.array(kept[::-1])


@fast
def _exchange(low, high):
    for i in range(low.size):
        a, b = low[i], high[i]
        low[i] = min(a, b)
        high[i] = max(a, b)


@fast
def _medians(values, absent, network, out):
    """Median of each column of `values` (count, BLOCK), sorted in place.

    absent: 1 where an odd number of values is ABSENT, else -1.
    """
    for k in range(network.shape[0]):
        _exchange(values[network[k, 0], : out.size], values[network[k, 1], : out.size])
    middle = values.shape[0] // 2
    below, above = values[middle - 1], values[middle]
    for i in range(out.size):
        out[i] = float32(0.5) * (below[i] + above[i]) if absent[i] < 0 else above[i]


@fast
def _gather(field, usable, absent, out):
    """Copy one neighbour of each vector to `out`; an unusable one becomes ±ABSENT in turn."""
    for i in range(out.size):
        seen = usable[i] > 0
        out[i] = field[i] if seen else ABSENT * absent[i]
        absent[i] = absent[i] if seen else -absent[i]


@fast
def _deviation(values, median):
    """Distance of one neighbour of each vector from the median, in place."""
    for i in range(values.size):
        value = values[i]
        values[i] = abs(value - median[i]) if abs(value) < ABSENT else value


@fast
def _block(field, usable, j, first, radius, epsilon, network, near, absent, median, spread, total):
    """Add the squared normalised residual of a block of row j to `total`, and store its medians.

    Arrays are padded by `radius`.
    """
    width, count = median.size, 0
    absent[:] = -1
    for r in range(j, j + 2 * radius + 1):
        for c in range(2 * radius + 1):
            if r != j + radius or c != radius:
                part = slice(first + c, first + c + width)
                _gather(field[r, part], usable[r, part], absent, near[count, :width])
                count += 1
    _medians(near, absent, network, median)
    for k in range(count):
        _deviation(near[k, :width], median)
    _medians(near, absent, network, spread)
    own = field[j + radius, first + radius : first + radius + width]
    for i in range(width):
        total[i] += ((own[i] - median[i]) / (spread[i] + epsilon)) ** 2


@compiled
def _compare(u, v, usable, own_u, own_v, near, count, above_u, below_u, above_v, below_v):
    """Count one neighbour of every vector of a row, and whether it is over `near` apart."""
    for i in range(count.size):
        one = usable[i]
        du, dv = u[i] - own_u[i], v[i] - own_v[i]
        count[i] += one
        above_u[i] += one if du > near else float32(0)
        below_u[i] += one if du < -near else float32(0)
        above_v[i] += one if dv > near else float32(0)
        below_v[i] += one if dv < -near else float32(0)


@compiled
def _compare_row(u, v, usable, j, radius, near, counts):
    """`_compare` of all neighbours of row j: counts (5, nx)."""
    nx = counts.shape[1]
    counts[:] = 0
    own = slice(radius, radius + nx)
    for r in range(j, j + 2 * radius + 1):
        for c in range(2 * radius + 1):
            if r != j + radius or c != radius:
                other = slice(c, c + nx)
                _compare(
                    u[r, other], v[r, other], usable[r, other],
                    u[j + radius, own], v[j + radius, own], near,
                    counts[0], counts[1], counts[2], counts[3], counts[4],
                )  # fmt: skip


@compiled
def _all_near(counts):
    """Whether under half of each vector's neighbours lie far from it on any one side."""
    for i in range(counts.shape[1]):
        far = max(counts[1, i], counts[2, i], counts[3, i], counts[4, i])
        if counts[0, i] < 3 or 2 * far >= counts[0, i]:
            return False
    return True


@compiled
def _normalised_median(
    u, v, usable, epsilon, radius, threshold, network, residual, median_u, median_v
):
    """Fields are padded by `radius`, the results are not."""
    ny, nx = residual.shape
    near = np.empty(((2 * radius + 1) ** 2 - 1, BLOCK), float32)
    absent = np.empty(BLOCK, float32)
    spread = np.empty(BLOCK, float32)
    counts = np.empty((5, nx), float32)
    enough = threshold * epsilon / float32(np.sqrt(2.0))
    for j in range(ny):
        _compare_row(u, v, usable, j, radius, enough, counts)
        for first in range(0, nx, BLOCK):
            last = min(first + BLOCK, nx)
            n = last - first
            s = slice(first, last)
            if _all_near(counts[:, s]):
                # every median is near enough to pass whatever the spread: spare the sorting
                own = slice(first + radius, last + radius)
                residual[j, s] = 0
                median_u[j, s] = u[j + radius, own]
                median_v[j, s] = v[j + radius, own]
                continue
            residual[j, s] = 0
            for field, median in ((u, median_u), (v, median_v)):
                _block(
                    field, usable, j, first, radius, epsilon, network,
                    near, absent[:n], median[j, s], spread[:n], residual[j, s],
                )  # fmt: skip
            for i in range(first, last):
                residual[j, i] = np.sqrt(residual[j, i])
                if counts[0, i] < 3:
                    residual[j, i] = median_u[j, i] = median_v[j, i] = np.nan


def normalised_median(
    u, v, usable, *, epsilon: float = 0.2, radius: int = 1, threshold: float = 0.0
):
    """Residual of each vector against its neighbours' median, over their spread plus `epsilon`.

    u, v: (ny, nx) px, finite; usable: bool, vectors that may serve as neighbours. Returns
    (residual, median_u, median_v), NaN where fewer than three neighbours exist. With a `threshold`,
    vectors whose medians are too near for them to fail may get the residual 0 and themselves as
    median. Source: Westerweel & Scarano 2005, eq. 2, both components joined as a vector length.
    """
    residual, median_u, median_v = (np.empty(u.shape, float32) for _ in range(3))
    u, v, usable = (np.pad(np.asarray(f, float32), radius) for f in (u, v, usable))
    network, results = _median_network((2 * radius + 1) ** 2 - 1), (residual, median_u, median_v)
    limits = float32(epsilon), radius, float32(threshold)
    _normalised_median(u, v, usable, *limits, network, *results)
    return results


def supported(known, masked, correlation, *, doubtful: float, across: int):
    """`known` (bool) without vectors of doubtful correlation most of whose neighbours have failed.

    In images that have nothing in common one vector in ten passes every other test by chance, and
    warping along it raises its correlation to 0.2-0.4 and a few times above it. masked: vectors
    that no neighbour can be; across: nodes of a neighbourhood, an odd number.
    """
    box, border = (across, across), cv2.BORDER_REPLICATE
    unmasked = cv2.blur((~masked).astype(float32), box, borderType=border)
    for _ in range(SUPPORT_ROUNDS):
        share = cv2.blur((known & ~masked).astype(float32), box, borderType=border)
        rare = (known & ~masked).sum() < RARE * (~masked).sum()
        alone = known & (correlation < doubtful) & (rare | (share < SUPPORT * unmasked))
        if rare:
            alone |= known & (share < LEAST_SUPPORT * unmasked)
        if not alone.any():
            break
        known = known & ~alone
    return known


def fill_absent(u, v, usable):
    """Copies of u, v with the mean of filled neighbours for unusable vectors, working inwards.

    A predictor for the next pass, or a replacement that the user asked for. Zero where nothing is
    usable.
    """
    u, v, known = u.astype(float32), v.astype(float32), usable.copy()
    if not known.any():
        return np.zeros_like(u), np.zeros_like(v)
    _fill_rings(u, v, known, np.argwhere(~known))
    return u, v


@compiled
def _fill_rings(u, v, known, missing):
    ny, nx = u.shape
    left = missing.shape[0]
    ring = np.empty_like(missing)
    while left:
        count, left, filled = left, 0, 0
        for k in range(count):
            j, i = missing[k]
            su = sv = 0.0
            neighbours = 0
            for r in range(max(j - 1, 0), min(j + 2, ny)):
                for c in range(max(i - 1, 0), min(i + 2, nx)):
                    if known[r, c]:
                        su += u[r, c]
                        sv += v[r, c]
                        neighbours += 1
            if neighbours:
                u[j, i] = su / neighbours
                v[j, i] = sv / neighbours
                ring[filled] = j, i
                filled += 1
            else:
                missing[left] = j, i
                left += 1
        for k in range(filled):
            known[ring[k, 0], ring[k, 1]] = True
