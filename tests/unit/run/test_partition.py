"""Columns of cells for many ranks: equal load, every rank in one piece, few shared faces."""

from __future__ import annotations

import numpy as np
import pytest

from fileio.errors import StageError
from pipeline.run.partition import (
    graph_text,
    partition_columns,
    pieces,
    scotch_program,
    shared_faces,
    whole_pieces,
)

LAYERS, OVER_FINGER = 16, 6

needs_scotch = pytest.mark.skipif(scotch_program() is None, reason="scotch is not installed")


def planform(n: int = 80):
    """A square of n × n columns, fewer cells over a bent finger: centres, load, pairs."""
    x, y = np.meshgrid(*2 * [np.linspace(0, 1, n) ** 2])  # graded like a real planform
    load = np.full((n, n), float(LAYERS))
    load[np.abs(np.hypot(x - 0.5, y) - 0.3) < 0.04] = OVER_FINGER
    load[-4:, -4:] = 0
    number = np.arange(n * n).reshape(n, n)
    pairs = [np.stack([number[:, :-1], number[:, 1:]], -1), np.stack([number[:-1], number[1:]], -1)]
    centres = np.column_stack([x.ravel(), y.ravel()])
    return centres, load.ravel(), np.vstack([p.reshape(-1, 2) for p in pairs])


@pytest.mark.parametrize("method", ["bisection", pytest.param("scotch", marks=needs_scotch)])
@pytest.mark.parametrize("ranks", [2, 7, 64])
def test_every_rank_is_balanced_and_in_one_piece(method, ranks):
    centres, load, pairs = planform()
    rank = partition_columns(centres, load, ranks, pairs, method)
    total = np.bincount(rank, load, ranks)
    # one of 100 columns is 1 %; scotch itself allows 5 %, and a stray piece more
    assert total.max() < 1.10 * total.mean()
    assert total.min() > 0.85 * total.mean()
    piece = pieces(rank, load, pairs)
    assert len(np.unique(piece[load > 0])) == ranks


def test_without_neighbours_it_is_bisection_as_ever():
    centres, load, _ = planform(20)
    total = np.bincount(partition_columns(centres, load, 4), load, 4)
    assert total.max() < 1.05 * total.mean()


@needs_scotch
def test_scotch_shares_fewer_faces_and_is_the_same_each_time():
    centres, load, pairs = planform()
    cut = {}
    for method in ("bisection", "scotch"):
        rank = partition_columns(centres, load, 16, pairs, method)
        cut[method] = shared_faces(load, pairs)[rank[pairs[:, 0]] != rank[pairs[:, 1]]].sum()
        np.testing.assert_array_equal(rank, partition_columns(centres, load, 16, pairs, method))
    assert cut["scotch"] < cut["bisection"]


def test_scotch_asked_for_but_missing_names_the_command(monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    centres, load, pairs = planform(10)
    with pytest.raises(StageError, match="apt-get install scotch"):
        partition_columns(centres, load, 2, pairs, "scotch")


def test_a_stray_piece_goes_to_its_neighbour():
    _, load, pairs = planform(6)
    load[:] = 1
    rank = np.repeat([0, 1], 18)
    rank[2] = 1  # an island of rank 1 in rank 0's half
    np.testing.assert_array_equal(whole_pieces(rank, load, pairs), np.repeat([0, 1], 18))


def test_graph_text():
    """Three columns in a row, the middle one with five cells and four shared faces on its right."""
    text = graph_text(np.array([6, 5, 4]), np.array([[0, 1], [1, 2]]), np.array([5, 4]))
    assert text == "0\n3 4\n0 011\n6 1 5 1\n5 2 4 2 5 0\n4 1 4 1\n"
