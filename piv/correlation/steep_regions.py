"""Regions of steep displacement gradients, measured again from their edge inwards.

Above half a pixel per pixel of gradient the windows of the first passes do not correlate, and
Newton steps have no start. The displacement around such a region, extrapolated linearly, warps the
images well enough for Newton steps one node farther in, and so on to the middle of the region or
the wall of a body.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy import float32, ndarray
from scipy import ndimage

from piv.correlation.newton_step import Displacements, deviates, newton_step
from piv.correlation.nodes import Nodes, cut, denser, spline_value, with_border
from piv.correlation.options import Options
from piv.correlation.pair_images import Image
from piv.correlation.uncertainty import SMALL
from piv.validation.outliers import fill_absent

# a region's correlation is below this part of the median and this many median deviations below it
POOR, SPREADS = 0.8, 8.0
MOST = 0.25  # of all vectors: more poor ones mean poor images, not a region
FEWEST = 3  # vectors of a region: fewer are noise or outliers, which the median test finds
_ROUNDS = 10  # of extrapolation and Newton steps
# rounds in succession that leave LEFT or more of the fewest poor vectors so far end the search
IDLE = 2
# 1 would go on for every vector gained, and regions took two thirds of the time of a public pair;
# to stop earlier, and to measure the poor vectors' windows alone, changed the benchmark's errors by
# 1 % at most
LEFT = 0.95
_INWARD_WINDOW = 0.75  # of the window during the passes: it holds fewer wrong vectors
LOST = 0.7  # of the median correlation: a vector below it is an outlier in the end
WHOLE = 0.9  # unmasked share of a window's weight: below it the small window is used in the end


def measure_steep_regions(
    nodes: Nodes,
    images: list[Image],
    vectors: Displacements,
    options: Options,
    *,
    final: bool = False,
) -> Displacements:
    """`vectors`, replaced in steep regions where the extrapolated start correlates better.

    images: both at full resolution. vectors.dx, dy must be filled. `final`: measure in the small
    window on nodes twice as dense, also where the window is partly masked, and test the result;
    else correlation and known are kept.
    """
    free = ~vectors.masked
    if not free.any():
        return vectors
    median = float(np.median(vectors.correlation[free]))
    spread = float(np.median(np.abs(vectors.correlation[free] - median)))
    target = min(POOR * median, median - SPREADS * spread)
    # windows cut by the image's edge correlate less without any steep gradient
    edge = 2 * options.sigma
    inner = [
        (a > edge) & (a < n - 1 - edge)
        for a, n in zip((nodes.y, nodes.x), nodes.shape, strict=True)
    ]
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
        part = with_border(box, nodes, options.sigma)
        if min(poor[part].shape) < 4:
            poor[box] = False
            continue
        new = _region(nodes, images, vectors, poor[part], part, target, options, 2 if final else 1)
        dx[part], dy[part] = new[:2]
        correlation[part] = np.where(poor[part], new[2], correlation[part])
    if not final:
        return replace(vectors, dx=dx, dy=dy)
    lost = poor & (correlation < LOST / POOR * target)
    usable = ~vectors.masked & (correlation > options.min_correlation) & ~lost
    failed = deviates(dx, dy, usable, options.epsilon, options, vectors.near)
    known = usable & ~failed & (vectors.known | poor)
    return replace(vectors, dx=dx, dy=dy, correlation=correlation, steep=poor, known=known)


def _region(nodes, images, vectors, poor, part, target, options, density):
    """Displacements of best correlation in a region (part: slices of nodes), and it."""
    local, crops = cut(nodes, images, part, density, options.sigma)
    dx, dy = vectors.dx[part], vectors.dy[part]
    masked = vectors.masked[part]
    sigma = (_INWARD_WINDOW if density == 1 else SMALL) * options.sigma

    dx, dy = _continue_linearly(dx, dy, ~masked)
    if density > 1:
        dx, dy = denser(dx), denser(dy)
        poor, masked = denser(poor.astype(float32)) > 0, denser(masked.astype(float32)) > 0.5
    wanted = local.cells_around(poor, sigma)
    correlation = np.zeros(poor.shape, float32)

    def step():
        """One Newton step of the poor vectors, whose windows alone are measured."""
        cells = local.moments(crops[0], crops[1], dx, dy, wanted)
        sums, full = local.window_sums(cells, sigma)
        step_x, step_y, found = newton_step(sums, 1.0)
        hidden = sums[8] < (1 - options.max_masked) * full
        new = spline_value(dx) + step_x, spline_value(dy) + step_y, found, hidden
        return (np.where(poor, *f) for f in zip(new, (dx, dy, correlation, masked), strict=True))

    best_x, best_y = dx, dy
    dx, dy, correlation, masked = step()
    best = correlation
    if density > 1:
        best_x, best_y = dx, dy
    fewest, idle = poor.size, 0
    for k in range(_ROUNDS):
        low = poor & (correlation < target)
        count = np.count_nonzero(low)
        idle = idle + 1 if count >= LEFT * fewest else 0
        if idle == IDLE or (not count and (density == 1 or k > 1)):
            break
        fewest = min(fewest, count)
        dx, dy = _continue_linearly(dx, dy, ~low & ~masked)
        for _ in range(2):
            dx, dy, correlation, masked = step()
            better = correlation > best
            best = np.where(better, correlation, best)
            best_x, best_y = np.where(better, dx, best_x), np.where(better, dy, best_y)
            dx, dy = _continue_linearly(dx, dy, ~masked)
    return best_x[::density, ::density], best_y[::density, ::density], best[::density, ::density]


REACH = 3  # nodes: distance to which good vectors enter the fit of a plane
WIDTH = 1.5  # nodes: standard deviation of their weight
_RIDGE = 0.1  # nodes²: limits the slope where the good vectors lie on a line
LEAST = 0.1  # total weight of good vectors below which no plane is fitted

_AXIS = np.arange(-REACH, REACH + 1, dtype=float32)
_BELL = np.exp(-0.5 * (_AXIS / WIDTH) ** 2)


def _sums(field: ndarray, *powers: tuple[int, int]) -> list[ndarray]:
    """Weighted sums of field · x^p y^q round every node for each (p, q); x and y in nodes."""
    kernels = ((_AXIS**p * _BELL, _AXIS**q * _BELL) for p, q in powers)
    return [cv2.sepFilter2D(field, cv2.CV_32F, *k, borderType=cv2.BORDER_CONSTANT) for k in kernels]


def _continue_linearly(u: ndarray, v: ndarray, good: ndarray) -> tuple[ndarray, ndarray]:
    """u, v (ny, nx) with planes fitted to `good` vectors within three nodes for the others.

    Farther away, means of neighbours replace them (`fill_absent`).
    """
    if good.all():
        return u, v
    linear = (0, 0), (1, 0), (0, 1)
    m, mx, my, mxx, myy, mxy = _sums(good.astype(float32), *linear, (2, 0), (0, 2), (1, 1))
    total = np.maximum(m, 1e-9)
    cx, cy = mx / total, my / total  # centroid of the good vectors
    xx, yy, xy = mxx / total - cx**2 + _RIDGE, myy / total - cy**2 + _RIDGE, mxy / total - cx * cy
    det = xx * yy - xy**2
    fitted = ~good & (m > LEAST)
    out = []
    for field in (u, v):
        f, fx, fy = _sums(np.where(good, field, 0).astype(float32), *linear)
        mean = f / total
        gx, gy = fx / total - cx * mean, fy / total - cy * mean
        slope_x, slope_y = (yy * gx - xy * gy) / det, (xx * gy - xy * gx) / det
        out.append(np.where(fitted, mean - slope_x * cx - slope_y * cy, field))
    return fill_absent(out[0], out[1], good | fitted)
