"""Pressure from its gradient: weighted least squares over all links between neighbours."""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse
from numpy import ndarray
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu


class Links(NamedTuple):
    """Pairs of neighbouring points of a grid.

    points: (y, x) bool, those that hang together. first, second: (link,) numbers of a link's ends
    among them, along x and then along y; `along_x` of them are along x. steps: (link,) m.
    """

    points: ndarray
    first: ndarray
    second: ndarray
    along_x: int
    steps: ndarray

    def middle(self, of_x: ndarray, of_y: ndarray | None = None) -> ndarray:
        """Mean over both ends (…, link): of `of_x` (…, y, x) along x, of `of_y` along y."""
        values = [f[..., self.points] for f in (of_x, of_x if of_y is None else of_y)]
        ends = self.first, self.second
        n = self.along_x
        x, y = (
            sum(f[..., end[part]] for end in ends) / 2
            for f, part in zip(values, (slice(n), slice(n, None)), strict=True)
        )
        return np.concatenate([x, y], axis=-1)

    def grid(self, values: ndarray) -> ndarray:
        """Values (…, point) on the grid (…, y, x), NaN elsewhere."""
        out = np.full((*values.shape[:-1], *self.points.shape), np.nan)
        out[..., self.points] = values
        return out


def links(ok: ndarray, dx: float, dy: float) -> Links:
    """Links between the points of the largest part of `ok` (y, x) that hangs together."""
    number = np.where(ok, np.cumsum(ok).reshape(ok.shape) - 1, -1)
    ends = _neighbours(number)
    graph = sparse.coo_array(
        (np.ones(len(ends[0])), (ends[0], ends[1])), shape=(ok.sum(), ok.sum())
    )
    _, part = connected_components(graph, directed=False)
    points = np.zeros(ok.shape, bool)
    points[ok] = part == np.bincount(part, minlength=1).argmax()
    first, second, along_x = _neighbours(
        np.where(points, np.cumsum(points).reshape(ok.shape) - 1, -1)
    )
    steps = np.where(np.arange(len(first)) < along_x, dx, dy)
    return Links(points, first, second, along_x, steps)


def _neighbours(number: ndarray) -> tuple[ndarray, ndarray, int]:
    """Numbers of both points of each pair of neighbours, and how many pairs lie along x."""
    pairs = [(number[:, :-1], number[:, 1:]), (number[:-1], number[1:])]
    both = [(a >= 0) & (b >= 0) for a, b in pairs]
    first, second = (
        np.concatenate([pair[k][there] for pair, there in zip(pairs, both, strict=True)])
        for k in (0, 1)
    )
    return first, second, int(both[0].sum())


class Integral:
    """Least squares over links whose differences have the variance `variance` (link,) Pa²."""

    def __init__(self, net: Links, variance: ndarray) -> None:
        self.variance = variance
        count, size = len(net.first), int(net.points.sum())
        rows = np.tile(np.arange(count), 2)
        columns = np.concatenate([net.first, net.second])
        signs = np.repeat([-1.0, 1.0], count)
        self._differences = sparse.csr_array((signs, (rows, columns)), shape=(count, size))
        self._weights = float(np.median(variance)) / variance
        normal = self._differences.T @ (self._weights[:, None] * self._differences)
        # The constant is free: a spring that is weak against rounding alone holds it.
        normal = (normal + 1e-9 * sparse.eye_array(size)).tocsc()
        options = {"SymmetricMode": True}
        self._solved = splu(
            normal,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            panel_size=2,  # of a plane's narrow supernodes: half the time of the default
            options=options,
        )

    def __call__(self, differences: ndarray) -> tuple[ndarray, ndarray]:
        """Pressure (…, point) of differences (…, link), Pa, and what each link is off it."""
        flat = differences.reshape(-1, differences.shape[-1]).T
        values = self._solved.solve(self._differences.T @ (self._weights[:, None] * flat))
        off = self._differences @ values - flat
        lead = differences.shape[:-1]
        return values.T.reshape(*lead, -1), off.T.reshape(*lead, -1)
