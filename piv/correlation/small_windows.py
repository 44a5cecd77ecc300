"""Structures shorter than the window, measured again in half of it on vectors twice as dense.

What cells two apart have in common after the last step tells where the window does not follow the flow. A narrower
window is noisier, so it is used there only; vectors as dense as it needs warp the images along the structure.
"""

from __future__ import annotations

from dataclasses import fields, replace

import cv2
import numpy as np

from piv.correlation.deform import Image, Nodes
from piv.correlation.interpolate import denser
from piv.correlation.options import Options
from piv.correlation.passes import Vectors, measure
from piv.correlation.uncertainty import Errors
from piv.validation.outliers import fill_absent

COARSE = 0.5  # times the noise's variance: what a window misses at least where a narrower one takes over
LEAST = 0.15  # px: less is not worth the steps
STEPS = 4
UNSURE = (
    0.25  # px: with a larger standard uncertainty an error of half a pixel is not unlikely (5 %): an outlier
)
OVERLAP = 5  # nodes across: windows that overlap by half the one that is too wide
GAP = 9  # nodes across: between windows that are too wide no narrower place is likely to be right


def too_coarse(v: Vectors, errors: Errors) -> np.ndarray:
    """Vectors (bool) whose window misses so much displacement that a narrower one, noisier, errs less."""
    noise, missed = errors.var_x + errors.var_y, errors.missed_x + errors.missed_y
    found = v.known & (missed > np.maximum(COARSE * noise, LEAST**2))
    around = cv2.dilate(found.astype(np.uint8), np.ones((OVERLAP, OVERLAP), np.uint8))
    closed = cv2.morphologyEx(around, cv2.MORPH_CLOSE, np.ones((GAP, GAP), np.uint8))
    return closed.astype(bool) & ~v.masked


def measure_finer(
    nodes: Nodes, images: list[Image], v: Vectors, fine: np.ndarray, options: Options
) -> Vectors:
    """Vectors at the nodes, those marked `fine` (bool) measured in the narrow window; others serve for warping only.

    images: both at full resolution, filtered.
    """
    dense = Nodes(_halved(nodes.x), _halved(nodes.y), nodes.shape, 1)
    dx, dy = (denser(d) for d in fill_absent(v.dx, v.dy, v.known))
    marked = denser(fine.astype(np.float32)) > 0
    for _ in range(STEPS):
        cells = dense.moments(images[0], images[1], dx, dy)
        new = measure(dense, cells, dx, dy, options.sigma, options, options.epsilon, marked)
        dx, dy = fill_absent(new.dx, new.dy, new.known)
    nodal = [f.name for f in fields(new) if f.name not in ("cells", "fine", "narrow")]
    every = {name: getattr(new, name)[..., ::2, ::2] for name in nodal}
    return replace(new, **every, fine=fine)


def unsure(fine: np.ndarray, errors: Errors) -> np.ndarray:
    """Of the `fine` vectors those (bool) that the narrow window does not follow either."""
    worst = np.maximum(errors.var_x + errors.missed_x, errors.var_y + errors.missed_y)
    return fine & (worst > UNSURE**2)


def _halved(axis: np.ndarray) -> np.ndarray:
    return np.linspace(axis[0], axis[-1], 2 * axis.size - 1)
