"""Windows whose side follows the flow: small where structures require it, else large.

Neighbouring cells share noise to an extent that the spectra tell; what their residuals have in
common beyond that is displacement that the window does not resolve. Where it outweighs the noise of
the vectors, the window is made smaller.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy import float32, ndarray

from piv.correlation.cell_moments import CELL
from piv.correlation.newton_step import NEAR, Displacements, measure
from piv.correlation.nodes import Box, Nodes, cut, denser, with_border
from piv.correlation.options import Options
from piv.correlation.pair_images import Image
from piv.correlation.uncertainty import (
    LEAST_KEPT,
    Errors,
    correlation_statistics,
    errors_of,
    noise_budget,
    residual_gradients,
)
from piv.validation.outliers import fill_absent

LEVELS = (
    1.0,
    0.75,
    0.5,
    0.375,
)  # sides of windows over the largest; those between are their blends
_BALANCE = 2.0  # of noise over unresolved variance: where they are so, the window is right
ENOUGH = 2.0  # of the side: where so large a window would do, nodes need not be denser
# side in place of 1 where only nodes are denser: longer waves are then followed to a larger part
DENSE = 0.99
LEAST = 5  # vectors: side of the smallest region whose windows shrink
STEPS = 4  # Newton steps in the smaller windows
_AREAS = (
    10.0,
    2.5,
)  # σ of the window: where residuals are averaged, the smaller area where it is certain
_CERTAIN = 3.0  # standard errors
# noise of neighbouring cells over that of `noise_budget`, as measured in uniform flow (±0.05)
LEFT = 1.09
# of the variance that the largest window does not resolve, where nodes are denser only
_UNRESOLVED = 0.6
# on the variance of windows of a `side` in px: SMALLER (side/SIDE)^GROWTH covers 70 % of the
# errors; the wider ones leave more unresolved
SMALLER, GROWTH, SIDE = 2.2, 1.5, 32.0
ALIKE = 0.8  # mean correlation of unresolved displacement between neighbouring cells


def adapt_windows(
    nodes: Nodes, images: list[Image], v: Displacements, options: Options
) -> tuple[Displacements, Errors]:
    """Measure vectors again in smaller windows where the flow requires it; return all errors.

    images: both at full resolution, filtered.
    """
    errors = _separated(nodes, v, errors_of(nodes, v, options), options)
    ratio = _window_ratio(v, errors, options)
    if not (ratio < 1).any():
        return v, errors
    return _measure_adapted(nodes, images, v, errors, ratio, options)


def _separated(nodes: Nodes, v: Displacements, errors: Errors, options: Options) -> Errors:
    """`errors` without the unresolved displacement that neighbouring cells show with certainty."""
    spacing, sigma, steps = float(nodes.x[1] - nodes.x[0]), options.sigma, options.full_steps
    together, single = (noise_budget(sigma, spacing, steps, n)[1] for n in (True, False))
    if together < LEAST_KEPT:
        return errors
    left = LEFT * together / single * v.cell_noise
    components = []
    for g, h in zip(residual_gradients(nodes, v), (v.cells[2], v.cells[4]), strict=True):
        products = [g * g, g * _around(g), h * h, h * _around(h)]
        missed = np.zeros(g.shape, float32)
        for area in _AREAS:
            width = area * sigma / CELL
            one, nine, h_one, h_nine = (
                cv2.GaussianBlur(p, (0, 0), width, borderType=cv2.BORDER_REPLICATE)
                for p in products
            )
            shared = nine - left * one
            # of pure noise: eight products per cell, each counted from both sides
            certain = _CERTAIN * one * 4 / np.sqrt(4 * np.pi * width**2)
            curvature = np.maximum(ALIKE * (h_nine - left * h_one), 1e-12)
            # what a larger area holds may lie all on one side of the cell
            differs = (shared > certain) | (missed * curvature - shared > certain)
            missed = np.where(differs, np.maximum(shared / curvature, 0), missed)
        noise = np.clip(left * (one - missed * h_one) / np.maximum(nine, 1e-20), 0.05, 1)
        components.append([nodes.from_cells(f) for f in (missed, np.where(missed > 0, noise, 1))])
    (missed_x, share_x), (missed_y, share_y) = components
    return Errors(
        errors.var_x * share_x,
        errors.var_y * share_y,
        np.maximum(errors.missed_x, missed_x),
        np.maximum(errors.missed_y, missed_y),
    )


def _around(field: ndarray) -> ndarray:
    return cv2.boxFilter(field, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)


def _window_ratio(v: Displacements, errors: Errors, options: Options) -> ndarray:
    """Side of each vector's window over `options.window`; 1 where it is well measured already."""
    if options.least_window >= options.window:
        return np.ones(v.dx.shape, float32)
    noise, missed = errors.var_x + errors.var_y, errors.missed_x + errors.missed_y
    ratio = np.sqrt(_BALANCE * noise / np.maximum(missed, 1e-12))
    limited = np.clip(ratio, min(options.least_window / options.window, DENSE), DENSE)
    # a smaller region is chance: residuals are averaged over more
    wanted = cv2.morphologyEx(
        (ratio < ENOUGH).astype(np.uint8), cv2.MORPH_OPEN, np.ones((LEAST, LEAST), np.uint8)
    )
    return np.where((wanted > 0) & ~v.masked, limited, 1).astype(float32)


