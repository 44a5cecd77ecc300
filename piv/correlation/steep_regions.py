"""Regions of poor correlation measured again from their edge inwards.

Where displacements change by more than half a pixel per pixel, no window of the first passes sees a whole pattern
and a Newton step has nothing to start from. Vectors around such a region are good; continued linearly they warp
the images well enough one vector farther in, and so on to the middle, or to the wall of a body.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from scipy import ndimage

from piv.correlation import newton_step as refine
from piv.correlation.deform import Image, Nodes, spline_value
from piv.correlation.interpolate import denser
from piv.correlation.options import Options
from piv.correlation.passes import NARROW, Vectors, deviates
from piv.validation.outliers import fill_absent

POOR, SPREADS = (
    0.8,
    8.0,
)  # of the median correlation, median deviations below it: what is lower is measured again
MOST = 0.25  # of all vectors: more are no region but the images
FEWEST = 3  # vectors of a region: fewer are noise, or outliers that the median test knows
ROUNDS = 10  # of one step inwards and one Newton step
BORDER = 4  # nodes around a region that take part in its measurement
NARROWER = 0.75  # of the window while growing: fewer wrong vectors share it
LOST = 0.7  # of the median correlation: below it in the end, a vector is an outlier
WHOLE = 0.9  # share of a window's weight that may be used: below it, the final window is narrow too


def regrow(
    nodes: Nodes, images: list[Image], vectors: Vectors, options: Options, *, final: bool = False
) -> Vectors:
    """`vectors` with those of poor correlation replaced where another start correlates better.

    images: both at full resolution. vectors.dx, dy must be filled. `final`: measure in a narrower window on nodes
    twice as dense, the vectors with a partly masked window too; otherwise correlation and known stay as they are.
    """
    free = ~vectors.masked
    if not free.any():
        return vectors
    median = float(np.median(vectors.correlation[free]))
    spread = float(np.median(np.abs(vectors.correlation[free] - median)))
    target = min(POOR * median, median - SPREADS * spread)
    # windows cut off by the image's edge correlate less, and nothing says that the flow is steep there
    edge = 2 * options.sigma
    inner = [(a > edge) & (a < n - 1 - edge) for a, n in zip((nodes.y, nodes.x), nodes.shape, strict=True)]
    free &= np.outer(*inner)
    poor = free & (vectors.correlation < target)
    if poor.sum() > MOST * free.sum():
        return vectors
    if final:
        poor |= free & (vectors.visible < WHOLE)  # beside a body
    if not poor.any():
        return vectors
    labels, _ = ndimage.label(cv2.dilate(poor.astype(np.uint8), np.ones((5, 5), np.uint8)))
    dx, dy, correlation = vectors.dx.copy(), vectors.dy.copy(), vectors.correlation.copy()
    for k, box in enumerate(ndimage.find_objects(labels), start=1):
        if np.count_nonzero(poor[box] & (labels[box] == k)) < FEWEST:
            poor[box] &= labels[box] != k
            continue
        rows, columns = (
            slice(max(s.start - BORDER, 0), min(s.stop + BORDER, n))
            for s, n in zip(box, poor.shape, strict=True)
        )
        if min(rows.stop - rows.start, columns.stop - columns.start) < 4:
            poor[box] = False
            continue
        part = (rows, columns)
        new = _region(nodes, images, vectors, poor[part], part, target, options, 2 if final else 1)
        dx[part], dy[part] = new[:2]
        correlation[part] = np.where(poor[part], new[2], correlation[part])
    if not final:
        return replace(vectors, dx=dx, dy=dy)
    usable = (
        ~vectors.masked
        & (correlation > options.min_correlation)
        & ~(poor & (correlation < LOST / POOR * target))
    )
    failed = deviates(dx, dy, usable, options.epsilon, options, vectors.fine)
    known = usable & ~failed & (vectors.known | poor)
    return replace(vectors, dx=dx, dy=dy, correlation=correlation, narrow=poor, known=known)


def _region(nodes, images, vectors, poor, part, target, options, finer):
    """Best displacements found in one region (part: slices of nodes) and their correlation."""
    local, crops = _cut(nodes, images, part, finer)
    dx, dy = vectors.dx[part], vectors.dy[part]
    masked = vectors.masked[part]
    sigma = (NARROWER if finer == 1 else NARROW) * options.sigma

    def step_from(dx, dy):
        cells = local.moments(crops[0], crops[1], dx, dy)
        sums, full = local.window_sums(cells, sigma)
        step_x, step_y, correlation = refine.newton_step(sums, 1.0)
        hidden = sums[8] < (1 - options.max_masked) * full
        return spline_value(dx) + step_x, spline_value(dy) + step_y, correlation, hidden

    dx, dy = continue_linearly(dx, dy, ~masked)
    if finer > 1:
        dx, dy = denser(dx), denser(dy)
        poor = denser(poor.astype(np.float32)) > 0
    best_x, best_y = dx, dy
    new_x, new_y, best, masked = step_from(dx, dy)
    correlation = best
    if finer > 1:
        best_x, best_y = np.where(poor, new_x, dx), np.where(poor, new_y, dy)
    for k in range(ROUNDS):
        low = poor & (correlation < target)
        if not low.any() and (finer == 1 or k > 1):
            break
        dx, dy = continue_linearly(np.where(poor, new_x, dx), np.where(poor, new_y, dy), ~low & ~masked)
        for _ in range(2):
            new_x, new_y, correlation, masked = step_from(dx, dy)
            better = poor & (correlation > best)
            best = np.where(better, correlation, best)
            best_x, best_y = np.where(better, new_x, best_x), np.where(better, new_y, best_y)
            dx, dy = np.where(poor, new_x, dx), np.where(poor, new_y, dy)
            dx, dy = continue_linearly(dx, dy, ~masked)
    return best_x[::finer, ::finer], best_y[::finer, ::finer], best[::finer, ::finer]


def _cut(nodes: Nodes, images: list[Image], part: tuple[slice, slice], finer: int):
    """The nodes and images of a region with the windows around it."""
    margin = 32
    spans = []
    for axis, s, length in ((nodes.x, part[1], nodes.shape[1]), (nodes.y, part[0], nodes.shape[0])):
        first = max(int(axis[s.start]) - margin, 0) // refine.CELL * refine.CELL
        spans.append((first, min(int(axis[s.stop - 1]) + margin, length)))
    (c0, c1), (r0, r1) = spans
    x, y = (np.linspace(a[0], a[-1], finer * (a.size - 1) + 1) for a in (nodes.x[part[1]], nodes.y[part[0]]))
    local = Nodes(x - c0, y - r0, (r1 - r0, c1 - c0), 1)
    return local, [i.crop(r0, r1, c0, c1) for i in images]


REACH = 3  # nodes: good vectors that a plane is fitted to
WIDTH = 1.5  # nodes: standard deviation of their weight
RIDGE = 0.1  # nodes²: holds the slope down where the good vectors lie on a line
LEAST = 0.1  # weight of good vectors below which no plane is fitted

_AXIS = np.arange(-REACH, REACH + 1, dtype=np.float32)
_BELL = np.exp(-0.5 * (_AXIS / WIDTH) ** 2)


def _sums(field: np.ndarray) -> list[np.ndarray]:
    """Weighted sums of field times 1, x, y around every node, x and y in nodes."""

    def sums(kernel_x, kernel_y):
        return cv2.sepFilter2D(field, cv2.CV_32F, kernel_x, kernel_y, borderType=cv2.BORDER_CONSTANT)

    return [sums(_BELL, _BELL), sums(_AXIS * _BELL, _BELL), sums(_BELL, _AXIS * _BELL)]


def continue_linearly(u: np.ndarray, v: np.ndarray, good: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Copies of u, v (ny, nx) whose other vectors are planes fitted to the `good` ones within three nodes.

    Beyond their reach vectors are filled by neighbours' means, as by `fill_absent`.
    """
    weight = good.astype(np.float32)
    m, mx, my = _sums(weight)
    axis2 = _AXIS**2 * _BELL
    mxx = cv2.sepFilter2D(weight, cv2.CV_32F, axis2, _BELL, borderType=cv2.BORDER_CONSTANT)
    myy = cv2.sepFilter2D(weight, cv2.CV_32F, _BELL, axis2, borderType=cv2.BORDER_CONSTANT)
    mxy = cv2.sepFilter2D(weight, cv2.CV_32F, _AXIS * _BELL, _AXIS * _BELL, borderType=cv2.BORDER_CONSTANT)
    total = np.maximum(m, 1e-9)
    cx, cy = mx / total, my / total  # centroid of the good vectors
    xx, yy, xy = mxx / total - cx**2 + RIDGE, myy / total - cy**2 + RIDGE, mxy / total - cx * cy
    det = xx * yy - xy**2
    fitted = ~good & (m > LEAST)
    out = []
    for field in (u, v):
        f, fx, fy = _sums(np.where(good, field, 0).astype(np.float32))
        mean = f / total
        gx, gy = fx / total - cx * mean, fy / total - cy * mean
        slope_x, slope_y = (yy * gx - xy * gy) / det, (xx * gy - xy * gx) / det
        out.append(np.where(fitted, mean - slope_x * cx - slope_y * cy, field))
    return fill_absent(out[0], out[1], good | fitted)
