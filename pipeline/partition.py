"""Cutting the mesh for several ranks: whole columns only, equal load, few shared faces, every rank in one piece."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pipeline.scotch import partition_scotch, scotch_program

METHODS = ("auto", "scotch", "bisection")
REPAIRS = 10  # rounds of handing stray pieces over; two were enough for 64 ranks on every level


def partition_columns(centres: np.ndarray, load: np.ndarray, ranks: int, pairs: np.ndarray | None = None,
                      method: str = "auto") -> np.ndarray:  # fmt: skip
    """Rank of each column of cells: by scotch where its program is installed, else by recursive bisection.

    centres (column, 2) m; load (column,) cells of each, zero where a column has none; pairs (edge, 2) columns that are
    neighbours: needed by scotch, and for ranks in one piece. StageError where scotch is asked for but missing.
    """
    if pairs is not None and (method == "scotch" or (method == "auto" and scotch_program())):
        rank = partition_scotch(load, pairs, shared_faces(load, pairs), ranks)
    else:
        rank = np.zeros(len(centres), int)
        _bisect(centres, load, np.arange(len(centres)), 0, ranks, rank)
    return rank if pairs is None else whole_pieces(rank, load, pairs)


def shared_faces(load: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Faces (edge,) between neighbouring columns: over the finger's footprint only the layers that both have."""
    return np.minimum(load[pairs[:, 0]], load[pairs[:, 1]])


def pieces(rank: np.ndarray, load: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Connected piece (column,) that each column belongs to, within its rank; -1 where it has no cells."""
    inside = (rank[pairs[:, 0]] == rank[pairs[:, 1]]) & (shared_faces(load, pairs) > 0)
    a, b = pairs[inside].T
    graph = coo_array((np.ones(len(a), np.int8), (a, b)), shape=(len(rank), len(rank)))
    return np.where(load > 0, connected_components(graph, directed=False)[1], -1)


def whole_pieces(rank: np.ndarray, load: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Hand stray pieces of ranks that lie in several over to the neighbour with which they share most faces."""
    rank, faces = rank.copy(), shared_faces(load, pairs)
    for _ in range(REPAIRS):
        piece = pieces(rank, load, pairs)
        size = np.bincount(piece[piece >= 0], load[piece >= 0])
        kept: dict[int, int] = {}  # the largest piece of each rank stays
        for name in np.unique(piece[piece >= 0]):
            owner = int(rank[np.argmax(piece == name)])
            if owner not in kept or size[name] > size[kept[owner]]:
                kept[owner] = int(name)
        stray = np.setdiff1d(np.unique(piece[piece >= 0]), list(kept.values()))
        if not stray.size:
            break
        for name in stray:
            sides = piece[pairs] == name
            edge = sides.any(1) & ~sides.all(1) & (faces > 0)
            other = np.where(sides[edge, 0], pairs[edge, 1], pairs[edge, 0])
            if other.size:
                rank[piece == name] = np.argmax(np.bincount(rank[other], faces[edge]))
    return rank


def _bisect(centres: np.ndarray, load: np.ndarray, members: np.ndarray, first: int, ranks: int,
            rank: np.ndarray) -> None:  # fmt: skip
    if ranks == 1:
        rank[members] = first
        return
    lower = ranks // 2
    # Across the direction in which the cells, not the tank, spread more: short cuts, few shared faces.
    axis = int(np.argmax(np.average((centres[members] - np.median(centres[members], 0)) ** 2, axis=0)))
    ordered = members[np.argsort(centres[members, axis], kind="stable")]
    share = np.cumsum(load[ordered])
    cut = int(np.searchsorted(share, share[-1] * lower / ranks))
    _bisect(centres, load, ordered[:cut], first, lower, rank)
    _bisect(centres, load, ordered[cut:], first + lower, ranks - lower, rank)
