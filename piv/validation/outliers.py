"""Outliers on a regular grid: normalised median (Westerweel & Scarano 2005), and vectors that stand alone."""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit

SUPPORT = 0.5  # share of the neighbours that must have passed
RARE = 0.2  # share of all vectors: where fewer have passed, those of doubtful correlation did so by chance
LEAST_SUPPORT = 0.25  # of the neighbours, where vectors are rare: a seeded part has it along its edge
SUPPORT_ROUNDS = 4  # each takes away what the one before has left alone


@njit(cache=True, nogil=True)
def _median(values, n):
    for i in range(1, n):  # insertion sort: at most 24 neighbours
        v = values[i]
        j = i - 1
        while j >= 0 and values[j] > v:
            values[j + 1] = values[j]
            j -= 1
        values[j + 1] = v
    half = n // 2
    if n % 2:
        return values[half]
    return 0.5 * (values[half - 1] + values[half])


@njit(cache=True, nogil=True)
def _compare(u, v, usable, own_u, own_v, near, count, above_u, below_u, above_v, below_v):
    """Count one neighbour of every vector of a row, and whether it lies more than `near` above or below it."""
    for i in range(count.size):
        one = np.int64(usable[i])
        du, dv = u[i] - own_u[i], v[i] - own_v[i]
        count[i] += one
        above_u[i] += one * (du > near)
        below_u[i] += one * (du < -near)
        above_v[i] += one * (dv > near)
        below_v[i] += one * (dv < -near)


@njit(cache=True, nogil=True)
def _compare_row(u, v, usable, j, radius, near, counts):
    """`_compare` of all neighbours of row j: counts (5, nx)."""
    ny, nx = u.shape
    counts[:] = 0
    for r in range(max(j - radius, 0), min(j + radius + 1, ny)):
        for shift in range(-radius, radius + 1):
            if r == j and shift == 0:
                continue
            own = slice(max(0, -shift), min(nx, nx - shift))
            other = slice(max(0, shift), min(nx, nx + shift))
            _compare(
                u[r, other], v[r, other], usable[r, other], u[j, own], v[j, own], near,
                counts[0, own], counts[1, own], counts[2, own], counts[3, own], counts[4, own],
            )  # fmt: skip


@njit(cache=True, nogil=True)
def _normalised_median(u, v, usable, epsilon, radius, threshold, residual, median_u, median_v):
    ny, nx = u.shape
    size = (2 * radius + 1) ** 2
    near = np.empty((2, size), np.float64)
    work = np.empty(size, np.float64)
    medians = np.empty(2, np.float64)
    counts = np.empty((5, nx), np.int64)
    for j in range(ny):
        _compare_row(u, v, usable, j, radius, threshold * epsilon / np.sqrt(2.0), counts)
        for i in range(nx):
            n = counts[0, i]
            if n < 3:
                residual[j, i] = np.nan
                median_u[j, i] = np.nan
                median_v[j, i] = np.nan
                continue
            if 2 * max(counts[1, i], counts[2, i], counts[3, i], counts[4, i]) < n:
                # both medians are near enough for the vector to pass whatever the spread: spare the sorting
                residual[j, i] = 0.0
                median_u[j, i] = u[j, i]
                median_v[j, i] = v[j, i]
                continue
            n = 0
            for r in range(max(j - radius, 0), min(j + radius + 1, ny)):
                for c in range(max(i - radius, 0), min(i + radius + 1, nx)):
                    if (r != j or c != i) and usable[r, c]:
                        near[0, n] = u[r, c]
                        near[1, n] = v[r, c]
                        n += 1
            total = 0.0
            for m in range(2):
                work[:n] = near[m, :n]
                medians[m] = _median(work, n)
                for k in range(n):
                    work[k] = abs(near[m, k] - medians[m])
                spread = _median(work, n)
                own = u[j, i] if m == 0 else v[j, i]
                total += ((own - medians[m]) / (spread + epsilon)) ** 2
            residual[j, i] = np.sqrt(total)
            median_u[j, i] = medians[0]
            median_v[j, i] = medians[1]


def normalised_median(u, v, usable, *, epsilon: float = 0.2, radius: int = 1, threshold: float = 0.0):
    """Residual of each vector against its neighbours' median, in units of their spread plus `epsilon` (px).

    u, v: (ny, nx) px, finite; usable: bool, vectors that may serve as neighbours. Returns (residual, median_u,
    median_v), NaN where fewer than three neighbours exist. With a `threshold`, a vector whose medians are too
    near for it to fail gets the residual 0 and itself as median. Source: Westerweel & Scarano 2005, eq. 2, both
    components joined as a vector length.
    """
    shape = u.shape
    residual = np.empty(shape)
    median_u, median_v = np.empty(shape), np.empty(shape)
    _normalised_median(
        np.ascontiguousarray(u, np.float64), np.ascontiguousarray(v, np.float64),
        np.ascontiguousarray(usable, np.bool_), epsilon, radius, threshold, residual, median_u, median_v,
    )  # fmt: skip
    return residual, median_u, median_v


def supported(known, masked, correlation, *, doubtful: float, across: int):
    """`known` (bool) without vectors of doubtful correlation most of whose neighbours have failed.

    In images that have nothing in common one vector in ten passes every other test by chance, and warping along it raises its
    correlation to 0.2-0.4 and a few times above it. masked: vectors that no neighbour can be; across: nodes of a neighbourhood, an odd number.
    """
    box, border = (across, across), cv2.BORDER_REPLICATE
    open_water = cv2.blur((~masked).astype(np.float32), box, borderType=border)
    for _ in range(SUPPORT_ROUNDS):
        share = cv2.blur((known & ~masked).astype(np.float32), box, borderType=border)
        rare = (known & ~masked).sum() < RARE * (~masked).sum()
        alone = known & (correlation < doubtful) & (rare | (share < SUPPORT * open_water))
        if rare:
            alone |= known & (share < LEAST_SUPPORT * open_water)
        if not alone.any():
            break
        known = known & ~alone
    return known


def fill_absent(u, v, usable):
    """Copies of u, v with unusable vectors replaced by the mean of filled neighbours, working inwards.

    A predictor for the next pass, or a replacement that the user asked for. Zero where nothing is usable.
    """
    u, v, known = u.astype(np.float32), v.astype(np.float32), usable.copy()
    if not known.any():
        return np.zeros_like(u), np.zeros_like(v)
    missing = np.argwhere(~known)
    while missing.size:
        _fill_ring(u, v, known, missing)
        missing = missing[~known[missing[:, 0], missing[:, 1]]]
    return u, v


@njit(cache=True, nogil=True)
def _fill_ring(u, v, known, missing):
    ny, nx = u.shape
    n = missing.shape[0]
    new = np.zeros(n, np.int64)
    for k in range(n):
        j, i = missing[k]
        su = sv = 0.0
        count = 0
        for r in range(max(j - 1, 0), min(j + 2, ny)):
            for c in range(max(i - 1, 0), min(i + 2, nx)):
                if known[r, c]:
                    su += u[r, c]
                    sv += v[r, c]
                    count += 1
        if count:
            u[j, i] = su / count
            v[j, i] = sv / count
            new[k] = 1
    for k in range(n):
        if new[k]:
            known[missing[k, 0], missing[k, 1]] = True
