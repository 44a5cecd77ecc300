"""Structures shorter than the window, measured again in a window of half the side on nodes twice as dense.

Residual correlation between cells two apart shows where the window is too large for the flow. A small window is
noisier, so it is used only there.
"""

from __future__ import annotations

from dataclasses import fields, replace

import cv2
import numpy as np

from piv.correlation.deform import Image, Nodes
from piv.correlation.interpolate import denser
from piv.correlation.options import Options
from piv.correlation.passes import Displacements, measure
from piv.correlation.uncertainty import Errors
from piv.validation.outliers import fill_absent

COARSE = 0.5  # of the noise variance: least unresolved variance for which the small window is used
LEAST = 0.15  # px: least unresolved displacement for which the small window is used
STEPS = 4
UNSURE = 0.25  # px: above this standard uncertainty, 5 % of the errors exceed half a pixel: an outlier
OVERLAP = 5  # nodes across: windows that overlap by half the one that is too large
GAP = 9  # nodes across: narrower gaps between windows that are too large are closed


def window_too_large(v: Displacements, errors: Errors) -> np.ndarray:
    """Vectors (bool) whose unresolved displacement is larger than the additional noise of the small window."""
    noise, missed = errors.var_x + errors.var_y, errors.missed_x + errors.missed_y
    found = v.known & (missed > np.maximum(COARSE * noise, LEAST**2))
    around = cv2.dilate(found.astype(np.uint8), np.ones((OVERLAP, OVERLAP), np.uint8))
    closed = cv2.morphologyEx(around, cv2.MORPH_CLOSE, np.ones((GAP, GAP), np.uint8))
    return closed.astype(bool) & ~v.masked


def measure_small_windows(
    nodes: Nodes, images: list[Image], v: Displacements, small: np.ndarray, options: Options
) -> Displacements:
    """Vectors at the nodes; those marked `small` (bool) are measured in the small window, the others only warp the images.

    images: both at full resolution, filtered.
    """
    dense = Nodes(_halved(nodes.x), _halved(nodes.y), nodes.shape, 1)
    dx, dy = (denser(d) for d in fill_absent(v.dx, v.dy, v.known))
    marked = denser(small.astype(np.float32)) > 0
    for _ in range(STEPS):
        cells = dense.moments(images[0], images[1], dx, dy)
        new = measure(dense, cells, dx, dy, options.sigma, options, options.epsilon, marked)
        dx, dy = fill_absent(new.dx, new.dy, new.known)
    nodal = [f.name for f in fields(new) if f.name not in ("cells", "small", "steep")]
    every = {name: getattr(new, name)[..., ::2, ::2] for name in nodal}
    return replace(new, **every, small=small)


def unresolved_in_small_window(small: np.ndarray, errors: Errors) -> np.ndarray:
    """Vectors (bool) of the small window whose standard uncertainty there is still too large."""
    worst = np.maximum(errors.var_x + errors.missed_x, errors.var_y + errors.missed_y)
    return small & (worst > UNSURE**2)


def _halved(axis: np.ndarray) -> np.ndarray:
    return np.linspace(axis[0], axis[-1], 2 * axis.size - 1)
