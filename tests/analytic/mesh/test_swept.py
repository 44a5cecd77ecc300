"""Carrying a flow from one swept mesh to another: sums, order and energy."""

import numpy as np
import pytest
import xarray as xr

from pipeline.formats.mesh_intervals import Interval, IntervalMesh
from pipeline.solve.map_fields import (
    SweptCells,
    carry,
    energy_share,
    overlap_of,
    square_sum,
    swept_cells,
)

LEVELS = np.array([-0.3, -0.2, 0.0])
HOLE = 0.25, 0.75  # of the unit square: a body that moves, in the front layer only


def velocity(points: np.ndarray) -> np.ndarray:
    """A flow that is linear in the plane, (…, 3)."""
    x, y = points[..., 0], points[..., 1]
    return np.stack([0.3 + 2 * x - y, -0.1 + 0.5 * x - 2 * y, x + y], -1)


def vortex(points: np.ndarray) -> np.ndarray:
    """A smooth flow that is not, (…, 3)."""
    x, y = np.pi * points[..., 0], np.pi * points[..., 1]
    u, v = np.sin(x) * np.cos(2 * y), -np.cos(x) * np.sin(2 * y)
    return np.stack([u, v, np.sin(x) * np.sin(y)], -1)


class Moving:
    """Nodes at one instant, and their velocities, as of a motion."""

    def __init__(self, nodes, velocity):
        self.nodes, self.velocity = (lambda time: nodes), (lambda time: velocity)


def square(count: int, seed: int, bent: float = 0.2) -> SweptCells:
    """The unit square in about count² cells, with some triangles and moved nodes."""
    rng = np.random.default_rng(seed)
    line = np.linspace(0, 1, 4 * count + 1)
    x, y = np.meshgrid(line, line, indexing="ij")
    nodes = np.stack([x, y], -1).reshape(-1, 2)
    inner = ((nodes > 1e-9) & (nodes < 1 - 1e-9)).all(1)
    free = inner & (np.abs(np.abs(nodes - 0.5).max(1) - 0.25) > 1e-9)  # not on the hole's edge
    nodes[free] += bent * line[1] * rng.uniform(-1, 1, (int(free.sum()), 2))
    index = np.arange(len(nodes)).reshape(len(line), -1)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], -1)
    quads = quads.reshape(-1, 4)
    # away from the corners, where a triangle has one neighbour
    low = np.abs(nodes[quads].mean(1)[:, 1] - 0.4) < 0.15
    cut = quads[low]
    triangles, quads = np.vstack([cut[:, :3], cut[:, [0, 2, 3]]]), quads[~low]
    corner = [nodes[cells].mean(1) for cells in (triangles, quads)]
    hole = ((np.vstack(corner) > HOLE[0]) & (np.vstack(corner) < HOLE[1])).all(1)
    exists = np.ones((len(hole), 2), bool)
    exists[hole, 1] = False
    column, layer = np.nonzero(exists)
    cells = {"triangles": (("t", "c3"), triangles), "quads": (("q", "c4"), quads)}
    planform = xr.Dataset(cells | {"levels": ("level", LEVELS)})
    sweep = xr.Dataset({"cell_column": ("cell", column), "cell_layer": ("cell", layer)})
    motion = Moving(nodes, velocity(nodes)[:, :2])
    return swept_cells(IntervalMesh(Interval(0, 0, 0, 1, 0), planform, sweep, motion), 0.0)


def centres(cells: SweptCells) -> np.ndarray:
    return cells.centre[cells.column]


@pytest.fixture(scope="module")
def meshes():
    source, target = square(5, 1), square(6, 2)
    return source, target, overlap_of(source, target)


def test_the_overlaps_fill_the_target(meshes):
    source, target, overlap = meshes
    assert np.bincount(overlap.target, overlap.area) == pytest.approx(target.area, rel=1e-9)
    assert np.bincount(overlap.source, overlap.area) == pytest.approx(source.area, rel=1e-9)


def test_a_linear_flow_is_carried_exactly(meshes):
    """Up to rounding: gradients, overlaps and centroids are exact, and walls move with it."""
    source, target, overlap = meshes
    values = velocity(centres(source))
    for result in carry(source, target, overlap, values[:, :2], no_slip=True):
        assert np.abs(result - velocity(centres(target))[:, :2]).max() < 1e-9
    for result in carry(source, target, overlap, values[:, 2:], no_slip=False):
        assert np.abs(result - velocity(centres(target))[:, 2:]).max() < 1e-9


def test_averages_keep_sums_over_the_volume(meshes):
    source, target, overlap = meshes
    values = np.random.default_rng(3).normal(size=(len(source.column), 3))
    averaged, _ = carry(source, target, overlap, values, no_slip=False)
    kept, wanted = target.volume @ averaged, source.volume @ values
    assert kept == pytest.approx(wanted, abs=1e-9 * np.abs(values).max())


def test_a_smooth_flow_is_carried_to_second_order():
    errors = {0: [], 1: []}
    for count in (4, 8):
        source, target = square(count, 1, bent=0.0), square(count + count // 2, 2, bent=0.0)
        overlap, flow = overlap_of(source, target), vortex(centres(source))
        for kind, result in enumerate(carry(source, target, overlap, flow, no_slip=False)):
            error = result - vortex(centres(target))
            errors[kind].append(np.sqrt(square_sum(target, error, error)))
    for coarse, fine in errors.values():
        # rows beside the hole are one-sided
        assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.3)


@pytest.mark.parametrize("counts", [(5, 6), (6, 4)])
def test_the_share_of_samples_keeps_the_energy(counts):
    """On finer and on coarser cells."""
    source, target = square(counts[0], 1), square(counts[1], 2)
    overlap = overlap_of(source, target)
    flow = vortex(centres(source))
    averaged, sampled = carry(source, target, overlap, flow, no_slip=False)
    share = energy_share(source, target, flow, averaged, sampled)
    assert -1 < share < 2
    carried = averaged + share * (sampled - averaged)
    before, after = square_sum(source, flow, flow), square_sum(target, carried, carried)
    assert after == pytest.approx(before, rel=1e-12)
    for each in (averaged, sampled):  # neither keeps it by itself
        assert square_sum(target, each, each) != pytest.approx(before, rel=1e-3)
    assert energy_share(source, target, 0 * flow, 0 * averaged, 0 * sampled) == 0.0  # at rest
