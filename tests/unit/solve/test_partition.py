"""Columns of cells for many ranks: equal load, every rank in one piece, few shared faces."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pipeline.solve.prepare import partition_columns

LAYERS, OVER_FINGER = 16, 6


def planform(n: int = 80):
    """Centres, load and pairs of n × n columns, fewer cells over a finger, none in one corner."""
    x, y = np.meshgrid(np.linspace(0, 1, n) ** 2, np.linspace(0, 1, n) ** 2)  # graded
    load = np.full((n, n), float(LAYERS))
    load[np.abs(np.hypot(x - 0.5, y) - 0.3) < 0.04] = OVER_FINGER
    load[-4:, -4:] = 0
    number = np.arange(n * n).reshape(n, n)
    pairs = [np.stack([number[:, :-1], number[:, 1:]], -1), np.stack([number[:-1], number[1:]], -1)]
    centres = np.column_stack([x.ravel(), y.ravel()])
    return centres, load.ravel(), np.vstack([p.reshape(-1, 2) for p in pairs])


@pytest.mark.parametrize("ranks", [2, 7, 64])
def test_every_rank_is_balanced_and_in_one_piece(ranks):
    centres, load, pairs = planform()
    rank = partition_columns(centres, load, ranks, pairs)
    total = np.bincount(rank, load, ranks)
    # a rank has 100 columns at 64 ranks: one column more or less is 1 %
    assert total.max() < 1.10 * total.mean()
    assert total.min() > 0.85 * total.mean()
    inside = (rank[pairs[:, 0]] == rank[pairs[:, 1]]) & (load[pairs] > 0).all(1)
    a, b = pairs[inside].T
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(len(rank), len(rank)))
    assert len(np.unique(connected_components(graph, directed=False)[1][load > 0])) == ranks
