"""One Newton step on the windowed correlation of two warped images, and the tests of its result."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy import float32, ndarray

from piv.compiled import compiled
from piv.correlation.nodes import Nodes, spline_value
from piv.correlation.options import Options
from piv.correlation.prefilter import CELL_NOISE
from piv.validation.outliers import normalised_median

NEAR = 0.75  # side over the largest window's: smaller windows are tested against 3 x 3 neighbours


@dataclass(frozen=True, eq=False)
class Displacements:
    """Displacements at the nodes (px, image axes), their tests and the sums they come from."""

    dx: ndarray
    dy: ndarray
    known: ndarray  # bool: passed every test
    masked: ndarray  # bool: too little of the window could be used
    second: ndarray  # bool: taken from the second correlation peak
    correlation: ndarray
    step_x: ndarray
    step_y: ndarray
    cells: ndarray
    sums: ndarray
    visible: ndarray  # share of the window's weight that could be used
    cell_noise: float = CELL_NOISE  # of the filter (piv.correlation.prefilter)
    least: float = Options.min_correlation  # correlation of a vector that passed
    # side of the window over the largest (piv.correlation.adaptive_windows)
    ratio: ndarray | None = None
    steep: ndarray | None = None  # bool: measured by piv.correlation.steep_regions

    TESTED: ClassVar = ("dx", "dy", "known", "correlation", "step_x", "step_y", "visible")

    @property
    def near(self) -> ndarray | None:
        """Vectors (bool) of small windows, to be tested against the nearest neighbours only."""
        return None if self.ratio is None else self.ratio < NEAR


def measure(
    nodes: Nodes,
    cells: ndarray,
    window_sums: tuple,
    dx,
    dy,
    options: Options,
    epsilon: float,
    near: ndarray | None = None,
) -> Displacements:
    """One Newton step from the predictor (dx, dy), and the tests of its result.

    window_sums: of the cells, and of the weights of whole windows; near: as of `deviates`.
    """
    sums, full = window_sums
    step_x, step_y, correlation = newton_step(sums, 1.0)
    new_x = spline_value(dx) + step_x * nodes.factor
    new_y = spline_value(dy) + step_y * nodes.factor
    masked = sums[8] < (1 - options.max_masked) * full
    usable = ~masked & (correlation > options.min_correlation)
    known = usable & ~deviates(new_x, new_y, usable, epsilon, options, near)
    no = np.zeros(known.shape, bool)
    seen = sums[8] / full
    return Displacements(
        new_x, new_y, known, masked, no, correlation, step_x, step_y, cells, sums, seen
    )


def deviates(
    dx, dy, usable: ndarray, epsilon: float, options: Options, near: ndarray | None
) -> ndarray:
    """Vectors (bool) that fail the normalised median test; usable: possible neighbours.

    5 x 5 neighbours; of vectors (bool) marked `near` 3 x 3, since farther neighbours may lie in the
    next wave.
    """
    threshold = options.threshold

    def failed(radius: int) -> ndarray:
        test = normalised_median(
            dx, dy, usable, epsilon=epsilon, radius=radius, threshold=threshold
        )
        return test[0] > threshold

    if near is None or near.all():
        return failed(2 if near is None else 1)
    return np.where(near, failed(1), failed(2))


@compiled
def _solve(sums, limit, step_x, step_y, correlation):
    ny, nx = step_x.shape
    for j in range(ny):
        for i in range(nx):
            step_x[j, i] = step_y[j, i] = correlation[j, i] = 0
            energy = np.sqrt(max(sums[5, j, i] * sums[6, j, i], float32(0)))
            if energy <= 0:
                continue
            gx, gy = sums[0, j, i], sums[1, j, i]
            correlation[j, i] = sums[7, j, i] / energy
            # without common texture no curvature can be trusted: the floor keeps the step small
            floor = float32(0.025) * energy
            hxx = max(sums[2, j, i], floor)
            hyy = max(sums[4, j, i], floor)
            bound = float32(0.8) * np.sqrt(hxx * hyy)
            hxy = min(max(sums[3, j, i], -bound), bound)
            det = hxx * hyy - hxy * hxy
            if not det > 0:  # texture so faint that its square underflows
                continue
            sx = (hyy * gx - hxy * gy) / det
            sy = (hxx * gy - hxy * gx) / det
            length = np.sqrt(sx * sx + sy * sy)
            if length > limit:
                sx *= limit / length
                sy *= limit / length
            step_x[j, i] = sx
            step_y[j, i] = sy


def newton_step(sums: ndarray, limit: float) -> tuple[ndarray, ndarray, ndarray]:
    """Solve H d = g at every node: (step_x, step_y, correlation coefficient of the window).

    sums: (MOMENTS, ny, nx) window sums; steps are at most `limit` px; no texture, no step.
    """
    step_x, step_y, correlation = (np.empty(sums.shape[1:], float32) for _ in range(3))
    _solve(sums, float32(limit), step_x, step_y, correlation)
    return step_x, step_y, correlation
