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

from piv import refine
from piv.deform import Image, Nodes, spline_value
from piv.extrapolate import continue_linearly
from piv.options import Options
from piv.passes import Vectors, pair_cells

POOR = 0.8  # of the median correlation: below it a vector is measured again
MOST = 0.25  # of all vectors: more are no region but the images
ROUNDS = 6  # of one step inwards and one Newton step
BORDER = 4  # nodes around a region that take part in its measurement
NARROWER = 0.75  # of the window: fewer wrong vectors share it


def regrow(nodes: Nodes, images: list[Image], vectors: Vectors, options: Options) -> Vectors:
    """`vectors` with those of poor correlation replaced where another start correlates better.

    images: both at full resolution. vectors.dx, dy must be filled.
    """
    free = ~vectors.masked
    if not free.any():
        return vectors
    median = float(np.median(vectors.correlation[free]))
    poor = free & (vectors.correlation < POOR * median)
    count = int(poor.sum())
    if not count or count > MOST * free.sum():
        return vectors
    labels, _ = ndimage.label(cv2.dilate(poor.astype(np.uint8), np.ones((5, 5), np.uint8)))
    dx, dy = vectors.dx.copy(), vectors.dy.copy()
    for box in ndimage.find_objects(labels):
        rows, columns = (
            slice(max(s.start - BORDER, 0), min(s.stop + BORDER, n))
            for s, n in zip(box, poor.shape, strict=True)
        )
        if min(rows.stop - rows.start, columns.stop - columns.start) < 4:
            continue
        part = (rows, columns)
        new = _region(nodes, images, dx[part], dy[part], poor[part], vectors.masked[part], part, median, options)
        dx[part], dy[part] = new
    return replace(vectors, dx=dx, dy=dy)


def _region(nodes, images, dx, dy, poor, masked, part, median, options):
    """Best displacements found in one region (part: slices of nodes)."""
    local, crops, work = _cut(nodes, images, part)

    def step_from(dx, dy):
        cells = pair_cells(local, crops[0], crops[1], dx, dy, work)
        sums, _ = local.window_sums(cells, NARROWER * options.sigma)
        step_x, step_y, correlation = refine.newton_step(sums, 1.0)
        return spline_value(dx) + step_x, spline_value(dy) + step_y, correlation

    target = POOR * median
    dx, dy = continue_linearly(dx, dy, ~masked)
    best_x, best_y = dx, dy
    new_x, new_y, best = step_from(dx, dy)
    start = best.copy()
    correlation = best
    for _ in range(ROUNDS):
        low = poor & (correlation < target)
        if not low.any():
            break
        dx, dy = continue_linearly(np.where(poor, new_x, dx), np.where(poor, new_y, dy), ~low & ~masked)
        for _ in range(2):
            new_x, new_y, correlation = step_from(dx, dy)
            better = poor & (correlation > best)
            best = np.where(better, correlation, best)
            best_x, best_y = np.where(better, new_x, best_x), np.where(better, new_y, best_y)
            dx, dy = np.where(poor, new_x, dx), np.where(poor, new_y, dy)
            dx, dy = continue_linearly(dx, dy, ~masked)
    return best_x, best_y


def _cut(nodes: Nodes, images: list[Image], part: tuple[slice, slice]):
    """The nodes and images of a region with the windows around it: (nodes, images, work arrays)."""
    margin = 32
    spans = []
    for axis, s, length in ((nodes.x, part[1], nodes.shape[1]), (nodes.y, part[0], nodes.shape[0])):
        first = max(int(axis[s.start]) - margin, 0) // refine.CELL * refine.CELL
        spans.append((first, min(int(axis[s.stop - 1]) + margin, length)))
    (c0, c1), (r0, r1) = spans
    local = Nodes(nodes.x[part[1]] - c0, nodes.y[part[0]] - r0, (r1 - r0, c1 - c0), 1)
    return local, [i.crop(r0, r1, c0, c1) for i in images], np.empty((3, r1 - r0, c1 - c0), np.float32)