def _measure_adapted(
    nodes: Nodes,
    images: list[Image],
    v: Displacements,
    errors: Errors,
    ratio: ndarray,
    options: Options,
) -> tuple[Displacements, Errors]:
    """Vectors and errors in windows of `ratio`, on nodes twice as dense where it is below 1.

    images: both at full resolution, filtered; measured is one rectangle around all of them.
    """
    smaller = ratio < 1
    part = with_border(_least_box(smaller), nodes, options.sigma)
    dense, crops = cut(nodes, images, part, 2, options.sigma)
    dx, dy = (denser(d[part]) for d in fill_absent(v.dx, v.dy, v.known))
    sides = denser(ratio[part])
    weights = {level: w for level, w in zip(LEVELS, _shares(sides), strict=True) if w.any()}
    # before the last step it is enough to find vectors that stand out from the nearest ones
    for near in [np.ones(sides.shape, bool)] * (STEPS - 1) + [sides < NEAR]:
        cells = dense.moments(crops[0], crops[1], dx, dy)
        level_sums = {level: dense.window_sums(cells, level * options.sigma) for level in weights}
        sums = sum(weights[n] * s / full for n, (s, full) in level_sums.items())
        new = measure(dense, cells, (sums, float32(1)), dx, dy, options, options.epsilon, near)
        dx, dy = fill_absent(new.dx, new.dy, new.known)
    new = replace(new, cell_noise=v.cell_noise)
    largest = Errors(*(e[part] for e in errors))
    new_errors = _errors(
        dense, new, largest, {n: (weights[n], s) for n, (s, _) in level_sums.items()}, options
    )

    def with_new(old: ndarray, found: ndarray) -> ndarray:
        out = old.copy()
        out[part] = np.where(smaller[part], found[::2, ::2], old[part])
        return out

    tested: dict[str, Any] = {
        n: with_new(getattr(v, n), getattr(new, n)) for n in Displacements.TESTED
    }
    errors = Errors(*(with_new(*e) for e in zip(errors, new_errors, strict=True)))
    return replace(v, **tested, second=v.second & ~smaller, ratio=ratio), errors


def _least_box(where: ndarray) -> Box:
    """The least rectangle of nodes that holds all of `where`."""
    rows, columns = (np.flatnonzero(where.any(axis=axis)) for axis in (1, 0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def _shares(ratio: ndarray) -> list[ndarray]:
    """Weight of each of LEVELS in windows of `ratio`: linear between the two next to it."""
    position = np.interp(-ratio, -np.array(LEVELS), np.arange(len(LEVELS)))
    return [np.maximum(1 - np.abs(position - k), 0).astype(float32) for k in range(len(LEVELS))]


def _errors(
    nodes: Nodes, v: Displacements, largest: Errors, levels: dict, options: Options
) -> Errors:
    """`Errors` of vectors of blended windows; `levels`: their weights and sums."""
    spacing, passes = float(nodes.x[1] - nodes.x[0]), options.full_steps + STEPS - 1
    # what smaller windows do not resolve decorrelates their cells: it is counted as noise
    total = [np.zeros_like(v.dx) for _ in largest]
    for level, (weight, sums) in levels.items():
        sigma = level * options.sigma
        gain, kept = noise_budget(sigma, spacing, passes)
        alike = 0.0 if kept >= LEAST_KEPT else v.cell_noise
        if level == 1:
            gain /= noise_budget(sigma, 2 * spacing, options.full_steps)[0]
            terms = [gain * denser(e) for e in largest[:2]] + [
                _UNRESOLVED * denser(e) for e in largest[2:]
            ]
        else:
            gain, kept = noise_budget(sigma, spacing, passes, not alike)
            noise = correlation_statistics(nodes, replace(v, sums=sums), sigma, kept, alike)
            factor = SMALLER * (level * options.window / SIDE) ** GROWTH * gain
            terms = [factor * e for e in noise] + [0.0, 0.0]
        total = [t + weight * e for t, e in zip(total, terms, strict=True)]
    return Errors(*total)
